"""Soft shadows on level colliders: the casters' heights over a fine grid, blurred more the higher they
are."""

import numpy as np
import taichi as ti

from taichi_jello.view import palette
from taichi_jello.view.primitives import Triangles
from taichi_jello.view.rows import Array2, Index2, row, vec3
from taichi_jello.view.shading import ground, mix, nearer
from taichi_jello.view.surroundings import REACH, Surface

CELLS = 80  # cells along each side of the grid
ACROSS = 36  # cells across the casters at rest
TAPS = 8  # cells that a blur reaches to either side
NOTHING = 1e9
DARKEST = 0.46
FAINTER = 0.35  # 1/m; how fast a shadow pales as its caster rises
FAINTEST = 1.0 / 512.0  # darkness that no pixel shows
DARK = palette.SHADOW.astype(np.float32).reshape(1, 3)
LIFT = 0.0004  # of the distance to the eye: over the ground, under the grid lines
# Steeper than the lamp that shades: the shadow stays near the foot of its jello, where it tells the height.
SUN = np.array([-0.22, 1.0, 0.20])


@ti.func
def footprint(p, plane: ti.template()):
    """(u, v, height) of p over the plane, found along the sunbeam; u and v count cells of the grid."""
    n, sun = row(plane, 3), row(plane, 4)
    height = (p - row(plane, 0)).dot(n)
    foot = p - sun * (height / sun.dot(n)) - row(plane, 0)
    return vec3(foot.dot(row(plane, 1)), foot.dot(row(plane, 2)), height)


