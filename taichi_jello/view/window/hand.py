"""The hand that pulls a jello: it follows the cursor in the plane that faces the eye, and is drawn."""

from typing import Any

import numpy as np

from taichi_jello.view.camera import NEAR, Viewpoint
from taichi_jello.view.drawing import palette
from taichi_jello.view.picking import Pick
from taichi_jello.view.render.legend import PEN, Sheet

FARTHEST = 50.0  # m from the eye
AWAY = 2.0  # e-folds of the distance for a drag over the window's whole height
RING = np.linspace(0.0, 2.0 * np.pi, 25)


class Hand:
    """Holds a simulation's jello from when it is made until let_go."""

    def __init__(self, simulation: Any, pick: Pick):
        self.simulation = simulation
        self.target = np.array(pick.point, float)
        simulation.grab(pick.particles, pick.weights, self.target)

    def move(self, viewpoint: Viewpoint, right: float, up: float, away: bool = False) -> None:
        """The cursor moved by these fractions of the window's height; away: along the line of sight instead."""
        arm = self.target - viewpoint.eye
        axes = viewpoint.axes()
        if away:
            far = float(np.linalg.norm(arm))
            wanted = far * np.exp(np.clip(AWAY * up, -50.0, 50.0))
            arm *= float(np.clip(wanted, 2.0 * NEAR, FARTHEST)) / far
        else:
            arm += (right * axes[0] + up * axes[1]) * -(arm @ axes[2]) / viewpoint.pixels_per_meter(1)
        self.target = viewpoint.eye + arm
        self.simulation.move_grab(self.target)

    def let_go(self) -> None:
        self.simulation.release()


def mark(sheet: Sheet, held: Any, viewpoint: Viewpoint) -> None:
    """The point that is held, the place it is pulled to, a line between and the force: the cursor itself is hidden
    while its button is down."""
    point, target = viewpoint.project(np.stack([held.point, held.target]), sheet.size)
    if not np.isfinite([point, target]).all():
        return
    s = sheet.scale
    circle = np.stack([np.cos(RING), np.sin(RING)], 1) * s
    cross = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 0.0], [0.0, -1.0], [0.0, 1.0]]) * 5.0 * s
    for width, rgb in ((5.0, palette.PAPER), (2.0, palette.INK)):  # ink on a pale rim shows on whatever is behind
        for line in (np.stack([point, target]), point + 5.0 * circle, target + 10.0 * circle, target + cross):
            sheet.line(line, width * s, rgb)
    force = float(np.linalg.norm(held.force))
    x = min(target[0] + 18.0 * s, sheet.size[0] - 70.0 * s)
    for pen, rgb in ((0.45, palette.PAPER), (PEN, palette.INK)):
        sheet.text(f"{force:.3g} N", x, target[1] - 12.0 * s, 13.0 * s, rgb, pen=pen)
