"""What is written over the picture in the window: the legend, the state, what is held, the energies and the help."""

from taichi_jello.view.drawing import palette
from taichi_jello.view.render.legend import Sheet, legend
from taichi_jello.view.window.actions import HELP
from taichi_jello.view.window.hand import mark
from taichi_jello.view.window.highlight import highlight
from taichi_jello.view.window.plot import plot
from taichi_jello.view.window.viewer import Viewer


def overlay(viewer: Viewer) -> Sheet:
    """The legend; at the top the state; and what is grabbed, plotted or explained."""
    sheet = legend(viewer.drawing.key, viewer.simulation.time, viewer.size)
    s = sheet.scale
    sheet.text(state(viewer), viewer.size[0] - 28.0 * s, 40.0 * s, 12.5 * s, align=1.0)
    sheet.text(viewer.simulation.scene.title or "jello", 28.0 * s, 40.0 * s, 12.5 * s)
    if viewer.helping:
        write_help(sheet)
        return sheet
    ink = palette.INK if viewer.notice else palette.EDGE
    sheet.text(viewer.notice or "H: help", 28.0 * s, 62.0 * s, 10.0 * s, ink)
    if viewer.panelled:
        plot(sheet, viewer.gauges.past)
    if viewer.culprit is not None:
        highlight(sheet, viewer.culprit, viewer.simulation.snapshot().x, viewer.viewpoint)
    held = viewer.simulation.held if viewer.hand is not None or viewer.repeating else None
    if held is not None:
        mark(sheet, held, viewer.viewpoint)
    return sheet


def state(viewer: Viewer) -> str:
    """The method, how fast it goes, and what is unusual."""
    words = f"{viewer.simulation.method}   {viewer.rate:.0f} fps" + ("   filming" if viewer.filming else "")
    if viewer.repeating:
        words += f"   replay {viewer.simulation.frames} / {viewer.simulation.length}"
    if viewer.paused:
        words += "   paused"
    elif abs(viewer.pace.speed - 1.0) > 0.05:
        words += f"   real time x {viewer.pace.speed:.2f}"
    if viewer.unsafe:
        words += "   unsafe dt"
    return words


def write_help(sheet: Sheet) -> None:
    """All keys, on a page in the middle."""
    s = min(sheet.scale, sheet.size[0] / 740.0, sheet.size[1] / 720.0)
    width, height = 700.0 * s, (len(HELP) * 26.0 + 36.0) * s
    x, y = (sheet.size[0] - width) / 2.0, (sheet.size[1] - height) / 2.0
    sheet.quad(x, y, width, height, palette.PAPER)
    for k, (keys, meaning) in enumerate(HELP):
        line = y + (38.0 + 26.0 * k) * s
        sheet.text(keys, x + 30.0 * s, line, 12.5 * s)
        sheet.text(meaning, x + 270.0 * s, line, 12.5 * s)
