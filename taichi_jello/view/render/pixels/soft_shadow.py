"""The soft shadow on the floor, of bodies that let coloured light through.

The bodies are projected along the sunbeams into a grid on the floor that holds how much they absorb; it is blurred more
the higher they are. Below the middle of a clear body the floor is brighter than at its shadow's edge, for the body
gathers light as a lens does. `grid`, (3, 3) float32: the grid's corner; (cell [m], how far a beam goes along x and z
per metre down); (how fast contact darkens [1/m], share of light that no shadow takes, how much a lens gathers).
"""

import numpy as np
import taichi as ti

from taichi_jello.view.drawing.rows import Array2, Colors, Index1, Index2, Sums, put, row, vec3
from taichi_jello.view.render.pixels.buffers import corners, doubled_area, span

CELLS = 112  # along each side of the grid
ACROSS = 44  # cells across the casters at rest
TAPS = 14  # cells that a blur reaches to either side
NOTHING = 1e9
COUNT = 2.0**-12  # of absorption, in one count
BEAM = np.array([0.20, -0.16])  # how far light goes along x and z per metre that it falls
OPEN, SOLID_OPEN = 0.30, 0.42  # light that no shadow takes
GATHERED = 0.75
TOUCH = 0.5  # what contact takes of the light


@ti.func
def footprint(grid: ti.template(), p):
    """(u, v, height [m]): the cell in which p's shadow falls."""
    corner, cell = row(grid, 0), row(grid, 1)
    height = p[1] - corner[1]
    u, v = p[0] + cell[1] * height - corner[0], p[2] + cell[2] * height - corner[2]
    return vec3(u / cell[0], v / cell[0], height)


@ti.kernel
def cast(
    grid: Array2, x: Array2, faces: Index2, kind: Index1, absorb: Array2, place: Array2, heights: Array2, sums: Sums
):
    """The lowest height [m] of the faces over each cell and the counts of absorption, (CELLS, CELLS, 3). absorb (kinds,
    3) [1/m] of the kind of each face."""
    ti.loop_config(block_dim=512)
    for i, j in ti.ndrange(CELLS, CELLS):
        heights[i, j] = NOTHING
        for k in ti.static(range(3)):
            sums[i, j, k] = 0
    ti.loop_config(block_dim=512)
    for i in range(x.shape[0]):
        put(place, i, footprint(grid, row(x, i)))
    ti.loop_config(block_dim=64)
    for t in range(faces.shape[0]):
        corner = corners(place, faces, t)
        turn = doubled_area(corner)
        high = ti.max(corner[0, 2], corner[1, 2], corner[2, 2])
        if ti.abs(turn) > 1e-9 and high > 0.0:
            height = ti.max((corner[0, 2] + corner[1, 2] + corner[2, 2]) / 3.0, 0.0)
            counts = ti.cast(ti.min(height * row(absorb, kind[t]), 1e4) / COUNT, ti.i32)
            low = ti.min(corner[0, 1], corner[1, 1], corner[2, 1])
            first = int(ti.ceil(ti.math.clamp(low - 0.5, 0.0, 1e6)))
            low = ti.max(corner[0, 1], corner[1, 1], corner[2, 1])
            last = int(ti.ceil(ti.math.clamp(low - 0.5, -1.0, float(CELLS))))
            for v in range(first, last):
                columns = span(corner, v + 0.5, CELLS)
                for u in range(columns[0], columns[1]):
                    ti.atomic_min(heights[v, u], height)
                    for k in ti.static(range(3)):
                        ti.atomic_add(sums[v, u, k], ti.select(turn < 0.0, counts[k], -counts[k]))


@ti.kernel
def open_cells(grid: Array2, heights: Array2, sums: Sums, cells: Colors):
    """Each cell's (cover, height, tint): what a blur starts from."""
    for i, j in ti.ndrange(CELLS, CELLS):
        cover = ti.select(heights[i, j] < NOTHING, 1.0, 0.0)
        cells[i, j, 0], cells[i, j, 1] = cover, ti.min(heights[i, j], 1e3) * cover
        for k in ti.static(range(3)):
            cells[i, j, 2 + k] = cover * ti.exp(-0.5 * COUNT * ti.abs(ti.cast(sums[i, j, k], ti.f32)))


@ti.kernel
def blur(grid: Array2, cells: Colors, out: Colors):
    """One axis of a blur that reaches farther for higher casters, with the axes swapped: twice is a whole blur."""
    ti.loop_config(block_dim=32)
    for i, j in ti.ndrange(CELLS, CELLS):
        sum = ti.Vector([0.0] * 5)
        for k in range(ti.max(i - TAPS, 0), ti.min(i + TAPS + 1, CELLS)):
            cover = cells[k, j, 0]
            if cover > 0.0:
                height = cells[k, j, 1] / cover
                near = 1.0 / ti.min(4.5 + 0.30 * height / grid[1, 0], TAPS + 0.5)
                away = (k - i) * near
                weight = 0.75 * near * ti.max(1.0 - away * away, 0.0)
                for m in ti.static(range(5)):
                    sum[m] += weight * cells[k, j, m]
        for m in ti.static(range(5)):
            out[j, i, m] = sum[m]


