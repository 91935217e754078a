"""The window itself: GGUI's events turned into what a Viewer understands, and its sheet drawn over the
picture."""

import numpy as np
import taichi as ti
from taichi.ui.utils import get_field_info

from taichi_jello.view.ggui import ROW, Ggui
from taichi_jello.view.legend import PEN, Sheet, legend
from taichi_jello.view.strokefont import strokes
from taichi_jello.view.viewer import Viewer

BUTTONS = {ti.ui.LMB: "left", ti.ui.RMB: "right", ti.ui.MMB: "middle"}


class Screen:
    """One window of `size` (width, height) [pixels]. Raises RuntimeProblem where none can be opened."""

    def __init__(self, size: tuple[int, int], title: str):
        self._renderer = Ggui(size, samples=1, window=True, title=title)
        self._window = self._renderer.window
        self._cursor: tuple[float, float] | None = None

    @property
    def running(self) -> bool:
        """False once the person has closed the window."""
        return bool(self._window.running)

    def listen(self, viewer: Viewer) -> None:
        """Pass on the keys pressed and the drag made since the last call."""
        for event in self._window.get_events(ti.ui.PRESS):
            viewer.handle_key(event.key)
        self._window.get_events(ti.ui.RELEASE)
        at = self._window.get_cursor_pos()
        held = [name for button, name in BUTTONS.items() if self._window.is_pressed(button)]
        if held and self._cursor is not None:
            width, height = self._window.get_window_shape()
            right, up = (at[0] - self._cursor[0]) * width / height, at[1] - self._cursor[1]
            if right or up:
                viewer.drag(held[0], right, up)
        self._cursor = at if held else None

    def show(self, viewer: Viewer, rate: float) -> None:
        """Draw the viewer's drawing and sheet; a picture that was asked for holds the legend, but no state or
        help."""
        size = self._window.get_window_shape()
        if viewer.photo:
            self._renderer.draw(viewer.drawing, viewer.viewpoint)
            image = self._renderer.image()
            legend(viewer.drawing.key, viewer.simulation.time, size).stamp(image)
            viewer.save(image)
        self._renderer.draw(viewer.drawing, viewer.viewpoint)
        self._write(viewer.sheet(size, rate))
        self._window.show()

    def close(self) -> None:
        self._renderer.close()

    def _write(self, sheet: Sheet) -> None:
        self._keep = [_rectangles(sheet)] if sheet.quads else []
        canvas, none = self._renderer.canvas.canvas, get_field_info(None)
        for rows in self._keep:
            canvas.triangles(get_field_info(rows), none, True, (1.0, 1.0, 1.0))
        for height in sorted({text.height for text in sheet.texts}):
            rows = _pen_strokes(sheet, height)
            self._keep.append(rows)
            width = max(PEN * height, 1.3) / sheet.size[1]
            canvas.lines(get_field_info(rows), none, True, (1.0, 1.0, 1.0), width)


def _rows(points: np.ndarray, colors: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """GGUI's vertex rows for points (n, 2) in pixels, y down."""
    rows = np.zeros((len(points), ROW), np.float32)
    rows[:, :2] = points / size
    rows[:, 1] = 1.0 - rows[:, 1]
    rows[:, 8:11], rows[:, 11] = colors, 1.0
    return rows


def _rectangles(sheet: Sheet) -> np.ndarray:
    points, colors = [], []
    for q in sheet.quads:
        right, bottom = q.x + q.width, q.y + q.height
        points += [(q.x, q.y), (q.x, bottom), (right, bottom), (q.x, q.y), (right, bottom), (right, q.y)]
        colors += [q.left, q.left, q.right, q.left, q.right, q.right]
    return _rows(np.array(points), np.array(colors), sheet.size)


def _pen_strokes(sheet: Sheet, height: float) -> np.ndarray:
    points, colors = [np.zeros((0, 2))], [np.zeros((0, 3))]
    for text in sheet.texts:
        if text.height == height:
            points.append(strokes(text.words, text.x, text.y, height).reshape(-1, 2))
            colors.append(np.tile(text.rgb, (len(points[-1]), 1)))
    return _rows(np.concatenate(points), np.concatenate(colors), sheet.size)
