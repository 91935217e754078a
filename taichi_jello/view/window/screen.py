"""The window: passes GGUI's events to a Viewer and draws what it shows."""

from collections.abc import Callable

import numpy as np
import taichi as ti
from taichi.ui.utils import get_field_info

from taichi_jello.view.drawing import palette
from taichi_jello.view.render.display import DisplayGuard
from taichi_jello.view.render.ggui import COLOR, WHITE, Ggui, require, vertices
from taichi_jello.view.render.legend import Line, Quad, Sheet, Text, legend
from taichi_jello.view.render.renderers import chosen
from taichi_jello.view.window.overlay import overlay, write_title
from taichi_jello.view.window.painter import Painter
from taichi_jello.view.window.panel import Panel
from taichi_jello.view.window.viewer import Viewer

BUTTONS = {ti.ui.LMB: "left", ti.ui.RMB: "right", ti.ui.MMB: "middle"}


class Screen:
    """One window of `size` (width, height) [pixels]. Raises RuntimeProblem if none can be opened. If the display is
    lost, the process exits with a one-line message, to which `keep` adds what it saved. renderer: see `chosen`. With
    the rasteriser, GGUI only displays the finished picture; GGUI's own drawing leaks up to a megabyte per frame on
    Mesa's software driver."""

    def __init__(self, size: tuple[int, int], title: str, keep: Callable[[], str] = str, renderer: str = "auto"):
        require(window=True)
        self._painter = Painter() if chosen(renderer) == "raster" else None
        self._keep = keep
        self._guard = DisplayGuard(self._on_loss)
        self._renderer = Ggui(size, samples=1, window=True, title=title)
        self._window = self._renderer.window
        self._panel = Panel(size)
        self._stale = 0  # calls of listen() that still receive keys pressed during slow work

    def _on_loss(self) -> str:
        self._renderer.remove_folder()
        return self._keep()

    @property
    def running(self) -> bool:
        """False once the user has closed the window."""
        return bool(self._window.running)

    def listen(self, viewer: Viewer) -> None:
        """Pass key and mouse events since the last call to the viewer."""
        viewer.size = width, height = self._window.get_window_shape()
        right, up = self._window.get_cursor_pos()
        at = (right * width, (1.0 - up) * height)
        stale, self._stale = self._stale > 0, max(self._stale - 1, 0)
        for event in self._window.get_events(ti.ui.PRESS):
            if stale and event.key != ti.ui.ESCAPE:
                continue
            if event.key not in BUTTONS:
                viewer.handle_key(event.key)
            elif not self._panel.takes(at):
                viewer.press(BUTTONS[event.key], at)
        self._window.get_events(ti.ui.RELEASE)  # discarded: GGUI may report a release before its press
        viewer.move(at, in_depth=self._window.is_pressed(ti.ui.SHIFT))
        for button, name in BUTTONS.items():
            if not self._window.is_pressed(button):
                viewer.release(name)
        if not self._window.is_pressed(ti.ui.LMB):
            self._panel.release()

    def forget_keys(self) -> None:
        """Ignore keys pressed until now, except Esc. GGUI delivers them after the next show()."""
        self._stale = 2

    def show(self, viewer: Viewer) -> None:
        """Draw the scene, the overlay and the panel. Saved pictures get the legend but not the rest of the overlay."""
        self._draw(viewer)
        if viewer.wants_picture or viewer.filming:
            if self._painter is None:
                image = self._renderer.image()
                self._draw(viewer)  # reading the picture back has ended GGUI's frame
            else:
                image = self._painter.image(viewer)
            legend(viewer.drawing.key, viewer.simulation.time, viewer.size).stamp(image)
            viewer.take(image)
        sheet = overlay(viewer)
        if self._painter is None:
            self._write(sheet)
        else:
            self._shown = self._painter.under(sheet)  # GGUI reads it in show()
            self._renderer.canvas.canvas.set_image(get_field_info(self._shown))
        self._panel.show(self._window.get_gui(), viewer)
        self._flip()

    def _draw(self, viewer: Viewer) -> None:
        if self._painter is None:
            self._renderer.draw(viewer.drawing, viewer.viewpoint)
        else:
            self._painter.draw(viewer, finest=viewer.wants_picture)

    def write_alone(self, viewer: Viewer, words: str) -> None:
        """Show only the title and a message, before the first picture is ready."""
        sheet = Sheet(viewer.size)
        sheet.quad(0.0, 0.0, *viewer.size, palette.SKY_LOW)
        write_title(sheet, viewer, words)
        self._write(sheet)
        self._flip()

    def _flip(self) -> None:
        with self._guard.quiet():
            self._renderer.show()

    def close(self) -> None:
        self._renderer.close()
        self._guard.close()

    def _write(self, sheet: Sheet) -> None:
        self._rows = [_quad_rows(sheet.quads, sheet.size)] if sheet.quads else []  # GGUI reads them in show()
        canvas, none = self._renderer.canvas.canvas, get_field_info(None)
        for rows in self._rows:
            canvas.triangles(get_field_info(rows), none, True, WHITE)
        strokes: list[Line | Text] = [*sheet.lines, *sheet.texts]
        for width in sorted({stroke.width for stroke in strokes}, reverse=True):
            rows = _stroke_rows([stroke for stroke in strokes if stroke.width == width], sheet.size)
            self._rows.append(rows)
            canvas.lines(get_field_info(rows), none, True, WHITE, width / sheet.size[1])


def _rows(points: np.ndarray, colors: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """GGUI's vertices for points (n, 2) [pixels], y down."""
    rows = vertices(len(points))
    rows[:, :2] = points / size
    rows[:, 1] = 1.0 - rows[:, 1]
    rows[:, COLOR] = colors
    return rows


def _quad_rows(quads: list[Quad], size: tuple[int, int]) -> np.ndarray:
    points, colors = [], []
    for q in quads:
        right, bottom = q.x + q.width, q.y + q.height
        points += [(q.x, q.y), (q.x, bottom), (right, bottom), (q.x, q.y), (right, bottom), (right, q.y)]
        colors += [q.left, q.left, q.right, q.left, q.right, q.right]
    return _rows(np.array(points), np.array(colors), size)


def _stroke_rows(strokes: list[Line | Text], size: tuple[int, int]) -> np.ndarray:
    points = [stroke.segments().reshape(-1, 2) for stroke in strokes]
    colors = [np.tile(stroke.rgb, (len(part), 1)) for stroke, part in zip(strokes, points, strict=True)]
    return _rows(np.concatenate(points), np.concatenate(colors), size)
