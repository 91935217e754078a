"""The energies of the last seconds as lines in a corner of the window."""

from collections.abc import Sequence

import numpy as np

from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.springs import round_up
from taichi_jello.view.render.legend import MARGIN, TEXT, Sheet
from taichi_jello.view.render.strokefont import text_width
from taichi_jello.view.window.readouts import ENERGIES, SPAN

SIZE = (300.0, 120.0)  # of the axes, in pixels of a picture 720 rows high
COLORS = (palette.FORCE_RAMP[-1], palette.FAMILIES[0], palette.FAMILIES[2])


def plot(sheet: Sheet, past: Sequence[tuple[float, ...]]) -> None:
    """Lines of kinetic, elastic and gravity energy in the lower right corner, above the time."""
    s = min(sheet.scale, sheet.size[0] / 760.0)
    height, margin = 0.8 * TEXT * s, MARGIN * s
    width, tall = SIZE[0] * s, SIZE[1] * s
    right, bottom = sheet.size[0] - margin, sheet.size[1] - MARGIN * sheet.scale - 3.0 * TEXT * sheet.scale
    left, top = right - width, bottom - tall
    sheet.quad(left - 12.0 * s, top - 30.0 * s, width + 24.0 * s, tall + 40.0 * s, palette.PAPER)
    rows = np.array(past, float).reshape(-1, 1 + len(ENERGIES))
    most = round_up(float(np.abs(rows[:, 1:]).max(initial=1e-9)))
    least = -most if rows[:, 1:].min(initial=0.0) < -0.02 * most else 0.0
    zero = bottom + least / (most - least) * tall
    sheet.line(np.array([[left, zero], [right, zero]]), 2.0 * s, palette.GRID)
    sheet.line(np.array([[left, top], [right, top]]), 2.0 * s, palette.GRID)
    sheet.text(f"{most:g} J", left, top - 11.0 * s, height, palette.EDGE)
    pen = right
    for name, rgb in reversed(list(zip(ENERGIES, COLORS, strict=True))):
        sheet.text(name, pen, top - 11.0 * s, height, rgb, align=1.0)
        pen -= text_width(name, height) + 12.0 * s
    if len(rows) > 1:
        x = right - (rows[-1, 0] - rows[:, 0]) / SPAN * width
        for column, rgb in enumerate(COLORS, 1):
            y = bottom - (rows[:, column] - least) / (most - least) * tall
            sheet.line(np.stack([x, y], 1), 1.7 * s, rgb)
