"""Soft shadows on planar colliders: the casters' heights over a fine grid, blurred more the higher they are."""

import numpy as np
import taichi as ti

from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.primitives import Triangles
from taichi_jello.view.drawing.rows import Array2, Index2, put, row, vec3
from taichi_jello.view.drawing.shading import EYE, ground
from taichi_jello.view.drawing.surroundings import Surface

CELLS = 80  # along each side of the grid
CELLS_ACROSS = 36  # cells across the casters at rest
BLUR_RADIUS = 8  # cells
LANES = 16  # cells that a vector unit handles at once
NO_CASTER = 1e9
MAX_DARKNESS = 0.46
FADE_RATE = 0.35  # 1/m; how fast a shadow pales as its caster rises
MIN_DARKNESS = 1.0 / 512.0  # too faint to change a pixel
DARK = vec3(*palette.SHADOW)
LIFT = 0.0004  # of the distance to the eye: above the ground, below the grid lines
# Steeper than the lamp that shades, so that the shadow stays near the foot of its jello and shows its height.
SUN = np.array([-0.22, 1.0, 0.20])
CORNER, AXIS_U, AXIS_V, NORMAL, BEAM = range(5)  # rows of a plane


@ti.func
def footprint(p, plane: ti.template()):
    """(u, v, height): the shadow of p on the plane, in cells, and the height [m] of p above it."""
    n, sun = row(plane, NORMAL), row(plane, BEAM)
    height = (p - row(plane, CORNER)).dot(n)
    foot = p - sun * (height / sun.dot(n)) - row(plane, CORNER)
    return vec3(foot.dot(row(plane, AXIS_U)), foot.dot(row(plane, AXIS_V)), height)


