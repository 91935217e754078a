"""The translucent skin: a finer mesh over the body's surface, or the one embedded in it, shaded smoothly and sorted
from back to front."""

import numpy as np
import taichi as ti

from taichi_jello.scene.body import Body
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.embedded import Embedded
from taichi_jello.view.drawing.primitives import Triangles
from taichi_jello.view.drawing.rows import Array1, Array2, Index1, Index2, face_normal, put, row, sum_over, vec3
from taichi_jello.view.drawing.shading import gel
from taichi_jello.view.drawing.subdivide import subdivide


@ti.kernel
def cover(
    x: Array2,
    surface: Index2,
    flat: Array2,
    corner_start: Index1,
    corner_face: Index1,
    corner: Array2,
    parent: Index2,
    share: Array2,
    start: Index1,
    item: Index1,
    weight: Array1,
    points: Array2,
    normal: Array2,
):
    """Fine `points` over the triangles `surface` of particles x, and their normals. flat: the triangles' normals, as
    long as twice their area; corner: the normals of their corners over the faces of one smooth patch; see Fine."""
    ti.loop_config(block_dim=1024)
    for t in range(surface.shape[0]):
        put(flat, t, face_normal(x, surface, t))
    ti.loop_config(block_dim=1024)
    for c in range(corner.shape[0]):
        put(corner, c, sum_over(flat, corner_face, corner_start[c], corner_start[c + 1]).normalized(1e-20))
    ti.loop_config(block_dim=1024)
    for i in range(parent.shape[0]):
        p, n = vec3(0.0), vec3(0.0)
        for k in ti.static(range(3)):
            p += share[i, k] * row(x, parent[i, k])
        for k in range(start[i], start[i + 1]):
            n += weight[k] * row(corner, item[k])
        put(points, i, p)
        put(normal, i, n.normalized(1e-20))


@ti.kernel
def shade(x: Array2, normal: Array2, albedo: Array2, index: Index2, look: Array2, rgba: Array2, away: Array1):
    """The colours of the skin's points, and how far its triangles are from the eye [m]: below zero if they show
    their inner side."""
    ti.loop_config(block_dim=1024)
    for i in range(x.shape[0]):
        color = gel(row(albedo, i), row(x, i), row(normal, i), look)
        for k in ti.static(range(4)):
            rgba[i, k] = color[k]
    ti.loop_config(block_dim=1024)
    for t in range(index.shape[0]):
        a = row(x, index[t, 0])
        seen = a - row(look, 0)
        outer = (row(x, index[t, 1]) - a).cross(row(x, index[t, 2]) - a).dot(seen) < 0.0
        away[t] = seen.norm() if outer else -seen.norm()


class Skin:
    """`triangles` to blend in their order: jello after jello from the farthest, inner sides before outer
    ones. First come those over the particles' surface, then those of embedded skins."""

    def __init__(self, body: Body, embedded: Embedded | None = None):
        self.surface = np.ascontiguousarray(body.bare_surface, np.int32)
        self.fine = subdivide(body.rest, self.surface) if len(self.surface) else None
        self.embedded = embedded
        jello, index = [np.zeros(0, np.int32)], [np.zeros((0, 3), np.int32)]
        if self.fine is not None:
            jello.append(body.jello[self.fine.parent[:, 0]])
            index.append(self.fine.index)
        self.count = sum(map(len, jello))  # of points over the surface
        if embedded is not None:
            jello.append(embedded.jello)
            index.append(embedded.index + self.count)
        owner, self.index = np.concatenate(jello), np.ascontiguousarray(np.concatenate(index), np.int32)
        self.albedo = palette.skin(owner).astype(np.float32)
        self.owner = owner[self.index[:, 0]]
        self.triangles = Triangles.empty(len(owner), self.index)
        self.normal = np.zeros((len(owner), 3), np.float32)
        self._away = np.zeros(len(self.index), np.float32)
        self._flat = np.zeros((len(self.surface), 3), np.float32)
        self._corner = np.zeros((3 * len(self.surface), 3), np.float32)

    def place(self, x: np.ndarray, skin: np.ndarray) -> None:
        """Put the triangles where particles at x (N, 3) and points of embedded skins at skin (P, 3) [m] carry them."""
        out, f = self.triangles, self.fine
        if f is not None:
            surface = self.surface, self._flat, f.corner_start, f.corner_face, self._corner
            fine = f.parent, f.share, f.start, f.item, f.weight
            cover(x, *surface, *fine, out.x[: self.count], self.normal[: self.count])
        if self.embedded is not None:
            out.x[self.count :], self.normal[self.count :] = skin, self.embedded.normals

    def shade(self, look: np.ndarray) -> None:
        """Colour them and put them in order, where they are now."""
        out = self.triangles
        shade(out.x, self.normal, self.albedo, self.index, look, out.rgba, self._away)
        out.index = self.index[self._order()]

    def _order(self) -> np.ndarray:
        """(F,) triangles from back to front: the farther jello first, then inner sides, then the farther
        triangle."""
        away = np.abs(self._away)
        count = np.bincount(self.owner)
        jello = np.bincount(self.owner, weights=away) / np.maximum(count, 1)
        later = 2 * np.argsort(np.argsort(-jello))[self.owner] + (self._away > 0.0)
        # One whole number to sort by: the bits of a float that is not negative grow with it.
        return np.argsort((later << 32) - away.view(np.int32), kind="stable")
