"""Soft shadows on level colliders: the casters' heights over a fine grid, blurred more the higher they
are."""

import numpy as np
import taichi as ti

from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.primitives import Triangles
from taichi_jello.view.drawing.rows import Array2, Index2, row, vec3
from taichi_jello.view.drawing.shading import ground
from taichi_jello.view.drawing.surroundings import Surface

CELLS = 80  # cells along each side of the grid
ACROSS = 36  # cells across the casters at rest
TAPS = 8  # cells that a blur reaches to either side
LANES = 16  # cells that vector units take at once
NOTHING = 1e9
DARKEST = 0.46
FAINTER = 0.35  # 1/m; how fast a shadow pales as its caster rises
FAINTEST = 1.0 / 512.0  # darkness that no pixel shows
DARK = vec3(*palette.SHADOW)
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


@ti.kernel
def blur(cover: Array2, heights: Array2, cell: ti.f32, covered: Array2, mean: Array2):
    """One axis of a blur of (cover, mean height) that reaches farther for higher casters, with the axes swapped:
    twice is a whole blur. LANES cells of a row at once."""
    ti.loop_config(block_dim=64)
    for block in range(CELLS * CELLS // LANES):
        i, first = block // (CELLS // LANES), block % (CELLS // LANES) * LANES
        dark, high = ti.Vector([0.0] * LANES), ti.Vector([0.0] * LANES)
        for k in range(ti.max(i - TAPS, 0), ti.min(i + TAPS + 1, CELLS)):
            for lane in range(LANES):
                height = heights[k, first + lane]
                near = 1.0 / (2.6 + ti.min(height * (0.16 / cell), TAPS - 1.6))
                away = (k - i) * near
                weight = 0.75 * cover[k, first + lane] * near * ti.max(1.0 - away * away, 0.0)
                dark[lane] += weight
                high[lane] += weight * height
        for lane in range(LANES):
            covered[first + lane, i], mean[first + lane, i] = dark[lane], high[lane] / ti.max(dark[lane], 1e-9)


@ti.kernel
def paint(cover: Array2, heights: Array2, plane: Array2, look: Array2, x: Array2, rgb: Array2, darkness: Array2):
    """The grid's points x [m], nearer to the eye by LIFT, their colours and how dark the shadow is there; `plane`'s two
    axes are here those of one cell [m]."""
    ti.loop_config(block_dim=256)
    for i, j in ti.ndrange(CELLS, CELLS):
        dark = ti.min(cover[i, j] * DARKEST / (1.0 + FAINTER * heights[i, j]), DARKEST)
        p, cell = row(plane, 0) + i * row(plane, 1) + j * row(plane, 2), i * CELLS + j
        color = ti.math.mix(ground(p, row(plane, 3), look), DARK, dark)
        p += (row(look, 0) - p) * LIFT
        darkness[i, j] = dark
        for k in ti.static(range(3)):
            x[cell, k], rgb[cell, k] = p[k], color[k]


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
        # A point p casts its shadow at p - SUN (p·n) / (SUN·n).
        self._down = ((np.eye(3) - np.outer(self.normal, SUN) / (SUN @ self.normal)) @ self.axes.T).astype(np.float32)
        flat = surface.points @ self.axes.T
        self.bounds = np.array([flat.min(0), flat.max(0)])
        self.cell = max(extent, 1e-6) / ACROSS
        self._faces = _grid_faces()
        self.triangles = Triangles.empty(CELLS * CELLS, self._faces)
        self._used = np.unique(self.faces)
        self._heights, self._dark = (np.zeros((CELLS, CELLS), np.float32) for _ in range(2))
        self._rgb = np.zeros((CELLS * CELLS, 3), np.float32)
        self._half, self._whole = (np.zeros((2, CELLS, CELLS), np.float32) for _ in range(2))

    def update(self, x: np.ndarray, origin: np.ndarray, look: np.ndarray) -> None:
        """x (points, 3) float32 that `faces` index [m]; origin (3,) of the surface [m]."""
        corner, cell = self._place(x[self._used] - origin)
        base = origin + corner @ self.axes
        plane = np.stack([base, *(self.axes / cell), self.normal, SUN]).astype(np.float32)
        cast(x, self.faces, plane, self._heights)
        blur((self._heights < NOTHING).astype(np.float32), self._heights, cell, *self._half)
        blur(*self._half, cell, *self._whole)
        plane[1:3] = cell * self.axes
        paint(*self._whole, plane, look, self.triangles.x, self._rgb, self._dark)
        self.triangles.rgba[:, :3] = self._rgb
        dark = self._dark > FAINTEST  # elsewhere the floor itself shows
        quads = dark[:-1, :-1] | dark[1:, :-1] | dark[:-1, 1:] | dark[1:, 1:]
        self.triangles.index = self._faces[np.repeat(quads.ravel(), 2)]

    def _place(self, points: np.ndarray) -> tuple[np.ndarray, float]:
        """The grid's corner (2,) on the plane [m] and its cell [m]: whole cells, so that a shadow does not
        shimmer."""
        foot = points @ self._down
        if not np.isfinite(foot.sum()):
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
