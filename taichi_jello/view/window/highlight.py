"""What made the numbers go bad, marked in the picture: a spring as a thick bright line, a particle in a ring."""

import numpy as np

from taichi_jello.run.find_culprit import Culprit
from taichi_jello.view.camera import Viewpoint
from taichi_jello.view.drawing import palette
from taichi_jello.view.render.legend import Sheet
from taichi_jello.view.window.hand import RING


def highlight(sheet: Sheet, culprit: Culprit, x: np.ndarray, viewpoint: Viewpoint) -> None:
    """Mark it with the particles at x (N, 3) [m], and say what it is."""
    s = sheet.scale
    sheet.text(culprit.told, 28.0 * s, 82.0 * s, 10.0 * s, palette.ALARM)
    ends = viewpoint.project(x[list(culprit.particles)].astype(float), sheet.size)
    if not np.isfinite(ends).all():
        return
    circle = np.stack([np.cos(RING), np.sin(RING)], 1) * 9.0 * s
    lines = [end + circle for end in ends] + ([ends] if len(ends) > 1 else [])
    for width, rgb in ((9.0, palette.PAPER), (5.0, palette.ALARM)):  # on a pale rim it shows on whatever is behind
        for line in lines:
            sheet.line(line, width * s, rgb)