@ti.kernel
def cast(x: Array2, faces: Index2, plane: Array2, heights: Array2):
    """The lowest height [m] of the faces over each cell of the grid; NOTHING where there is none.

    plane (5, 3): the grid's corner, two axes per cell [1/m], the unit normal, the direction of the sun."""
    ti.loop_config(block_dim=512)
    for cell in range(CELLS * CELLS):
        heights[cell // CELLS, cell % CELLS] = NOTHING
    ti.loop_config(block_dim=64)
    for t in range(faces.shape[0]):
        corner = ti.Matrix.zero(ti.f32, 3, 3)
        for k in range(3):
            corner[k, :] = footprint(row(x, faces[t, k]), plane)
        low, high = vec3(NOTHING), vec3(-NOTHING)
        for k in range(3):
            low, high = ti.min(low, corner[k, :]), ti.max(high, corner[k, :])
        turn = (corner[1, :] - corner[0, :]).cross(corner[2, :] - corner[0, :])[2]
        for i in range(ti.max(int(low[0]), 0), ti.min(int(high[0]) + 2, CELLS)):
            for j in range(ti.max(int(low[1]), 0), ti.min(int(high[1]) + 2, CELLS)):
                inside = high[2] > 0.0
                for k in range(3):
                    a, d = corner[k, :], corner[(k + 1) % 3, :] - corner[k, :]
                    left = (d[0] * (j - a[1]) - d[1] * (i - a[0])) * ti.math.sign(turn)
                    # Half a cell wider all round: a thread one particle thin still covers cells.
                    inside = inside and left >= -0.5 * ti.sqrt(d[0] * d[0] + d[1] * d[1])
                if inside:
                    ti.atomic_min(heights[i, j], ti.max((low[2] + high[2]) * 0.5, 0.0))


def blur(cover: np.ndarray, heights: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """One axis of a blur of (cover, mean height) that reaches farther for higher casters, with the axes swapped:
    twice is a whole blur."""
    reach = 2.6 + np.minimum(heights * np.float32(0.16 / cell), TAPS - 1.6)
    dark, inverse = cover * (0.75 / reach), 1.0 / reach
    covered, high = np.zeros_like(cover), np.zeros_like(cover)
    for tap in range(-TAPS, TAPS + 1):
        here, there = slice(max(0, -tap), CELLS - max(0, tap)), slice(max(0, tap), CELLS - max(0, -tap))
        weight = dark[there] * np.maximum(1.0 - (tap * inverse[there]) ** 2, 0.0)
        covered[here] += weight
        high[here] += weight * heights[there]
    return covered.T, (high / np.maximum(covered, np.float32(1e-9))).T


def _grid_faces() -> np.ndarray:
    index = np.arange(CELLS * CELLS, dtype=np.int32).reshape(CELLS, CELLS)
    p, q, r, s = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return np.stack([np.stack([p, q, r], -1), np.stack([p, r, s], -1)], 2).reshape(-1, 3)


class Shadow:
    """The shadow of `faces` (F, 3) on one level surface, as opaque `triangles` just above it."""

    def __init__(self, surface: Surface, faces: np.ndarray, extent: float):
        """extent [m]: how wide the casters are at rest."""
        self.faces = np.ascontiguousarray(faces, np.int32)
        self.normal = surface.normal[0]
        self.axes = np.stack([_across(self.normal), np.cross(self.normal, _across(self.normal))])
        flat = surface.points @ self.axes.T
        self.bounds = np.array([flat.min(0), flat.max(0)])
        self.cell = max(extent, 1e-6) / ACROSS
        self._faces = _grid_faces()
        self.triangles = Triangles.empty(CELLS * CELLS, self._faces)
        self._used = np.unique(self.faces)
        self._heights = np.zeros((CELLS, CELLS), np.float32)
        self._normals = np.tile(self.normal, (CELLS * CELLS, 1)).astype(np.float32)
        self._steps = np.indices((CELLS, CELLS)).reshape(2, -1).T

    def update(self, x: np.ndarray, origin: np.ndarray, look: np.ndarray) -> None:
        """x (points, 3) float32 that `faces` index [m]; origin (3,) of the surface [m]."""
        corner, cell = self._place(x[self._used] - origin)
        base = origin + corner @ self.axes
        plane = np.stack([base, *(self.axes / cell), self.normal, SUN]).astype(np.float32)
        cast(x, self.faces, plane, self._heights)
        cover, heights = blur((self._heights < NOTHING).astype(np.float32), self._heights, cell)
        cover, heights = blur(cover, heights, cell)
        darkness = np.minimum(cover * DARKEST / (1.0 + FAINTER * heights), DARKEST)
        self._paint(darkness, base, cell, look)

    def _paint(self, darkness: np.ndarray, base: np.ndarray, cell: float, look: np.ndarray) -> None:
        """Only where there is a shadow: elsewhere the floor itself shows."""
        dark = darkness > FAINTEST
        quads = dark[:-1, :-1] | dark[1:, :-1] | dark[:-1, 1:] | dark[1:, 1:]
        self.triangles.index = self._faces[np.repeat(quads.ravel(), 2)]
        used = np.zeros((CELLS, CELLS), bool)
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
            used[i : CELLS - 1 + i, j : CELLS - 1 + j] |= quads
        which = np.flatnonzero(used)
        points = (base + cell * (self._steps[which] @ self.axes)).astype(np.float32)
        color = ground(points, self._normals[which], look, REACH)
        self.triangles.x[which] = nearer(points, look, LIFT)
        self.triangles.rgba[which, :3] = mix(color, DARK, darkness.ravel()[which, None])

    def _place(self, points: np.ndarray) -> tuple[np.ndarray, float]:
        """The grid's corner (2,) on the plane [m] and its cell [m]: whole cells, so that a shadow does not
        shimmer."""
        height = points @ self.normal
        foot = (points - np.outer(height / (SUN @ self.normal), SUN)) @ self.axes.T
        foot = foot[np.isfinite(foot).all(1)]
        if not len(foot):
            return np.zeros(2), self.cell
        low, high = np.maximum(foot.min(0), self.bounds[0]), np.minimum(foot.max(0), self.bounds[1])
        room = CELLS - 2 * TAPS - 3
        doublings = np.ceil(np.log2(max(float((high - low).max()) / (room * self.cell), 1.0)))
        cell = min(self.cell * 2.0**doublings, float(np.ptp(self.bounds, axis=0).min()) / (CELLS - 1))
        corner = (np.floor(0.5 * (low + high) / cell) - CELLS // 2) * cell
        return np.clip(corner, self.bounds[0], self.bounds[1] - (CELLS - 1) * cell), cell


def _across(normal: np.ndarray) -> np.ndarray:
    """A horizontal unit vector in the plane."""
    across = np.cross([0.0, 0.0, 1.0], normal) if abs(normal[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    return across / np.linalg.norm(across)
