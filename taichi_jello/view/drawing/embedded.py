"""Embedded skins: points that move with the particles of their cells, with smooth normals."""

import numpy as np
import taichi as ti

from taichi_jello.scene.body import Body
from taichi_jello.view.drawing.rows import Array2, Index1, Index2, put, row
from taichi_jello.view.drawing.subdivide import smooth_patches


@ti.kernel
def carry(x: Array2, cells: Index2, first: Index1, places: Array2, facing: Array2, points: Array2, normals: Array2):
    """Trilinear interpolation. Cell c with the corners cells[c] of particles x carries the points first[c] up to
    first[c + 1], at `places` from 0 to 1 along each side; `facing` are the normals in the undeformed cell."""
    ti.loop_config(block_dim=64)
    for c in range(cells.shape[0]):
        # The map as a polynomial in the place; p, pa, pb … pabc: the corner and those a step along a, b, c away.
        p, pc, pb, pbc = row(x, cells[c, 0]), row(x, cells[c, 1]), row(x, cells[c, 2]), row(x, cells[c, 3])
        pa, pac, pab, pabc = row(x, cells[c, 4]), row(x, cells[c, 5]), row(x, cells[c, 6]), row(x, cells[c, 7])
        a, b, d = pa - p, pb - p, pc - p
        ab, ad, bd = pab - pa - b, pac - pa - d, pbc - pb - d
        abd = pabc - pab - pac + pa - bd
        for i in range(first[c], first[c + 1]):
            at, n = row(places, i), row(facing, i)
            along_a, along_b = a + at[1] * (ab + at[2] * abd) + at[2] * ad, b + at[2] * bd
            put(points, i, p + at[0] * along_a + at[1] * along_b + at[2] * d)
            # Normals transform by the cofactors of the map's gradient.
            along_b += at[0] * (ab + at[2] * abd)
            along_d = d + at[0] * ad + at[1] * (bd + at[0] * abd)
            n = n[0] * along_b.cross(along_d) + n[1] * along_d.cross(along_a) + n[2] * along_a.cross(along_b)
            put(normals, i, n / ti.max(n.norm(), 1e-20))


class Embedded:
    """The mesh of embedded skins: normals (P, 3) of its points, index (T, 3), jello (P,) that each point belongs to.
    A point on a sharp edge is there once for each smooth patch that meets the edge."""

    def __init__(self, body: Body):
        rest = body.skin_points(body.rest)
        start, faces = smooth_patches(rest, body.skin)
        # Triangle corners at the same point become one if their patches consist of the same triangles.
        corner = body.skin.ravel().astype(np.int64)
        names = np.random.default_rng(0).integers(2**53, size=len(body.skin))  # their sums identify sets of faces
        patch = np.add.reduceat(names[faces], start[:-1])
        order = np.lexsort((patch, corner))
        new = (np.diff(corner[order], prepend=-1) != 0) | (np.diff(patch[order], prepend=-1) != 0)
        chosen, which = order[new], np.empty(len(order), np.int64)
        which[order] = np.cumsum(new) - 1
        # Sort points by cell and triangles by their points, for locality.
        cells, cell = np.unique(body.skin_corners[corner[chosen]], axis=0, return_inverse=True)
        by_cell = np.argsort(cell.ravel(), kind="stable")
        chosen, index = chosen[by_cell], np.argsort(by_cell)[which].reshape(-1, 3)
        by_point = np.argsort(index.min(1), kind="stable")
        point = corner[chosen]
        self.index = np.ascontiguousarray(index[by_point], np.int32)
        self.jello = body.jello[body.skin_corners[point, 0]]
        self.normals = np.zeros((len(point), 3), np.float32)
        self._cells = np.ascontiguousarray(cells, np.int32)
        self._first = np.searchsorted(cell.ravel()[by_cell], np.arange(len(cells) + 1)).astype(np.int32)
        # The place along a side is the sum of the trilinear weights of the corners at its end.
        steps = np.array([[k >> 2, k >> 1 & 1, k & 1] for k in range(8)])
        self._places = (body.skin_weights[point] @ steps).astype(np.float32)
        # Normals in the coordinates of the undeformed cell, whose sides may differ.
        ends = body.rest[cells[:, [0, 4, 2, 1]]]  # a corner, and the next along each side
        sides = np.stack([ends[:, k + 1, k] - ends[:, 0, k] for k in range(3)], 1)[cell.ravel()[by_cell]]
        ways = rest[body.skin[:, 1:]] - rest[body.skin[:, :1]]
        normals = np.add.reduceat(np.cross(ways[:, 0], ways[:, 1])[faces], start[:-1])[chosen]
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        self._facing = (normals * sides).astype(np.float32)

    def __len__(self) -> int:
        return len(self.normals)

    def update(self, x: np.ndarray, points: np.ndarray) -> None:
        """Fill `points` (P, 3) float32 and the normals for particles at x (N, 3) float32 [m]."""
        carry(x, self._cells, self._first, self._places, self._facing, points, self.normals)
