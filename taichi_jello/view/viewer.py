"""The interactive window: what keys and the mouse do, and the loop that keeps physics in step with the
clock."""

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.record import write_png
from taichi_jello.scene import COLORS
from taichi_jello.view import palette
from taichi_jello.view.camera import Viewpoint
from taichi_jello.view.drawing import Drawing
from taichi_jello.view.legend import Sheet, legend
from taichi_jello.view.renderers import drawing_of

ORBIT = 4.0  # rad for a drag across the whole height of the window
ZOOM = 1.15  # a key press
MOST_FRAMES = 4  # physics frames for one drawn one: a slow machine slows time instead of freezing the window
SHOWS: tuple[tuple[str, frozenset[str]], ...] = (
    ("skin and springs", frozenset()),
    ("all springs", frozenset({"skin"})),
    ("skin", frozenset({"springs", "particles"})),
    ("particles", frozenset({"skin", "springs"})),
)
HELP = (
    ("drag", "turn the view"),
    ("middle drag", "move the view"),
    ("W S  or  up down", "nearer, farther"),
    ("Space", "pause, go on"),
    ("right arrow", "one frame, while paused"),
    ("R", "start again"),
    ("C", "color: force, strain, family, plain"),
    ("K", "show: skin, springs, particles"),
    ("P", "save a picture"),
    ("H", "this help"),
    ("Esc", "leave"),
)


