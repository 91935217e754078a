"""The window itself: GGUI's events turned into what a Viewer understands, and what is written drawn
over the picture."""

from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti
from taichi.ui.utils import get_field_info

from taichi_jello.support import runtime
from taichi_jello.view.drawing import palette
from taichi_jello.view.render.ggui import ROW, Ggui, require, screen_is_gone
from taichi_jello.view.render.legend import Sheet, legend
from taichi_jello.view.render.raster import Raster
from taichi_jello.view.window.display_lost import LastWords
from taichi_jello.view.window.overlay import overlay
from taichi_jello.view.window.panel import Panel
from taichi_jello.view.window.viewer import Viewer

BUTTONS = {ti.ui.LMB: "left", ti.ui.RMB: "right", ti.ui.MMB: "middle"}


class Painter:
    """Puts a drawing into the window of a Ggui.

    Mesa's software driver keeps up to a megabyte of every frame that it draws in three dimensions until the window
    closes, tens of gigabytes in half an hour. There the rasteriser draws, and GGUI shows its picture."""

    def __init__(self, renderer: Ggui):
        self._ggui = renderer
        software = not runtime.has_real_vulkan() and runtime.current().arch not in ("vulkan", "metal")
        self._raster = Raster(renderer.size, samples=1) if software else None

    def draw(self, viewer: Viewer) -> None:
        if self._raster is None:
            self._ggui.draw(viewer.drawing, viewer.viewpoint)
            return
        if self._raster.size != viewer.size:
            self._raster = Raster(viewer.size, samples=1)
        self._raster.draw(viewer.drawing, viewer.viewpoint)
        self._shown = self._raster.columns()  # GGUI reads it when the picture is shown
        self._ggui.canvas.canvas.set_image(get_field_info(self._shown))

    def image(self, viewer: Viewer) -> np.ndarray:
        """(height, width, 3) uint8: what was drawn last, which stays to be shown."""
        if self._raster is not None:
            return self._raster.image()
        image = self._ggui.image()
        self._ggui.draw(viewer.drawing, viewer.viewpoint)  # reading the picture back has ended it
        return image


class Screen:
    """One window of `size` (width, height) [pixels]. Raises RuntimeProblem where none can be opened. If it is lost,
    `keep` is called, and the process ends with what it says."""

    def __init__(self, size: tuple[int, int], title: str, keep: Callable[[], str] = str):
        require(window=True)
        self._keep = keep
        self._last_words = LastWords(self._lost, screen_is_gone)
        self._renderer = Ggui(size, samples=1, window=True, title=title)
        self._painter = Painter(self._renderer)
        self._window = self._renderer.window
        self._panel = Panel(size)

    def _lost(self) -> str:
        self._renderer.leave_desk()
        return self._keep()

    @property
    def running(self) -> bool:
        """False once the person has closed the window."""
        return bool(self._window.running)

    def listen(self, viewer: Viewer) -> None:
        """Pass on the keys pressed and what the mouse did since the last call."""
        viewer.size = width, height = self._window.get_window_shape()
        across, up = self._window.get_cursor_pos()
        at = (across * width, (1.0 - up) * height)
        for event in self._window.get_events(ti.ui.PRESS):
            if event.key not in BUTTONS:
                viewer.handle_key(event.key)
            elif not self._panel.takes(at):
                viewer.press(BUTTONS[event.key], at)
        self._window.get_events(ti.ui.RELEASE)  # what is down counts: a release may come before its press here
        viewer.move(at, away=self._window.is_pressed(ti.ui.SHIFT))
        for button, name in BUTTONS.items():
            if not self._window.is_pressed(button):
                viewer.release(name)
        if not self._window.is_pressed(ti.ui.LMB):
            self._panel.release()

    def show(self, viewer: Viewer) -> None:
        """Draw the viewer's drawing, what is written over it and the panel; pictures that were asked for hold the
        legend, but no state or help."""
        self._painter.draw(viewer)
        if viewer.pictures.asked or viewer.filming:
            image = self._painter.image(viewer)
            legend(viewer.drawing.key, viewer.simulation.time, viewer.size).stamp(image)
            viewer.take(image)
        self._write(overlay(viewer))
        self._panel.show(self._window.get_gui(), viewer)
        with self._last_words.hushed():
            self._renderer.show()

    def tell(self, viewer: Viewer, words: str) -> None:
        """These words alone, before anything is drawn."""
        sheet = Sheet(viewer.size)
        sheet.quad(0.0, 0.0, *viewer.size, palette.SKY_LOW)
        sheet.text(viewer.simulation.scene.title or "jello", 28.0 * sheet.scale, 40.0 * sheet.scale, 12.5 * sheet.scale)
        sheet.text(words, 28.0 * sheet.scale, 62.0 * sheet.scale, 10.0 * sheet.scale)
        self._write(sheet)
        with self._last_words.hushed():
            self._renderer.show()

    def close(self) -> None:
        self._renderer.close()
        self._last_words.close()

    def _write(self, sheet: Sheet) -> None:
        self._rows = [_rectangles(sheet)] if sheet.quads else []
        canvas, none = self._renderer.canvas.canvas, get_field_info(None)
        for rows in self._rows:
            canvas.triangles(get_field_info(rows), none, True, (1.0, 1.0, 1.0))
        drawn: list[Any] = [*sheet.lines, *sheet.texts]
        for width in sorted({stroke.width for stroke in drawn}, reverse=True):
            rows = _pen_strokes([stroke for stroke in drawn if stroke.width == width], sheet.size)
            self._rows.append(rows)
            canvas.lines(get_field_info(rows), none, True, (1.0, 1.0, 1.0), width / sheet.size[1])


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


def _pen_strokes(drawn: list[Any], size: tuple[int, int]) -> np.ndarray:
    points = [stroke.segments().reshape(-1, 2) for stroke in drawn]
    colors = [np.tile(stroke.rgb, (len(part), 1)) for stroke, part in zip(drawn, points, strict=True)]
    return _rows(np.concatenate(points), np.concatenate(colors), size)
