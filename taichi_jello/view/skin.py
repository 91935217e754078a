"""The translucent skin: a finer mesh over the body's surface, or the one embedded in it, shaded smoothly and sorted
from back to front."""

import numpy as np

from taichi_jello.body import Body
from taichi_jello.view import palette
from taichi_jello.view.embedded import Embedded
from taichi_jello.view.primitives import Triangles
from taichi_jello.view.shading import gel, unit
from taichi_jello.view.subdivide import Fine, subdivide


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
        owner, self.index = np.concatenate(jello), np.concatenate(index)
        self.albedo = palette.skin(owner).astype(np.float32)
        self.owner = owner[self.index[:, 0]]
        self.triangles = Triangles.empty(len(owner), self.index)
        self._normal = np.zeros((len(owner), 3), np.float32)

    def place(self, x: np.ndarray, skin: np.ndarray) -> None:
        """Put the triangles where particles at x (N, 3) and points of embedded skins at skin (P, 3) [m] carry them."""
        out = self.triangles
        if self.fine is not None:
            self._over_surface(self.fine, x)
        if self.embedded is not None:
            out.x[self.count :], self._normal[self.count :] = skin, self.embedded.normals

    def shade(self, look: np.ndarray) -> None:
        """Colour them and put them in order, where they are now."""
        out = self.triangles
        out.rgba[:] = gel(self.albedo, out.x, self._normal, look)
        out.index = self.index[self._order(look[0])]

    def _over_surface(self, f: Fine, x: np.ndarray) -> None:
        """Face normals, then corner normals over the faces of one smooth patch, then the fine points."""
        a, b, c = (x[self.surface[:, k]] for k in range(3))
        flat = np.cross(b - a, c - a)
        corner = unit(np.add.reduceat(flat[f.corner_face], f.corner_start[:-1]))
        self._normal[: self.count] = unit(np.add.reduceat(f.weight[:, None] * corner[f.item], f.start[:-1]))
        self.triangles.x[: self.count] = sum(f.share[:, k, None] * x[f.parent[:, k]] for k in range(3))

    def _order(self, eye: np.ndarray) -> np.ndarray:
        """(F,) triangles from back to front: the farther jello first, then inner sides, then the farther
        triangle."""
        a, b, c = (self.triangles.x[self.index[:, k]] for k in range(3))
        seen = a - eye
        outer = np.einsum("ij,ij->i", np.cross(b - a, c - a), seen) < 0.0
        away = np.linalg.norm(seen, axis=1)
        count = np.bincount(self.owner)
        jello = np.bincount(self.owner, weights=away) / np.maximum(count, 1)
        return np.lexsort((-away, outer, -jello[self.owner]))
