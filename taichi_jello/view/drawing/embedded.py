"""Embedded skins as they are drawn: points carried along by the particles of their cells, with smooth normals."""

import numpy as np
import taichi as ti

from taichi_jello.scene.body import Body
from taichi_jello.view.drawing.rows import Array2, Index1, Index2, put, row
from taichi_jello.view.drawing.subdivide import smooth_patches


@ti.kernel
def carry(x: Array2, cells: Index2, first: Index1, places: Array2, facing: Array2, points: Array2, normals: Array2):
    """points: those from first[c] to first[c + 1] are where their places, 0 to 1 along each side, are in cell c with
    its corners `cells` at x; normals: of surfaces that face as `facing` in the undeformed cell, at length 1."""
    ti.loop_config(block_dim=64)
    for c in range(cells.shape[0]):
        # The trilinear map as a polynomial: what a step along a, b and c adds, and what two and all three do beyond.
        p, pc, pb, pbc = row(x, cells[c, 0]), row(x, cells[c, 1]), row(x, cells[c, 2]), row(x, cells[c, 3])
        pa, pac, pab, pabc = row(x, cells[c, 4]), row(x, cells[c, 5]), row(x, cells[c, 6]), row(x, cells[c, 7])
        a, b, d = pa - p, pb - p, pc - p
        ab, ad, bd = pab - pa - b, pac - pa - d, pbc - pb - d
        abd = pabc - pab - pac + pa - bd
        for i in range(first[c], first[c + 1]):
            at, n = row(places, i), row(facing, i)
            along_a, along_b = a + at[1] * (ab + at[2] * abd) + at[2] * ad, b + at[2] * bd
            put(points, i, p + at[0] * along_a + at[1] * along_b + at[2] * d)
            # Areas go by the cofactors of the map's slope.
            along_b += at[0] * (ab + at[2] * abd)
            along_d = d + at[0] * ad + at[1] * (bd + at[0] * abd)
            n = n[0] * along_b.cross(along_d) + n[1] * along_d.cross(along_a) + n[2] * along_a.cross(along_b)
            put(normals, i, n / ti.max(n.norm(), 1e-20))


class Embedded:
    """points (P, 3) float32 [m] and their normals (P, 3), index (T, 3) triangles, jello (P,) whose they are.

    A point of the skin at a sharp edge is drawn once for each of the smooth patches that meet there."""

    def __init__(self, body: Body):
        rest = body.skin_points(body.rest)
        start, faces = smooth_patches(rest, body.skin)
        # Corners of triangles at the same point whose patches have the same triangles are drawn as one point.
        corner = body.skin.ravel().astype(np.int64)
        names = np.random.default_rng(0).integers(2**53, size=len(body.skin))  # whose sums tell sets of faces apart
        patch = np.add.reduceat(names[faces], start[:-1])
        order = np.lexsort((patch, corner))
        new = (np.diff(corner[order], prepend=-1) != 0) | (np.diff(patch[order], prepend=-1) != 0)
        chosen, which = order[new], np.empty(len(order), np.int64)
        which[order] = np.cumsum(new) - 1
        # Points cell by cell and triangles after their points: what is read together lies together.
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
        # Trilinear weights sum to the place in the cell over the corners that are one step along each side.
        steps = np.array([[k >> 2, k >> 1 & 1, k & 1] for k in range(8)])
        self._places = (body.skin_weights[point] @ steps).astype(np.float32)
        # Normals as the undeformed cell sees them, which may be longer one way than another.
        ends = body.rest[cells[:, [0, 4, 2, 1]]]
        sides = np.stack([ends[:, k + 1, k] - ends[:, 0, k] for k in range(3)], 1)[cell.ravel()[by_cell]]
        ways = rest[body.skin[:, 1:]] - rest[body.skin[:, :1]]
        normals = np.add.reduceat(np.cross(ways[:, 0], ways[:, 1])[faces], start[:-1])[chosen]
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        self._facing = (normals * sides).astype(np.float32)

    def __len__(self) -> int:
        return len(self.normals)

    def update(self, x: np.ndarray, points: np.ndarray) -> None:
        """Write the points (P, 3) float32 for particles at x (N, 3) float32 [m], and the normals."""
        carry(x, self._cells, self._first, self._places, self._facing, points, self.normals)