class Viewer:
    """What the window shows of a simulation and what a person asks of it; knows no window.

    Asked with handle_key and drag, and moved on by advance; `notice` is the last thing to tell."""

    def __init__(self, simulation: Any, color: str = "", folder: str | os.PathLike[str] = "."):
        color = color or simulation.scene.camera.color
        if color not in COLORS:
            raise ValueError(f"color: expected one of {', '.join(COLORS)}, got {color!r}")
        self.simulation = simulation
        self.drawing: Drawing = drawing_of(simulation)
        self.viewpoint = Viewpoint.of(simulation.scene.camera)
        self.color, self.folder = color, Path(folder)
        self.paused = self.helping = self.leaving = self.photo = False
        self.show = 0
        self.speed = 1.0  # simulated seconds for a second of the clock
        self.notice = ""
        self._owed = 0.0
        self._keys = {
            " ": self._pause, "right": self._step, "r": self._restart, "c": self._next_color,
            "k": self._next_show, "p": self._ask_photo, "h": self._toggle_help, "escape": self._leave,
            "w": self._nearer, "up": self._nearer, "s": self._farther, "down": self._farther,
        }  # fmt: skip

    def handle_key(self, key: str) -> bool:
        """Do what a key press means; False if it means nothing. Keys by GGUI's names: " ", "r", "Right",
        "Escape"."""
        action = self._keys.get(key.lower())
        if action is None:
            return False
        action()
        return True

    def drag(self, button: str, right: float, up: float) -> None:
        """The mouse moved by these fractions of the window's height with `button` (left, right, middle)
        held."""
        if button == "middle":
            meters = 2.0 * self.viewpoint.distance * float(np.tan(np.radians(self.viewpoint.fov) / 2.0))
            self.viewpoint.pan(-right * meters, -up * meters)
        else:
            self.viewpoint.orbit(-ORBIT * right, -ORBIT * up)

    def advance(self, seconds: float) -> int:
        """Let `seconds` of the clock pass: whole physics frames follow, at most MOST_FRAMES. Returns how
        many."""
        if self.paused or seconds <= 0.0:
            self._owed = 0.0
            return 0
        frame = self.simulation.frame_dt
        self._owed += seconds
        wanted = int(self._owed / frame + 1e-9)
        frames = min(wanted, MOST_FRAMES)
        for _ in range(frames):
            self.simulation.frame()
        # Time that a slow machine cannot make up is forgotten, not saved for a burst.
        self._owed = self._owed - frames * frame if wanted <= MOST_FRAMES else 0.0
        share = min(1.0, seconds)
        self.speed += (frames * frame / seconds - self.speed) * share
        return frames

    def update(self) -> None:
        """Fill the drawing from the simulation's state."""
        self.drawing.hidden = set(SHOWS[self.show][1])
        if self.drawing.springs is not None:
            self.drawing.springs.everything = SHOWS[self.show][0] == "all springs"
        now = self.simulation.snapshot()
        self.drawing.update(now.x, now.v, now.time, viewpoint=self.viewpoint, color=self.color)

    def sheet(self, size: tuple[int, int], rate: float) -> Sheet:
        """The legend and, at the top, the state; rate: drawn frames a second."""
        sheet = legend(self.drawing.key, self.simulation.time, size)
        s = sheet.scale
        words = f"{rate:.0f} fps"
        if self.paused:
            words += "   paused"
        elif self.speed < 0.95:
            words += f"   real time x {self.speed:.2f}"
        sheet.text(words, size[0] - 28.0 * s, 40.0 * s, 12.5 * s, align=1.0)
        sheet.text(self.simulation.scene.title or "jello", 28.0 * s, 40.0 * s, 12.5 * s)
        sheet.text(self.notice or "H: help", 28.0 * s, 62.0 * s, 10.0 * s, palette.EDGE)
        if self.helping:
            self._write_help(sheet)
        return sheet

    def _write_help(self, sheet: Sheet) -> None:
        s = sheet.scale
        width, height = 640.0 * s, (len(HELP) * 27.0 + 40.0) * s
        x, y = (sheet.size[0] - width) / 2.0, (sheet.size[1] - height) / 2.0
        sheet.quad(x, y, width, height, palette.PAPER)
        for k, (keys, meaning) in enumerate(HELP):
            line = y + (42.0 + 27.0 * k) * s
            sheet.text(keys, x + 30.0 * s, line, 12.5 * s)
            sheet.text(meaning, x + 230.0 * s, line, 12.5 * s)

    def save(self, image: np.ndarray) -> None:
        """Write the picture into the folder, named after scene and time; says in `notice` where, or why
        not."""
        self.photo = False
        title = "".join(c if c.isalnum() or c in "-_" else "-" for c in self.simulation.scene.title) or "jello"
        path = self.folder / f"{title}-{self.simulation.time:.3f}s.png"
        try:
            write_png(path, image)
            self.notice = f"saved {path.name}"
        except OSError as error:
            self.notice = f"not saved: {error.strerror or error}"

    def _pause(self) -> None:
        self.paused = not self.paused

    def _step(self) -> None:
        if self.paused:
            self.simulation.frame()

    def _restart(self) -> None:
        self.simulation.reset()
        self._owed = 0.0

    def _next_color(self) -> None:
        self.color = COLORS[(COLORS.index(self.color) + 1) % len(COLORS)]
        self.notice = f"color: {self.color}"

    def _next_show(self) -> None:
        self.show = (self.show + 1) % len(SHOWS)
        self.notice = f"show: {SHOWS[self.show][0]}"

    def _ask_photo(self) -> None:
        self.photo = True

    def _toggle_help(self) -> None:
        self.helping = not self.helping

    def _leave(self) -> None:
        self.leaving = True

    def _nearer(self) -> None:
        self.viewpoint.zoom(1.0 / ZOOM)

    def _farther(self) -> None:
        self.viewpoint.zoom(ZOOM)


def play(
    simulation: Any,
    size: tuple[int, int] = (1280, 720),
    color: str = "",
    folder: str | os.PathLike[str] = ".",
    seconds: float | None = None,
) -> None:
    """Show a simulation in a window until Esc or its close button, or until `seconds` of the simulation are
    over.

    color: one of COLORS, by default the scene's; folder: where P saves pictures. Raises RuntimeProblem
    without a Vulkan driver or a screen.
    """
    from taichi_jello.view.screen import Screen

    viewer = Viewer(simulation, color, folder)
    screen = Screen(size, simulation.scene.title or "jello")
    rate, before = 0.0, time.perf_counter()
    try:
        while screen.running and not viewer.leaving and (seconds is None or simulation.time < seconds):
            screen.listen(viewer)
            now = time.perf_counter()
            viewer.advance(now - before)
            rate += (1.0 / max(now - before, 1e-4) - rate) * 0.1
            before = now
            viewer.update()
            screen.show(viewer, rate)
    finally:
        screen.close()