@ti.kernel
def cast(x: Array2, faces: Index2, plane: Array2, heights: Array2):
    """The lowest height [m] of the faces over each grid cell, or NO_CASTER.
    plane (5, 3): the grid's CORNER [m], AXIS_U and AXIS_V [cells/m], unit NORMAL, and the sun's direction BEAM."""
    ti.loop_config(block_dim=512)
    for cell in range(CELLS * CELLS):
        heights[cell // CELLS, cell % CELLS] = NO_CASTER
    ti.loop_config(block_dim=64)
    for t in range(faces.shape[0]):
        corner = ti.Matrix.zero(ti.f32, 3, 3)
        for k in range(3):
            corner[k, :] = footprint(row(x, faces[t, k]), plane)
        low, high = vec3(NO_CASTER), vec3(-NO_CASTER)
        for k in range(3):
            low, high = ti.min(low, corner[k, :]), ti.max(high, corner[k, :])
        turn = (corner[1, :] - corner[0, :]).cross(corner[2, :] - corner[0, :])[2]
        for i in range(ti.max(int(low[0]), 0), ti.min(int(high[0]) + 2, CELLS)):
            for j in range(ti.max(int(low[1]), 0), ti.min(int(high[1]) + 2, CELLS)):
                inside = high[2] > 0.0
                for k in range(3):
                    a, d = corner[k, :], corner[(k + 1) % 3, :] - corner[k, :]
                    left = (d[0] * (j - a[1]) - d[1] * (i - a[0])) * ti.math.sign(turn)
                    # Half a cell wider all round, so that a line of particles still covers cells.
                    inside = inside and left >= -0.5 * ti.sqrt(d[0] * d[0] + d[1] * d[1])
                if inside:
                    ti.atomic_min(heights[i, j], ti.max((low[2] + high[2]) * 0.5, 0.0))


@ti.kernel
def blur(cover: Array2, heights: Array2, cell: ti.f32, covered: Array2, mean: Array2):
    """One pass of a separable blur of (cover, mean height), wider for higher casters. Apply it twice: it swaps axes."""
    ti.loop_config(block_dim=64)
    for block in range(CELLS * CELLS // LANES):
        i, first = block // (CELLS // LANES), block % (CELLS // LANES) * LANES
        dark, high = ti.Vector([0.0] * LANES), ti.Vector([0.0] * LANES)
        for k in range(ti.max(i - BLUR_RADIUS, 0), ti.min(i + BLUR_RADIUS + 1, CELLS)):
            for lane in range(LANES):
                height = heights[k, first + lane]
                near = 1.0 / (2.6 + ti.min(height * (0.16 / cell), BLUR_RADIUS - 1.6))
                away = (k - i) * near
                weight = 0.75 * cover[k, first + lane] * near * ti.max(1.0 - away * away, 0.0)
                dark[lane] += weight
                high[lane] += weight * height
        for lane in range(LANES):
            covered[first + lane, i], mean[first + lane, i] = dark[lane], high[lane] / ti.max(dark[lane], 1e-9)


@ti.kernel
def paint(cover: Array2, heights: Array2, plane: Array2, camera: Array2, x: Array2, rgb: Array2, darkness: Array2):
    """The grid's points x [m], lifted towards the eye, colours and darkness; here `plane` has axes in m per cell."""
    ti.loop_config(block_dim=256)
    for i, j in ti.ndrange(CELLS, CELLS):
        dark = ti.min(cover[i, j] * MAX_DARKNESS / (1.0 + FADE_RATE * heights[i, j]), MAX_DARKNESS)
        p, cell = row(plane, CORNER) + i * row(plane, AXIS_U) + j * row(plane, AXIS_V), i * CELLS + j
        color = ti.math.mix(ground(p, row(plane, NORMAL), camera), DARK, dark)
        p += (row(camera, EYE) - p) * LIFT
        darkness[i, j] = dark
        put(x, cell, p)
        put(rgb, cell, color)


class Shadow:
    """The shadow of `faces` (F, 3) on one planar surface, as opaque `triangles`; extent: the casters' width [m]."""

    def __init__(self, surface: Surface, faces: np.ndarray, extent: float):
        self.normal, self.cell = surface.normal[0], max(extent, 1e-6) / CELLS_ACROSS
        across = np.cross([0.0, 0.0, 1.0], self.normal) if abs(self.normal[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        across /= np.linalg.norm(across)
        self.axes = np.stack([across, np.cross(self.normal, across)])
        # A point p casts its shadow at p - SUN (p·n) / (SUN·n).
        project = (np.eye(3) - np.outer(self.normal, SUN) / (SUN @ self.normal)) @ self.axes.T
        self._project = project.astype(np.float32)
        places = surface.points @ self.axes.T
        self.bounds = np.array([places.min(0), places.max(0)])
        self._faces = np.ascontiguousarray(faces, np.int32)
        self._casters = np.unique(self._faces)
        index = np.arange(CELLS * CELLS, dtype=np.int32).reshape(CELLS, CELLS)
        p, q, r, s = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
        self._grid = np.stack([p, q, r, p, r, s], -1).reshape(-1, 3)
        self.triangles = Triangles.empty(CELLS * CELLS, self._grid)
        self._rgb = np.zeros((CELLS * CELLS, 3), np.float32)
        self._heights, self._dark = np.zeros((2, CELLS, CELLS), np.float32)
        self._once, self._twice = np.zeros((2, 2, CELLS, CELLS), np.float32)

    def update(self, x: np.ndarray, origin: np.ndarray, camera: np.ndarray) -> None:
        """x (points, 3) float32 that `faces` index [m]; origin (3,) of the surface [m]."""
        corner, cell = self._place(x[self._casters] - origin)
        base = origin + corner @ self.axes
        plane = np.stack([base, *(self.axes / cell), self.normal, SUN]).astype(np.float32)
        cast(x, self._faces, plane, self._heights)
        blur((self._heights < NO_CASTER).astype(np.float32), self._heights, cell, *self._once)
        blur(*self._once, cell, *self._twice)
        plane[AXIS_U : AXIS_V + 1] = cell * self.axes
        paint(*self._twice, plane, camera, self.triangles.x, self._rgb, self._dark)
        self.triangles.rgba[:, :3] = self._rgb
        dark = self._dark > MIN_DARKNESS  # elsewhere the floor itself shows
        quads = dark[:-1, :-1] | dark[1:, :-1] | dark[:-1, 1:] | dark[1:, 1:]
        self.triangles.index = self._grid[np.repeat(quads.ravel(), 2)]

    def _place(self, points: np.ndarray) -> tuple[np.ndarray, float]:
        """The grid's corner (2,) on the plane and its cell [m]: a multiple of the cell, or shadows would shimmer."""
        feet = points @ self._project
        if not np.isfinite(feet.sum()):
            feet = feet[np.isfinite(feet).all(1)]
        if not len(feet):
            return np.zeros(2), self.cell
        low, high = np.maximum(feet.min(0), self.bounds[0]), np.minimum(feet.max(0), self.bounds[1])
        room = CELLS - 2 * BLUR_RADIUS - 3
        doublings = np.ceil(np.log2(max(float((high - low).max()) / (room * self.cell), 1.0)))
        cell = min(self.cell * 2.0**doublings, float(np.ptp(self.bounds, axis=0).min()) / (CELLS - 1))
        corner = (np.floor(0.5 * (low + high) / cell) - CELLS // 2) * cell
        return np.clip(corner, self.bounds[0], self.bounds[1] - (CELLS - 1) * cell), cell
