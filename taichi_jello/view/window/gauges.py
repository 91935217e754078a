"""Live measurements for the window: recent energies and the largest spring force."""

import time
from collections import deque
from collections.abc import Sequence

import numpy as np

from taichi_jello.physics.forces.springs.spring_state import springs_at
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.scale import round_up
from taichi_jello.view.drawing.springs import spring_forces
from taichi_jello.view.render.legend import MARGIN, TEXT, Sheet
from taichi_jello.view.render.renderers import Run
from taichi_jello.view.render.strokefont import text_width

SPAN = 5.0  # s of history
REST_FACTOR = 10.0  # pause between two force measurements, as a multiple of the duration of one
ENERGIES = ("kinetic", "elastic", "gravity")
COLORS = (palette.FORCE_RAMP[-1], palette.FAMILIES[0], palette.FAMILIES[2])  # of the energy curves
PLOT, SCALE = (300.0, 120.0), 66.0  # size of the plot, and width of its labels, in pixels of a picture 720 rows high


class Gauges:
    """past: rows of time [s] and the ENERGIES [J], the oldest first; force: the largest spring force [N]; ledger: total
    work and residual [J], if the simulation keeps one."""

    def __init__(self) -> None:
        self.past: deque[tuple[float, ...]] = deque()
        self.force = 0.0
        self.ledger: tuple[float, float] | None = None
        self._next = 0.0

    def read(self, simulation: Run, x: np.ndarray, v: np.ndarray) -> None:
        """Measure at positions x [m] and velocities v [m/s], once per moment."""
        now = simulation.time
        if self.past and self.past[-1][0] == now:
            return
        if self.past and now < self.past[-1][0]:
            self.past.clear()
        energies = simulation.energies()
        self.past.append((now, *(energies[name] for name in ENERGIES)))
        if simulation.keeps_ledger:
            self.ledger = sum(simulation.work.values()), simulation.energy_residual
        while now - self.past[0][0] > SPAN:
            self.past.popleft()
        start = time.perf_counter()
        if start >= self._next:  # with many springs this takes longer than drawing
            self.force = largest_force(simulation, x, v)
            end = time.perf_counter()
            self._next = end + REST_FACTOR * (end - start)


def largest_force(simulation: Run, x: np.ndarray, v: np.ndarray) -> float:
    """The largest force of all springs [N]."""
    body, tuning = simulation.body, simulation.tuning
    if not len(body.springs):
        return 0.0
    i, j = body.springs.T
    state = springs_at(simulation.scene, body, simulation.time, simulation.snapshot().memory)
    stiffness, damping = (tuning.get(name, 1.0) * getattr(state, name) for name in ("stiffness", "damping"))
    return float(spring_forces(x[j] - x[i], v[j] - v[i], state.rest_length, stiffness, damping).max())


def plot(sheet: Sheet, past: Sequence[tuple[float, ...]]) -> None:
    """Plot the energies over time in the lower right corner, above the clock."""
    s = min(sheet.scale, sheet.size[0] / 760.0)
    height, margin = 0.8 * TEXT * s, MARGIN * s
    width, tall = PLOT[0] * s, PLOT[1] * s
    right = sheet.size[0] - margin - 18.0 * s
    bottom = sheet.size[1] - MARGIN * sheet.scale - 3.0 * TEXT * sheet.scale - 12.0 * s
    left, top = right - width, bottom - tall
    edge = left - SCALE * s  # of the axis labels
    sheet.quad(edge - 8.0 * s, top - 36.0 * s, right - edge + 26.0 * s, tall + 64.0 * s, palette.PAPER)
    times, *energies = np.array(past, float).reshape(-1, 1 + len(ENERGIES)).T
    most = round_up(float(np.abs(energies).max(initial=1e-9)))
    least = -most if np.min(energies, initial=0.0) < -0.02 * most else 0.0
    for level in sorted({least, 0.0, 0.5 * most, most}):
        y = bottom - (level - least) / (most - least) * tall
        sheet.line(np.array([[left, y], [right, y]]), s, palette.GRID)
        sheet.text(f"{level:g}", left - 7.0 * s, y + 0.5 * height, height, align=1.0)
    for k in range(int(SPAN) + 1):
        column = right - k / SPAN * width
        sheet.line(np.array([[column, bottom], [column, bottom + 5.0 * s]]), s, palette.GRID)
        sheet.text(f"-{k} s" if k else "now", column, bottom + 10.0 * s + height, height, align=0.5)
    sheet.text("J", left - 7.0 * s, top - 18.0 * s, height, align=1.0)
    x = right
    for name, rgb in zip(reversed(ENERGIES), reversed(COLORS), strict=True):
        sheet.text(name, x, top - 18.0 * s, height, rgb, align=1.0)
        x -= text_width(name, height) + 12.0 * s
    if len(times) > 1:
        columns = right - (times[-1] - times) / SPAN * width
        for joules, rgb in zip(energies, COLORS, strict=True):
            rows = bottom - (joules - least) / (most - least) * tall
            sheet.line(np.stack([columns, rows], 1), 1.7 * s, rgb)
