"""The translucent skin: a finer mesh over the body's surface, shaded smoothly and sorted from back to
front."""

import numpy as np

from taichi_jello.body import Body
from taichi_jello.view import palette
from taichi_jello.view.primitives import Triangles
from taichi_jello.view.shading import gel, unit
from taichi_jello.view.subdivide import subdivide


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

    def update(self, x: np.ndarray, look: np.ndarray) -> None:
        """Face normals, then corner normals over the faces of one smooth patch, then the fine vertices and their
        colours, for particles at x (N, 3) float32 [m]."""
        f, out = self.fine, self.triangles
        a, b, c = (x[self.surface[:, k]] for k in range(3))
        flat = np.cross(b - a, c - a)
        corner = unit(np.add.reduceat(flat[f.corner_face], f.corner_start[:-1]))
        normal = unit(np.add.reduceat(f.weight[:, None] * corner[f.item], f.start[:-1]))
        out.x[:] = sum(f.share[:, k, None] * x[f.parent[:, k]] for k in range(3))
        out.rgba[:] = gel(self.albedo, out.x, normal, look)
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
