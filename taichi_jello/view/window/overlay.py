"""The overlay of the window: legend, status, grabbed point, energies, what diverged, and help."""

from dataclasses import replace

import numpy as np

from taichi_jello.physics.forces.grab import Held
from taichi_jello.run.find_culprit import Culprit
from taichi_jello.view.camera import Viewpoint
from taichi_jello.view.drawing import palette
from taichi_jello.view.render.legend import MARGIN, TEXT, Sheet, legend
from taichi_jello.view.window.actions import HELP
from taichi_jello.view.window.gauges import plot
from taichi_jello.view.window.viewer import Viewer

ANGLES = np.linspace(0.0, 2.0 * np.pi, 25)
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES)], 1)
CROSS = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
SMALL = 10.0  # cap height of small text
RIM = 0.34  # width of the pale outline around text, as a fraction of the cap height


def overlay(viewer: Viewer) -> Sheet:
    """The complete overlay for the viewer's window."""
    sheet = legend(viewer.drawing.key, viewer.simulation.time, viewer.size)
    s = sheet.scale
    for k, words in enumerate((state(viewer), pace(viewer))):
        sheet.text(words, viewer.size[0] - MARGIN * s, (40.0 + 22.0 * k) * s, (TEXT, SMALL)[k] * s, align=1.0)
    if viewer.helping:
        write_title(sheet, viewer)
        write_help(sheet)
        return sheet
    write_title(sheet, viewer, viewer.notice or "H: help", palette.INK)
    held = viewer.simulation.held if viewer.grabbed is not None or viewer.replay else None
    if held is not None:
        mark_grab(sheet, held, viewer.viewpoint)
    if viewer.culprit is not None:
        mark_culprit(sheet, viewer.culprit, viewer.simulation.snapshot().x, viewer.viewpoint)
    # A pale outline keeps text readable over a jello of any colour.
    sheet.texts += [replace(text, pen=text.pen + RIM, rgb=palette.PAPER) for text in sheet.texts]
    if viewer.panelled:
        plot(sheet, viewer.gauges.past)
    return sheet


def write_title(sheet: Sheet, viewer: Viewer, below: str = "", rgb: np.ndarray = palette.INK) -> None:
    """The scene's title, and a line below it."""
    s = sheet.scale
    sheet.text(viewer.simulation.scene.title or "jello", MARGIN * s, 40.0 * s, TEXT * s)
    if below:
        sheet.text(below, MARGIN * s, 62.0 * s, SMALL * s, rgb)


def state(viewer: Viewer) -> str:
    """The status line: method, frame rate, and whether it is filming, replaying, paused or unsafe."""
    words = f"{viewer.simulation.method}   {viewer.rate:.0f} fps" + ("   filming" if viewer.filming else "")
    if viewer.replay:
        words += f"   replay {viewer.replay.frames} / {viewer.replay.length}"
    return words + ("   paused" if viewer.paused else "") + ("   unsafe step" if viewer.unsafe else "")


def pace(viewer: Viewer) -> str:
    """The speed of time if it is not real time: requested slow or fast motion, or a machine that is too slow."""
    asked, speed = viewer.pace.scale, viewer.pace.speed
    words = []
    if asked != 1.0:
        words.append(f"{'slow' if asked < 1.0 else 'fast'} motion x {asked:.2f}; R: real time")
    if not viewer.paused and not viewer.filming and abs(speed - asked) > 0.05 * max(asked, 0.5):
        words.append(f"real time x {speed:.2f}")
    return "   ".join(words)


def mark_grab(sheet: Sheet, held: Held, viewpoint: Viewpoint) -> None:
    """Mark the grabbed point, its target and the force; GGUI hides the cursor while a button is down."""
    point, target = viewpoint.project(np.stack([held.point, held.target]), sheet.size)
    if not np.isfinite([point, target]).all():
        return
    s = sheet.scale
    lines = [np.stack([point, target]), point + 5.0 * s * CIRCLE, target + 10.0 * s * CIRCLE, target + 5.0 * s * CROSS]
    draw_rimmed(sheet, lines, 5.0, 2.0, palette.INK)
    x = min(target[0] + 18.0 * s, sheet.size[0] - 70.0 * s)
    sheet.text(f"{np.linalg.norm(held.force):.3g} N", x, target[1] - 12.0 * s, 13.0 * s)


def mark_culprit(sheet: Sheet, culprit: Culprit, x: np.ndarray, viewpoint: Viewpoint) -> None:
    """Mark what diverged, given all positions x (N, 3) [m]: a spring with a thick line, a particle with a ring."""
    s = sheet.scale
    sheet.text(culprit.words, MARGIN * s, 82.0 * s, SMALL * s, palette.ALARM)
    ends = viewpoint.project(x[list(culprit.particles)].astype(float), sheet.size)
    if np.isfinite(ends).all():
        lines = [end + 9.0 * s * CIRCLE for end in ends] + ([ends] if len(ends) > 1 else [])
        draw_rimmed(sheet, lines, 9.0, 5.0, palette.ALARM)


def draw_rimmed(sheet: Sheet, lines: list[np.ndarray], rim: float, width: float, rgb: np.ndarray) -> None:
    """Draw lines with a pale outline, visible on any background."""
    for wide, color in ((rim, palette.PAPER), (width, rgb)):
        for line in lines:
            sheet.line(line, wide * sheet.scale, color)


def write_help(sheet: Sheet) -> None:
    """Draw the list of all keys on a page in the middle."""
    s = min(sheet.scale, sheet.size[0] / 740.0, sheet.size[1] / 720.0)
    width, height = 700.0 * s, (len(HELP) * 26.0 + 36.0) * s
    x, y = (sheet.size[0] - width) / 2.0, (sheet.size[1] - height) / 2.0
    sheet.quad(x, y, width, height, palette.PAPER)
    for k, (keys, meaning) in enumerate(HELP):
        line = y + (38.0 + 26.0 * k) * s
        sheet.text(keys, x + 30.0 * s, line, TEXT * s)
        sheet.text(meaning, x + 270.0 * s, line, TEXT * s)