@ti.kernel
def finish(grid: Array2, cells: Colors, light: Colors):
    """How much light reaches each cell, (CELLS, CELLS, 3), and the casters' mean height there."""
    for i, j in ti.ndrange(CELLS, CELLS):
        cover, rest = ti.min(cells[i, j, 0], 1.0), row(grid, 2)
        safe = ti.max(cells[i, j, 0], 1e-6)
        height = cells[i, j, 1] / safe
        touch = cover * ti.exp(-rest[0] * height) * TOUCH
        faint = cover / (1.0 + 0.08 * rest[0] * height)
        for k in ti.static(range(3)):
            through = cells[i, j, 2 + k] / safe * (0.25 + rest[2] * cover**3)
            left = 1.0 - faint + faint * through
            light[i, j, k] = (rest[1] + (1.0 - rest[1]) * left) * (1.0 - touch * (1.0 - 0.6 * ti.min(through, 1.0)))
        light[i, j, 3] = ti.select(cover > 0.01, height, -1.0)


@ti.func
def light_at(grid: ti.template(), light: ti.template(), p):
    """What shadows leave of the light at p, (3,): all of it outside the grid and above the casters."""
    place, left = footprint(grid, p), vec3(1.0)
    u, v = place[0] - 0.5, place[1] - 0.5
    if u >= 0.0 and v >= 0.0 and u < CELLS - 1 and v < CELLS - 1:
        i, j = int(v), int(u)
        a, b = v - i, u - j
        if light[i, j, 3] >= place[2] - grid[1, 0]:  # a cell's width: bodies rest on solids and sink in a little
            for k in ti.static(range(3)):
                low = ti.math.mix(light[i, j, k], light[i, j + 1, k], b)
                left[k] = ti.math.mix(low, ti.math.mix(light[i + 1, j, k], light[i + 1, j + 1, k], b), a)
    return left


class Shadow:
    """Light (CELLS, CELLS, 4) that the casters leave, over `grid`."""

    def __init__(self, size: float, extent: float, solid: bool = False):
        """size: of the studio, extent: of the casters at rest [m]."""
        self.size, self.cell = size, max(extent, 1e-6) / ACROSS
        self.rest = [30.0 / size, SOLID_OPEN if solid else OPEN, 0.0 if solid else GATHERED]
        self.grid = np.zeros((3, 3), np.float32)
        self.light = np.ones((CELLS, CELLS, 4), np.float32)
        self._heights = np.zeros((CELLS, CELLS), np.float32)
        self._sums = np.zeros((CELLS, CELLS, 3), np.int32)
        self._cells = [np.zeros((CELLS, CELLS, 5), np.float32) for _ in range(2)]
        self._place = np.zeros((0, 3), np.float32)

    def update(self, x: np.ndarray, faces: np.ndarray, kind: np.ndarray, absorb: np.ndarray, floor: float) -> None:
        """From casters' points x (N, 3), triangles faces (T, 3) and what each absorbs, absorb[kind] [1/m]."""
        if len(self._place) != len(x):
            self._place = np.zeros((len(x), 3), np.float32)
        corner, cell = self._frame(x, floor)
        self.grid[:] = [[corner[0], floor, corner[1]], [cell, *BEAM], self.rest]
        cast(self.grid, x, faces, kind, absorb, self._place, self._heights, self._sums)
        open_cells(self.grid, self._heights, self._sums, self._cells[0])
        blur(self.grid, *self._cells)
        blur(self.grid, *reversed(self._cells))
        finish(self.grid, self._cells[0], self.light)

    def _frame(self, x: np.ndarray, floor: float) -> tuple[np.ndarray, float]:
        """The grid's corner (x, z) and its cell [m]: whole cells, so that a shadow does not shimmer."""
        foot = x[:, ::2] + (x[:, 1:2] - floor) * BEAM.astype(np.float32)
        if not np.isfinite(foot.sum()):
            foot = foot[np.isfinite(foot).all(1)]
        if not len(foot):
            return np.zeros(2), self.cell
        low, high = foot.min(0).astype(float), foot.max(0).astype(float)
        room = CELLS - 2 * TAPS - 2
        doublings = np.ceil(np.log2(max(float((high - low).max()) / (room * self.cell), 1.0)))
        cell = self.cell * 2.0**doublings
        return (np.floor(0.5 * (low + high) / cell) - CELLS // 2) * cell, cell

    def outline(self) -> np.ndarray:
        """(4, 3) [m]: the corners of the part of the floor that it darkens; none where there is no shadow."""
        shaded = self.light[..., 3] >= 0.0
        if not shaded.any():
            return np.zeros((0, 3), np.float32)
        v, u = np.flatnonzero(shaded.any(1)), np.flatnonzero(shaded.any(0))
        x = self.grid[0, 0] + self.grid[1, 0] * np.array([u[0] - 1, u[-1] + 2])
        z = self.grid[0, 2] + self.grid[1, 0] * np.array([v[0] - 1, v[-1] + 2])
        return np.array([[a, self.grid[0, 1], b] for a in x for b in z], np.float32)
