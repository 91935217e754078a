"""The state of the interactive window, and what keys and the mouse do to it."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.run.diverged import Diverged
from taichi_jello.run.find_culprit import Culprit
from taichi_jello.run.replay import Replayed, ReplayOver
from taichi_jello.run.simulation import Simulation
from taichi_jello.view.camera import Viewpoint
from taichi_jello.view.drawing.drawing import HIDDEN, Drawing
from taichi_jello.view.picking import Pick, Pixel, pick, pick_triangle, pulled, ray
from taichi_jello.view.render.renderers import Run, Size, drawing_of
from taichi_jello.view.window.actions import KEYS
from taichi_jello.view.window.frame_pacing import Pace
from taichi_jello.view.window.gauges import Gauges
from taichi_jello.view.window.pictures import FILM_RATE, Pictures
from taichi_jello.view.window.playlist import Make, Playlist

PICK_DEPTH_TOLERANCE = 0.01  # m that a jello may be pressed into a collider and still be picked
CLEARANCE = 0.05  # m between the floor and the eye
NOTICE_SECONDS = 8.0
ORBIT_RATE = 4.0  # rad for a drag over the window's height
DIVERGED = "numbers went bad at particle {particle}: dt = {dt:.3g} s, safe dt = {safe_dt:.3g} s; R: start again"


class Viewer:
    """What the window shows of a simulation and what a person does to it; it knows nothing of GGUI.
    size: (width, height) of the window [pixels]; grabbed (3,): where the mouse pulls a jello [m], if it does."""

    def __init__(self, simulation: Run, folder: str | Path = ".", make: Make = Simulation, size: Size = (1280, 720)):
        self.pictures, self.size = Pictures(folder), size
        self.playlist = Playlist(make)
        self.paused = self.helping = self.panelled = self.leaving = self.wants_picture = False
        self.pace = Pace()
        self._frame_seconds = 0.0  # from one drawn frame to the next, smoothed
        self._notice, self._notice_age = "", 0.0
        self._button, self._cursor = "", (0.0, 0.0)
        self._pending: Callable[[], None] | None = None
        self.open(simulation)

    def open(self, simulation: Run) -> None:
        """Show this simulation from now on."""
        self.simulation: Run = simulation
        self.color = simulation.scene.camera.color
        self.drawing: Drawing = drawing_of(simulation, self.size)
        self.viewpoint: Viewpoint = self.drawing.viewpoint
        self.shown = simulation.scene.camera.show
        self.grabbed: np.ndarray | None = None
        self.gauges = Gauges()
        self.notice, self._replayed = simulation.method_told, self.replay
        self._culprit: tuple[float, Culprit | None] = 0.0, None
        self.pace.rest()

    @property
    def notice(self) -> str:
        """The last message, for NOTICE_SECONDS."""
        return self._notice

    @notice.setter
    def notice(self, words: str) -> None:
        self._notice, self._notice_age = words, 0.0

    @property
    def replay(self) -> Replayed | None:
        """The simulation, if it repeats a recorded play, in which one can go back and forth."""
        return self.simulation if isinstance(self.simulation, Replayed) and self.simulation.repeating else None

    @property
    def dt(self) -> float:
        """The physics' own step [s], also if a replay steps by frames."""
        return float(self.simulation.frame_dt / self.simulation.substeps)

    @property
    def unsafe(self) -> bool:
        """Whether that step is beyond the safe one."""
        return bool(self.dt > self.simulation.safe_dt * (1.0 + 1e-6))

    @property
    def rate(self) -> float:
        """Drawn frames per second."""
        return 1.0 / self._frame_seconds if self._frame_seconds else 0.0

    @property
    def filming(self) -> bool:
        return self.pictures.filming

    def handle_key(self, key: str) -> bool:
        """Do what a key means; False if it means nothing. While work is pending, only Esc does. GGUI's names: " ", "r",
        "Right"."""
        action = KEYS.get(key.lower())
        if action is None or (self.waiting and action is not KEYS["escape"]):
            return False
        action(self)
        return True

    @property
    def waiting(self) -> bool:
        """Whether slow work is pending."""
        return self._pending is not None

    def press(self, button: str, at: Pixel) -> None:
        """A mouse button (left, right, middle) goes down: the left one grabs the jello there, else the view moves."""
        if self._button:
            return
        self._button, self._cursor = button, at
        if button == "left":
            now, skin = self.simulation.snapshot(), "skin" not in HIDDEN[self.shown]
            hit = pick(self.simulation.body, now.x, self.viewpoint, at, self.size, skin)
            if hit is not None and not self._behind_collider(hit, at):
                try:
                    self.simulation.grab(hit.particles, hit.weights, hit.point)
                    self.grabbed = hit.point
                except ValueError as error:
                    self.notice = str(error)

    def _behind_collider(self, hit: Pick, at: Pixel) -> bool:
        """Whether a collider, as last drawn, hides what was hit."""
        surroundings = self.drawing.surroundings
        if surroundings is None or not len(surroundings.triangles.x):
            return False
        eye, direction = ray(self.viewpoint, at, self.size)
        x = surroundings.points(self.drawing.time)
        front = pick_triangle(x, surroundings.triangles.index, eye, direction)
        far, near = (np.linalg.norm(p.point - eye) if p else np.inf for p in (hit, front))
        return bool(near < far - PICK_DEPTH_TOLERANCE)

    def move(self, at: Pixel, in_depth: bool = False) -> None:
        """The mouse has moved; in_depth: it pulls along the line of sight."""
        right, up = (at[0] - self._cursor[0]) / self.size[1], (self._cursor[1] - at[1]) / self.size[1]
        self._cursor = at
        if not self._button or not (right or up):
            return
        if self.grabbed is not None:
            self.grabbed = pulled(self.grabbed, self.viewpoint, right, up, in_depth)
            self.simulation.move_grab(self.grabbed)
        else:
            self.drag(self._button, right, up)

    def release(self, button: str) -> None:
        """A mouse button is up."""
        if button == self._button:
            self._button = ""
            self.let_go()

    def let_go(self) -> None:
        """Release what is grabbed, if anything is."""
        if self.grabbed is not None:
            self.simulation.release()
            self.grabbed = None

    def drag(self, button: str, right: float, up: float) -> None:
        """Move the view: the mouse moved by these fractions of the window's height with `button` down."""
        with self._above_floor():
            if button == "middle":
                meters = 2.0 * self.viewpoint.distance * float(np.tan(np.radians(self.viewpoint.fov) / 2.0))
                self.viewpoint.pan(-right * meters, -up * meters)
            else:
                self.viewpoint.orbit(-ORBIT_RATE * right, -ORBIT_RATE * up)

    def zoom(self, factor: float) -> None:
        """Multiply the distance to the target."""
        with self._above_floor():
            self.viewpoint.zoom(factor)

    @contextlib.contextmanager
    def _above_floor(self) -> Iterator[None]:
        """Keep an eye that is above a level floor there: from below the floor hides everything."""
        height = float(self.viewpoint.eye[1])
        floors = [level for collider in self.simulation.scene.collider if (level := collider.floor()) is not None]
        yield
        lowest = min(max(floors, default=-np.inf) + CLEARANCE, height)
        self.viewpoint.eye[1] = max(self.viewpoint.eye[1], lowest)

    def advance(self, seconds: float) -> int:
        """Let `seconds` since the last drawn frame pass (0: do not count). Returns the number of physics frames."""
        if seconds > 0.0:
            self._frame_seconds += (seconds - self._frame_seconds) * (0.1 if self._frame_seconds else 1.0)
        if self.paused or seconds <= 0.0 or self._pending is not None:
            self.pace.rest()
            return 0
        self._notice_age += seconds
        if self._notice_age > NOTICE_SECONDS:
            self.notice = ""
        frames = 0
        if self._compiled():
            with self._pausing_at_the_end():
                if self.filming:
                    frames = self.pace.exactly(self.simulation, 1.0 / FILM_RATE)
                else:
                    frames = self.pace.advance(self.simulation, seconds)
        return frames

    def step(self) -> None:
        """One physics frame."""
        if self._compiled():
            with self._pausing_at_the_end():
                self.pace.frame(self.simulation)

    def _compiled(self) -> bool:
        """Whether the method is compiled; if not, a notice and its first frame are now pending."""
        if getattr(self.simulation, "compiled", True):
            return True
        notice = self.notice

        def first_frame() -> None:
            self.notice = notice
            with self._pausing_at_the_end():
                self.simulation.frame()

        self.do_later(f"compiling {self.simulation.method} ...", first_frame)
        return False

    @contextlib.contextmanager
    def _pausing_at_the_end(self) -> Iterator[None]:
        """Pause if the numbers diverge or a replay ends."""
        try:
            yield
        except Diverged as bad:
            self.paused = True
            self.let_go()
            self.notice = DIVERGED.format(**bad.record)
            self._culprit = self.simulation.time, bad.culprit
        except ReplayOver:
            self.paused = True
            self.notice = "end of the replay; Left: back, Space: go on as a new run"

    @property
    def culprit(self) -> Culprit | None:
        """What made the numbers diverge, as long as the last good state is shown."""
        time, culprit = self._culprit
        return culprit if self.paused and self.simulation.time == time else None

    def tune(self, **numbers: Any) -> bool:
        """Change numbers of the simulation's tuning; False, with a notice, if it refuses."""
        try:
            self.simulation.tune(**numbers)
        except ValueError as error:
            self.notice = str(error)
            return False
        return True

    def do_later(self, words: str, work: Callable[[], None]) -> None:
        """Do slow work once these words are on the screen."""
        self.notice, self._pending = words, work

    def do_pending(self) -> bool:
        """Do the pending work; False if there is none."""
        work, self._pending = self._pending, None
        if work is not None:
            work()
        return work is not None

    def update(self) -> None:
        """Fill the drawing from the simulation's state."""
        if self._replayed and not self.replay:
            self._replayed, self.notice = None, "the replay is left: a new run from here"
        self.drawing.show(self.shown)
        if self.drawing.springs is not None:
            tuning = self.simulation.tuning
            self.drawing.springs.scale = (tuning.get("stiffness", 1.0), tuning.get("damping", 1.0))
        now = self._now = self.simulation.snapshot()
        self.drawing.update(now.x, now.v, now.time, color=self.color, memory=now.memory)
        if self.panelled:
            self.gauges.read(self.simulation, now.x, now.v)

    def moment(self) -> tuple[object, ...]:
        """What the picture depends on since the last update: equal if nothing has changed."""
        now, view, tuning = self._now, self.viewpoint, self.simulation.tuning
        springs = tuning.get("stiffness"), tuning.get("damping")
        seen = view.eye.tobytes(), view.target.tobytes(), view.fov, self.size, self.color, self.shown
        return (id(self.drawing), now.time, now.x.tobytes(), now.v.tobytes(), *springs, *seen)

    def end_recording(self) -> str:
        """End the recording or replay, if the simulation is one. Returns a message."""
        if hasattr(self.simulation, "close"):
            return str(self.simulation.close())
        return "the replay is over" if self.replay else ""

    def keep(self) -> str:
        """Save the film and the recording, if there are any, since the window is lost. Returns a message."""
        return "; ".join(filter(None, [self.pictures.stop_film(), self.end_recording()]))

    def take(self, image: np.ndarray) -> None:
        """Save a picture of this moment (height, width, 3) uint8, if asked, and add it to a film."""
        if self.wants_picture:
            self.wants_picture = False
            self.notice = self.pictures.save(self.simulation, image)
        if self.filming and not self.paused:
            self.notice = self.pictures.add(image) or self.notice
