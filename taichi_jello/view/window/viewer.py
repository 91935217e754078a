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

PICK_DEPTH_TOLERANCE = 0.01  # m: a jello pressed this deep into a collider can still be picked
CLEARANCE = 0.05  # m, least height of the camera above the floor
NOTICE_SECONDS = 8.0
ORBIT_RATE = 4.0  # rad per drag of the window's height
DIVERGED = "diverged at particle {particle}: dt = {dt:.3g} s, safe dt = {safe_dt:.3g} s; press R to restart"


class Viewer:
    """What the window shows of a simulation, and what the user does to it; independent of GGUI.
    size: (width, height) of the window [pixels]; grabbed (3,): the point [m] to which the mouse pulls a jello, or
    None."""

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
        """The simulation if it is replaying a recording, which can be scrubbed back and forth; else None."""
        return self.simulation if isinstance(self.simulation, Replayed) and self.simulation.repeating else None

    @property
    def dt(self) -> float:
        """The step of the physics [s], even if a replay advances by whole frames."""
        return float(self.simulation.frame_dt / self.simulation.substeps)

    @property
    def unsafe(self) -> bool:
        """Whether this step exceeds the safe step."""
        return bool(self.dt > self.simulation.safe_dt * (1.0 + 1e-6))

    @property
    def rate(self) -> float:
        """Drawn frames per second."""
        return 1.0 / self._frame_seconds if self._frame_seconds else 0.0

    @property
    def filming(self) -> bool:
        return self.pictures.filming

    def handle_key(self, key: str) -> bool:
        """Perform the action of a key; False if it has none. While slow work is pending, only Esc works. Keys have
        GGUI's names: " ", "r", "Right"."""
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
        """A mouse button (left, right, middle) was pressed: left on a jello grabs it, any other press moves the
        view."""
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
        """Whether a collider, as last drawn, hides the picked point."""
        surroundings = self.drawing.surroundings
        if surroundings is None or not len(surroundings.triangles.x):
            return False
        eye, direction = ray(self.viewpoint, at, self.size)
        x = surroundings.points(self.drawing.time)
        front = pick_triangle(x, surroundings.triangles.index, eye, direction)
        far, near = (np.linalg.norm(p.point - eye) if p else np.inf for p in (hit, front))
        return bool(near < far - PICK_DEPTH_TOLERANCE)

    def move(self, at: Pixel, in_depth: bool = False) -> None:
        """The mouse has moved; in_depth: vertical motion pulls along the line of sight."""
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
        """A mouse button was released."""
        if button == self._button:
            self._button = ""
            self.let_go()

    def let_go(self) -> None:
        """Release what is grabbed, if anything is."""
        if self.grabbed is not None:
            self.simulation.release()
            self.grabbed = None

    def drag(self, button: str, right: float, up: float) -> None:
        """Orbit or pan the camera after a drag by these fractions of the window's height with `button` held."""
        with self._above_floor():
            if button == "middle":
                meters = 2.0 * self.viewpoint.distance * float(np.tan(np.radians(self.viewpoint.fov) / 2.0))
                self.viewpoint.pan(-right * meters, -up * meters)
            else:
                self.viewpoint.orbit(-ORBIT_RATE * right, -ORBIT_RATE * up)

    def zoom(self, factor: float) -> None:
        """Multiply the camera's distance to its target by `factor`."""
        with self._above_floor():
            self.viewpoint.zoom(factor)

    @contextlib.contextmanager
    def _above_floor(self) -> Iterator[None]:
        """Keep a camera that is above a level floor above it: from below, the floor hides everything."""
        height = float(self.viewpoint.eye[1])
        floors = [level for collider in self.simulation.scene.collider if (level := collider.floor()) is not None]
        yield
        lowest = min(max(floors, default=-np.inf) + CLEARANCE, height)
        self.viewpoint.eye[1] = max(self.viewpoint.eye[1], lowest)

    def advance(self, seconds: float) -> int:
        """Advance by the `seconds` since the last drawn frame (0: not at all). Returns the number of physics frames
        run."""
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
        """Run one physics frame."""
        if self._compiled():
            with self._pausing_at_the_end():
                self.pace.frame(self.simulation)

    def _compiled(self) -> bool:
        """Whether the method is compiled. If not, schedule its first frame and show a notice."""
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
        """Pause if the simulation diverges or a replay ends."""
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
        """What made the simulation diverge, as long as the last good state is shown."""
        time, culprit = self._culprit
        return culprit if self.paused and self.simulation.time == time else None

    def tune(self, **numbers: Any) -> bool:
        """Change parameters of the simulation; False, with a notice, if it rejects them."""
        try:
            self.simulation.tune(**numbers)
        except ValueError as error:
            self.notice = str(error)
            return False
        return True

    def do_later(self, words: str, work: Callable[[], None]) -> None:
        """Run slow work after the message `words` has appeared."""
        self.notice, self._pending = words, work

    def do_pending(self) -> bool:
        """Run the pending work; False if there is none."""
        work, self._pending = self._pending, None
        if work is not None:
            work()
        return work is not None

    def update(self) -> None:
        """Fill the drawing from the simulation's state."""
        if self._replayed and not self.replay:
            self._replayed, self.notice = None, "left the replay: a new run starts here"
        self.drawing.show(self.shown)
        if self.drawing.springs is not None:
            tuning = self.simulation.tuning
            self.drawing.springs.scale = (tuning.get("stiffness", 1.0), tuning.get("damping", 1.0))
        now = self._now = self.simulation.snapshot()
        self.drawing.update(now.x, now.v, now.time, color=self.color, memory=now.memory)
        if self.panelled:
            self.gauges.read(self.simulation, now.x, now.v)

    def moment(self) -> tuple[object, ...]:
        """All that the picture depends on, as of the last update: two equal values mean equal pictures."""
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
        """Save the film and the recording, if any, because the window is lost. Returns a message."""
        return "; ".join(filter(None, [self.pictures.stop_film(), self.end_recording()]))

    def take(self, image: np.ndarray) -> None:
        """Save this picture (height, width, 3) uint8 if one was requested, and add it to a running film."""
        if self.wants_picture:
            self.wants_picture = False
            self.notice = self.pictures.save(self.simulation, image)
        if self.filming and not self.paused:
            self.notice = self.pictures.add(image) or self.notice
