"""The interactive window: what it shows, and what keys and the mouse do."""

import contextlib
import os
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from taichi_jello.run.diverged import Diverged
from taichi_jello.run.find_culprit import Culprit
from taichi_jello.run.replay import ReplayOver
from taichi_jello.run.simulation import Simulation
from taichi_jello.scene.description import COLORS, SHOWS, Scene
from taichi_jello.view.camera import Viewpoint
from taichi_jello.view.drawing.drawing import HIDDEN, Drawing
from taichi_jello.view.picking import Pick, Place, pick, pick_skin, ray
from taichi_jello.view.render.renderers import drawing_of
from taichi_jello.view.window.actions import KEYS
from taichi_jello.view.window.frame_pacing import Pace
from taichi_jello.view.window.hand import Hand
from taichi_jello.view.window.next_demo import Playlist
from taichi_jello.view.window.pictures import FILM_RATE, Pictures
from taichi_jello.view.window.readouts import Gauges

TOUCH = 0.01  # m that a jello may be pressed into what it touches
CLEARANCE = 0.05  # m between the floor and the eye
TOLD = 8.0  # s that a notice stays while time passes
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
        size: tuple[int, int] = (1280, 720),
    ):
        color = color or simulation.scene.camera.color
        if color not in COLORS:
            raise ValueError(f"color: expected one of {', '.join(COLORS)}, got {color!r}")
        self.pictures, self.size = Pictures(folder), size
        self.playlist = Playlist(make)
        self.paused = self.helping = self.panelled = self.leaving = False
        self.pace = Pace()
        self._drawn = 0.0  # s from one drawn frame to the next, lately
        self._notice, self._told = "", 0.0
        self._button, self._at = "", (0.0, 0.0)
        self._waiting: Callable[[], None] | None = None
        self._keys: list[str] = []  # pressed meanwhile
        self.play(simulation)
        self.color = color

    def play(self, simulation: Any) -> None:
        """Show this simulation from now on."""
        self.simulation, self.color = simulation, simulation.scene.camera.color
        self.drawing: Drawing = drawing_of(simulation, self.size)
        self.viewpoint = Viewpoint.first(simulation.scene, simulation.body, self.size[0] / self.size[1])
        self.show = SHOWS.index(simulation.scene.camera.show)
        self.hand: Hand | None = None
        self.gauges = Gauges()
        self.notice, self._repeated = getattr(simulation, "method_told", ""), self.repeating
        self._culprit: tuple[float, Culprit | None] = 0.0, None
        self.pace.rest()

    @property
    def notice(self) -> str:
        """The last thing to tell, for as long as it is news."""
        return self._notice

    @notice.setter
    def notice(self, words: str) -> None:
        self._notice, self._told = words, 0.0

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
        """Do what a key press means, after what waits; False if it means nothing. Keys by GGUI's names: " ", "r",
        "Right", "Escape"."""
        if key.lower() not in KEYS:
            return False
        self._keys.append(key.lower())
        self._press_keys()
        return True

    def _press_keys(self) -> None:
        """Each in its turn: what a key asked for may have to wait until that is told."""
        while self._keys and self._waiting is None:
            KEYS[self._keys.pop(0)](self)

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
        """Let the `seconds` since the last drawn frame pass: whole physics frames follow. Returns how many.

        0 seconds where there was none, or none that counts."""
        if seconds > 0.0:
            self._drawn += (seconds - self._drawn) * (0.1 if self._drawn else 1.0)
        if self.paused or seconds <= 0.0 or self._waiting is not None:
            self.pace.rest()
            return 0
        self._told += seconds
        if self._told > TOLD:
            self.notice = ""
        if not self._compiled:
            self._compile()
            return 0
        frames = 0
        with self._stopping():
            if self.filming:
                frames = self.pace.exactly(self.simulation, 1.0 / FILM_RATE)
            else:
                frames = self.pace.advance(self.simulation, seconds)
        return frames

    def step(self) -> None:
        """One physics frame."""
        if not self._compiled:
            self._compile()
            return
        with self._stopping():
            self.pace.frame(self.simulation)

    @property
    def _compiled(self) -> bool:
        return bool(getattr(self.simulation, "compiled", True))

    def _compile(self) -> None:
        """A method's first frame takes its time: tell so, and make it once that is on the screen."""
        told = self.notice

        def first_frame() -> None:
            self.notice = told
            with self._stopping():
                self.simulation.frame()

        self.wait_for(f"compiling {self.simulation.method} ...", first_frame)

    @contextlib.contextmanager
    def _stopping(self) -> Iterator[None]:
        """Pause where the numbers go bad, or a replay ends."""
        try:
            yield
        except Diverged as bad:
            self._stop(bad)
        except ReplayOver:
            self._pause_at_the_end()

    def _pause_at_the_end(self) -> None:
        self.paused = True
        self.notice = "end of the replay; Left: back, Space: go on as a new run"

    def _stop(self, bad: Diverged) -> None:
        self.paused = True
        self.let_go()
        told = "numbers went bad at particle {particle}: dt = {dt:.3g} s, safe dt = {safe_dt:.3g} s; R: start again"
        self.notice = told.format(**bad.record)
        self._culprit = self.simulation.time, bad.culprit

    @property
    def culprit(self) -> Culprit | None:
        """What made the numbers go bad, as long as the last good state is shown."""
        time, found = self._culprit
        return found if self.paused and self.simulation.time == time else None

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
        """Do the work that waits, then what keys asked for meanwhile; False if there is none."""
        work, self._waiting = self._waiting, None
        if work is not None:
            work()
            self._press_keys()
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

    def end_recording(self) -> str:
        """End the recording or the repeating of this play, if that is what is shown; what to tell of it."""
        if hasattr(self.simulation, "close"):
            return str(self.simulation.close())
        return "the replay is over" if self.repeating else ""

    def keep(self) -> str:
        """End what is being recorded, if anything is, since the window is lost; what to tell of it."""
        return "; ".join(filter(None, [self.pictures.stop_film(), self.end_recording()]))

    @property
    def filming(self) -> bool:
        return self.pictures.filming

    def start_film(self) -> None:
        """Film from now on. Physics waits for each picture, so that none is missing."""
        self.notice = self.pictures.start_film(self.simulation, self.size)

    def stop_film(self) -> None:
        """End the film, if there is one."""
        self.notice = self.pictures.stop_film() or self.notice

    def take(self, image: np.ndarray) -> None:
        """A picture of this moment, (height, width, 3) uint8, for whoever asked for one."""
        if self.pictures.asked:
            self.notice = self.pictures.save(self.simulation, image)
        if self.filming and not self.paused:
            self.notice = self.pictures.add(image) or self.notice
