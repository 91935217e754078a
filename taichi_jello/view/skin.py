"""The translucent skin: a finer mesh over the body's surface, shaded smoothly and sorted from back to
front."""

import numpy as np
import taichi as ti

from taichi_jello.body import Body
from taichi_jello.view import palette
from taichi_jello.view.primitives import Triangles
from taichi_jello.view.shading import Array1, Array2, Index1, Index2, gel, put, row
from taichi_jello.view.subdivide import subdivide


@ti.kernel
def shade(
    x: Array2, surface: Index2, corner_start: Index1, corner_face: Index1, flat: Array2, corner: Array2,
    start: Index1, item: Index1, weight: Array1, parent: Index2, share: Array2, albedo: Array2, look: Array2,
    vertices: Array2, rgba: Array2,
):  # fmt: skip
    """Face normals, then corner normals over faces of one smooth patch, then the fine vertices and their
    colours."""
    ti.loop_config(block_dim=64)
    for t in range(surface.shape[0]):
        a = row(x, surface[t, 0])
        put(flat, t, (row(x, surface[t, 1]) - a).cross(row(x, surface[t, 2]) - a))
    ti.loop_config(block_dim=64)
    for c in range(corner.shape[0]):
        n = ti.Vector.zero(ti.f32, 3)
        for k in range(corner_start[c], corner_start[c + 1]):
            n += row(flat, corner_face[k])
        put(corner, c, n / ti.max(n.norm(), ti.f32(1e-20)))
    ti.loop_config(block_dim=64)
    for i in range(vertices.shape[0]):
        p, n = ti.Vector.zero(ti.f32, 3), ti.Vector.zero(ti.f32, 3)
        for k in range(3):
            p += share[i, k] * row(x, parent[i, k])
        for k in range(start[i], start[i + 1]):
            n += weight[k] * row(corner, item[k])
        put(vertices, i, p)
        color = gel(row(albedo, i), p, n / ti.max(n.norm(), ti.f32(1e-20)), look)
        put(rgba, i, color)
        rgba[i, 3] = color[3]


class Skin:
    """`triangles` to blend in their order: jello after jello from the farthest, inner sides before outer
    ones."""

    def __init__(self, body: Body):
        self.surface = np.ascontiguousarray(body.surface, np.int32)
        self.fine = subdivide(body.rest, self.surface)
        owner = body.jello[self.fine.parent[:, 0]]
        self.albedo = palette.skin(owner).astype(np.float32)
        self.owner = owner[self.fine.index[:, 0]]
        self.triangles = Triangles.empty(len(self.fine.parent), self.fine.index)
        self._flat = np.zeros((len(self.surface), 3), np.float32)
        self._corner = np.zeros((3 * len(self.surface), 3), np.float32)

    def update(self, x: np.ndarray, look: np.ndarray) -> None:
        f, out = self.fine, self.triangles
        shade(
            x, self.surface, f.corner_start, f.corner_face, self._flat, self._corner,
            f.start, f.item, f.weight, f.parent, f.share, self.albedo, look, out.x, out.rgba,
        )  # fmt: skip
        out.index = f.index[self._order(look[0])]

    def _order(self, eye: np.ndarray) -> np.ndarray:
        """(F,) triangles from back to front: the farther jello first, then inner sides, then the farther
        triangle."""
        a, b, c = (self.triangles.x[self.fine.index[:, k]] for k in range(3))
        seen = a - eye
        outer = np.einsum("ij,ij->i", np.cross(b - a, c - a), seen) < 0.0
        away = np.linalg.norm(seen, axis=1)
        count = np.bincount(self.owner)
        jello = np.bincount(self.owner, weights=away) / np.maximum(count, 1)
        return np.lexsort((-away, outer, -jello[self.owner]))
