"""Embedded skins as they are drawn: points carried along by the particles of their cells, with smooth normals."""

import numpy as np
import taichi as ti

from taichi_jello.body import Body
from taichi_jello.view.rows import Array2, Index1, Index2, row, vec3
from taichi_jello.view.subdivide import smooth_patches


@ti.kernel
def carry(
    x: Array2,
    corners: Index2,
    weights: Array2,
    index: Index2,
    start: Index1,
    face: Index1,
    points: Array2,
    flat: Array2,
    normals: Array2,
):
    """points: the means of the particles x at their `corners` by `weights`; flat: the normals of the triangles `index`,
    as long as twice their area; normals: for each point the sum over its triangles face[start[i]] …, at length 1."""
    ti.loop_config(block_dim=4096)
    for i in range(points.shape[0]):
        p = vec3(0.0)
        for k in ti.static(range(8)):
            p += weights[i, k] * row(x, corners[i, k])
        for axis in ti.static(range(3)):
            points[i, axis] = p[axis]
    ti.loop_config(block_dim=4096)
    for t in range(index.shape[0]):
        a = row(points, index[t, 0])
        n = (row(points, index[t, 1]) - a).cross(row(points, index[t, 2]) - a)
        for axis in ti.static(range(3)):
            flat[t, axis] = n[axis]
    ti.loop_config(block_dim=4096)
    for i in range(points.shape[0]):
        n = vec3(0.0)
        for k in range(start[i], start[i + 1]):
            n += row(flat, face[k])
        n /= ti.max(n.norm(), 1e-20)
        for axis in ti.static(range(3)):
            normals[i, axis] = n[axis]


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
        point, count = corner[chosen], np.diff(start)[chosen]
        own = np.repeat(start[:-1][chosen] - np.cumsum(count) + count, count) + np.arange(count.sum())
        self.index = np.ascontiguousarray(which.reshape(-1, 3), np.int32)
        self.jello = body.jello[body.skin_corners[point, 0]]
        self.normals = np.zeros((len(point), 3), np.float32)
        self._corners = np.ascontiguousarray(body.skin_corners[point], np.int32)
        self._weights = np.ascontiguousarray(body.skin_weights[point], np.float32)
        self._start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
        self._face = np.ascontiguousarray(faces[own], np.int32)
        self._flat = np.zeros((len(self.index), 3), np.float32)

    def __len__(self) -> int:
        return len(self.normals)

    def update(self, x: np.ndarray, points: np.ndarray) -> None:
        """Write the points (P, 3) float32 for particles at x (N, 3) float32 [m], and the normals."""
        carry(x, self._corners, self._weights, self.index, self._start, self._face, points, self._flat, self.normals)
