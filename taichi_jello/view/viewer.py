"""The interactive window: what it shows, what keys and the mouse do, and the loop that keeps it going."""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.film import Film, FilmProblem
from taichi_jello.record import unused, write_png
from taichi_jello.replay import ReplayOver
from taichi_jello.scene import COLORS, SHOWS, Scene
from taichi_jello.simulation import Diverged, Simulation
from taichi_jello.view import palette
from taichi_jello.view.actions import HELP, KEYS
from taichi_jello.view.camera import Viewpoint
from taichi_jello.view.drawing import HIDDEN, Drawing
from taichi_jello.view.gauges import Gauges
from taichi_jello.view.hand import Hand, mark
from taichi_jello.view.legend import Sheet, legend
from taichi_jello.view.pace import Pace
from taichi_jello.view.picking import Pick, Place, pick, pick_skin, ray
from taichi_jello.view.plot import plot
from taichi_jello.view.renderers import drawing_of
from taichi_jello.words import counted

TOUCH = 0.01  # m that a jello may be pressed into what it touches
FILM_RATE = 30  # frames a second of a film made in the window
CLEARANCE = 0.05  # m between the floor and the eye
ORBIT = 4.0  # rad for a drag across the whole height of the window


class Viewer:
    """What the window shows of a simulation and what a person asks of it; knows no window.

    Asked with handle_key, press, move and release, and moved on by advance; `notice` is the last thing to tell,
    `size` the window's (width, height) [pixels]. Places are columns and rows from its upper left corner."""

    def __init__(
        self,
        simulation: Any,
        color: str = "",
        folder: str | os.PathLike[str] = ".",
        make: Callable[[Scene], Any] = Simulation,
    ):
        color = color or simulation.scene.camera.color
        if color not in COLORS:
            raise ValueError(f"color: expected one of {', '.join(COLORS)}, got {color!r}")
        # Absolute: while GGUI shows a picture the process works in another folder, and films are written meanwhile.
        self.folder, self.size = Path(folder).resolve(), (1280, 720)
        self.make = make
        self.paused = self.helping = self.panelled = self.leaving = self.photo = False
        self.pace = Pace()
        self._drawn = 0.0  # s from one drawn frame to the next, lately
        self._button, self._at = "", (0.0, 0.0)
        self._waiting: Callable[[], None] | None = None
        self._film: Film | None = None
        self.play(simulation)
        self.color = color

    def play(self, simulation: Any) -> None:
        """Show this simulation from now on."""
        self.simulation, self.color = simulation, simulation.scene.camera.color
        self.drawing: Drawing = drawing_of(simulation)
        self.viewpoint = Viewpoint.of(simulation.scene.camera)
        self.show = SHOWS.index(simulation.scene.camera.show)
        self.hand: Hand | None = None
        self.gauges = Gauges()
        self.notice, self._repeated = "", self.repeating
        self.pace.rest()

    @property
    def repeating(self) -> bool:
        """Whether the simulation repeats a recorded play, so that one can go back and forth in it."""
        return bool(getattr(self.simulation, "repeating", False))

    @property
    def dt(self) -> float:
        """[s] The physics' own step, also where a replay steps by frames."""
        return float(self.simulation.frame_dt / self.simulation.substeps)

    @property
    def unsafe(self) -> bool:
        """Whether that step is beyond the safe one."""
        return bool(self.dt > self.simulation.safe_dt * (1.0 + 1e-6))

    @property
    def rate(self) -> float:
        """Drawn frames a second."""
        return 1.0 / self._drawn if self._drawn else 0.0

    @property
    def shown(self) -> str:
        """What K chose to be drawn."""
        return SHOWS[self.show]

    def show_next(self) -> None:
        self.show = (self.show + 1) % len(SHOWS)

    def handle_key(self, key: str) -> bool:
        """Do what a key press means; False if it means nothing. Keys by GGUI's names: " ", "r", "Right",
        "Escape"."""
        action = KEYS.get(key.lower())
        if action is None:
            return False
        action(self)
        return True

    def press(self, button: str, at: Place) -> None:
        """A mouse button (left, right, middle) goes down: the left one grabs the jello there, else the view moves."""
        if self._button:
            return
        self._button, self._at = button, at
        if button == "left":
            now, skin = self.simulation.snapshot(), "skin" not in HIDDEN[self.shown]
            found = pick(self.simulation.body, now.x, self.viewpoint, at, self.size, skin)
            if found is not None and not self._hidden(found, at):
                try:
                    self.hand = Hand(self.simulation, found)
                except ValueError as error:
                    self.notice = str(error)

    def _hidden(self, found: Pick, at: Place) -> bool:
        """Whether a collider, as it was drawn last, is in front of what was found."""
        around = self.drawing.surroundings
        if around is None or not len(around.triangles.x):
            return False
        front = pick_skin(around.triangles.x, around.triangles.index, *ray(self.viewpoint, at, self.size))
        far, near = (float(np.linalg.norm(p.point - self.viewpoint.eye)) if p else np.inf for p in (found, front))
        return near < far - TOUCH

    def move(self, at: Place, away: bool = False) -> None:
        """The mouse is at `at` now; away: it pulls along the line of sight."""
        right, up = (at[0] - self._at[0]) / self.size[1], (self._at[1] - at[1]) / self.size[1]
        self._at = at
        if not self._button or not (right or up):
            return
        if self.hand is not None:
            self.hand.move(self.viewpoint, right, up, away)
        else:
            self.drag(self._button, right, up)

    def release(self, button: str) -> None:
        """A mouse button is up."""
        if button == self._button:
            self._button = ""
            self.let_go()

    def let_go(self) -> None:
        """Release what is grabbed, if anything is."""
        if self.hand is not None:
            self.hand.let_go()
            self.hand = None

    def drag(self, button: str, right: float, up: float) -> None:
        """Move the view: the mouse moved by these fractions of the window's height with `button` held."""
        with self._above_the_floor():
            if button == "middle":
                meters = 2.0 * self.viewpoint.distance * float(np.tan(np.radians(self.viewpoint.fov) / 2.0))
                self.viewpoint.pan(-right * meters, -up * meters)
            else:
                self.viewpoint.orbit(-ORBIT * right, -ORBIT * up)

    def zoom(self, factor: float) -> None:
        """Multiply the distance to what is looked at."""
        with self._above_the_floor():
            self.viewpoint.zoom(factor)

    @contextlib.contextmanager
    def _above_the_floor(self) -> Iterator[None]:
        """An eye that is above a level floor stays there: from below the floor hides all."""
        eye = self.viewpoint.eye
        floors = [level for collider in self.simulation.scene.collider if (level := collider.floor()) is not None]
        yield
        lowest = min(max(floors, default=-np.inf) + CLEARANCE, float(eye[1]))
        self.viewpoint.eye[1] = max(self.viewpoint.eye[1], lowest)

    def advance(self, seconds: float) -> int:
        """Let the `seconds` since the last drawn frame pass: whole physics frames follow. Returns how many."""
        self._drawn += (seconds - self._drawn) * (0.1 if self._drawn else 1.0)
        if self.paused or seconds <= 0.0:
            self.pace.rest()
            return 0
        try:
            if self.filming:
                return self.pace.exactly(self.simulation, 1.0 / FILM_RATE)
            return self.pace.advance(self.simulation, seconds)
        except Diverged as bad:
            self._stop(bad)
        except ReplayOver:
            self._pause_at_the_end()
        return 0

    def step(self) -> None:
        """One physics frame."""
        try:
            self.pace.frame(self.simulation)
        except Diverged as bad:
            self._stop(bad)

    def _pause_at_the_end(self) -> None:
        self.paused = True
        self.notice = "end of the replay; Left: back, Space: go on as a new run"

    def _stop(self, bad: Diverged) -> None:
        self.paused = True
        self.let_go()
        told = "numbers went bad at particle {particle}: dt = {dt:.3g} s, safe dt = {safe_dt:.3g} s; R: start again"
        self.notice = told.format(**bad.record)

    def tune(self, **numbers: Any) -> bool:
        """Change numbers of the simulation's tuning; False, with a notice, where they cannot be."""
        try:
            self.simulation.tune(**numbers)
        except ValueError as error:
            self.notice = str(error)
            return False
        return True

    def wait_for(self, words: str, work: Callable[[], None]) -> None:
        """Tell these words, and do the work, which takes its time, once they are on the screen."""
        self.notice, self._waiting = words, work

    def catch_up(self) -> bool:
        """Do the work that waits; False if there is none."""
        work, self._waiting = self._waiting, None
        if work is not None:
            work()
        return work is not None

    def update(self) -> None:
        """Fill the drawing from the simulation's state."""
        if self._repeated and not self.repeating:
            self._repeated, self.notice = False, "the replay is left: a new run from here"
        self.drawing.show(self.shown)
        if self.drawing.springs is not None:
            tuning = self.simulation.tuning
            self.drawing.springs.scale = (tuning.get("stiffness", 1.0), tuning.get("damping", 1.0))
        now = self.simulation.snapshot()
        self.drawing.update(now.x, now.v, now.time, viewpoint=self.viewpoint, color=self.color, memory=now.memory)
        if self.panelled:
            self.gauges.read(self.simulation, now.x, now.v)

    def sheet(self) -> Sheet:
        """The legend; at the top the state; and what is grabbed, plotted or explained."""
        size = self.size
        sheet = legend(self.drawing.key, self.simulation.time, size)
        s = sheet.scale
        words = f"{self.rate:.0f} fps"
        if self.paused:
            words += "   paused"
        elif abs(self.pace.speed - 1.0) > 0.05:
            words += f"   real time x {self.pace.speed:.2f}"
        if self.unsafe:
            words += "   unsafe dt"
        sheet.text(words, size[0] - 28.0 * s, 40.0 * s, 12.5 * s, align=1.0)
        sheet.text(self.simulation.scene.title or "jello", 28.0 * s, 40.0 * s, 12.5 * s)
        if self.helping:
            write_help(sheet)
            return sheet
        sheet.text(self.notice or "H: help", 28.0 * s, 62.0 * s, 10.0 * s, palette.INK if self.notice else palette.EDGE)
        if self.panelled:
            plot(sheet, self.gauges.past)
        held = self.simulation.held if self.hand is not None or self.repeating else None
        if held is not None:
            mark(sheet, held, self.viewpoint)
        return sheet

    @property
    def filming(self) -> bool:
        return self._film is not None

    def start_film(self) -> None:
        """From now on the moments FILM_RATE a second go into a film in the folder; says in `notice` which, or why
        not. Physics waits for each picture, so that none is missing."""
        film = None
        try:
            film = Film(self._named(".mp4"), (self.size[0] // 2 * 2, self.size[1] // 2 * 2), FILM_RATE, keep=(OSError,))
            self._film = film.__enter__()
            self.notice = f"filming {film.path.name}; V ends it"
        except (FilmProblem, OSError) as error:
            self.notice = f"no film: {error.strerror or error if isinstance(error, OSError) else error}"

    def stop_film(self) -> None:
        """End the film, if there is one; what was filmed is kept."""
        film, self._film = self._film, None
        if film is not None:
            try:
                film.__exit__(None, None, None)
                told = f"saved {film.path.name}: {counted(film.frames, 'frame')}"
                self.notice = told if film.kept else "nothing was filmed"
            except OSError as error:
                kept = f"what {film.path.name} has so far is kept" if film.kept else "no film is kept"
                self.notice = f"{error.strerror or error}: {kept}"

    def end_recording(self) -> str:
        """End the recording or the repeating of this play, if that is what is shown; what to tell of it."""
        if hasattr(self.simulation, "close"):
            return str(self.simulation.close())
        return "the replay is over" if self.repeating else ""

    def keep(self) -> str:
        """End what is being recorded, if anything is, since the window is lost; what to tell of it."""
        self.notice = ""
        self.stop_film()
        return "; ".join(filter(None, [self.notice, self.end_recording()]))

    def take(self, image: np.ndarray) -> None:
        """A picture of this moment, (height, width, 3) uint8, for whoever asked for one."""
        if self.photo:
            self.save(image)
        if self._film is not None and not self.paused:
            width, height = self._film.size
            try:
                self._film.add(np.ascontiguousarray(image[:height, :width]))
            except ValueError:  # a picture of another size
                self.stop_film()
                self.notice = f"the window changed its size: {self.notice}"
            except OSError:  # the disk is full
                self.stop_film()

    def _named(self, suffix: str) -> Path:
        """A file of the folder that is not there yet, named after scene and time."""
        title = "".join(c if c.isalnum() or c in "-_" else "-" for c in self.simulation.scene.title) or "jello"
        return unused(self.folder / f"{title}-{self.simulation.time:.3f}s{suffix}")

    def save(self, image: np.ndarray) -> None:
        """Write the picture into the folder, named after scene and time; says in `notice` where, or why
        not."""
        self.photo = False
        path = self._named(".png")
        try:
            write_png(path, image)
            self.notice = f"saved {path.name}"
        except OSError as error:
            self.notice = f"not saved: {error.strerror or error}"


def write_help(sheet: Sheet) -> None:
    """All keys, on a page in the middle."""
    s = min(sheet.scale, sheet.size[0] / 740.0)
    width, height = 700.0 * s, (len(HELP) * 26.0 + 36.0) * s
    x, y = (sheet.size[0] - width) / 2.0, (sheet.size[1] - height) / 2.0
    sheet.quad(x, y, width, height, palette.PAPER)
    for k, (keys, meaning) in enumerate(HELP):
        line = y + (38.0 + 26.0 * k) * s
        sheet.text(keys, x + 30.0 * s, line, 12.5 * s)
        sheet.text(meaning, x + 270.0 * s, line, 12.5 * s)


def leave_when_asked(viewer: Viewer) -> dict[int, Any]:
    """A closed terminal or a system that shuts down ends the window as Esc does. The signals, and what they did."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    names = ("SIGTERM", "SIGHUP")
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]

    def leave(*_: Any) -> None:
        viewer.leaving = True

    return {number: signal.signal(number, leave) for number in numbers}


def play(
    simulation: Any,
    size: tuple[int, int] = (1280, 720),
    color: str = "",
    folder: str | os.PathLike[str] = ".",
    seconds: float | None = None,
    make: Callable[[Scene], Any] = Simulation,
) -> None:
    """Show a simulation in a window until Esc or its close button, or until `seconds` of the simulation are
    over.

    color: one of COLORS, by default the scene's; folder: where P saves pictures; make: makes a simulation of the scene
    that N goes to. Raises RuntimeProblem without a Vulkan driver or a screen. A film that is not ended then is ended
    and printed.
    """
    from taichi_jello.view.screen import Screen

    viewer = Viewer(simulation, color, folder, make)
    screen = Screen(size, simulation.scene.title or "jello", viewer.keep)
    before = time.perf_counter()
    asked = leave_when_asked(viewer)
    try:
        while screen.running and not viewer.leaving and (seconds is None or viewer.simulation.time < seconds):
            screen.listen(viewer)
            now = time.perf_counter()
            viewer.advance(now - before)
            before = now
            viewer.update()
            screen.show(viewer)
            if viewer.catch_up():
                before = time.perf_counter()
    finally:
        for number, handler in asked.items():
            signal.signal(number, handler)
        if viewer.filming:
            viewer.stop_film()
            print(viewer.notice, flush=True)
        screen.close()
