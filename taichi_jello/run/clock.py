"""Clock: a simulation's time in whole frames and substeps, and how many substeps a frame is cut into."""

import warnings
from dataclasses import dataclass
from math import ceil

from taichi_jello.physics.system import System
from taichi_jello.scene.description import SceneError, Solver
from taichi_jello.scene.validation import whole

MOST_SUBSTEPS = 1_000_000  # of a frame that an automatic step may come to
MOST_ASKED = 1_000_000_000  # of a frame, or in one go, that a person may ask for: about an hour of a small body


class StepWarning(UserWarning):
    """The step asked for is longer than the scene's safe one."""


@dataclass
class Clock:
    """`frames` of frame_dt [s] that began at `before` [s], and `done` of the `substeps` of the frame that runs."""

    frame_dt: float
    substeps: int
    before: float = 0.0
    frames: int = 0
    done: int = 0

    @property
    def dt(self) -> float:
        """Of a substep [s]."""
        return self.frame_dt / self.substeps

    @property
    def time(self) -> float:
        """Seconds since the scene's beginning."""
        return self.before + self.frames * self.frame_dt + self.done * self.dt

    @property
    def frame(self) -> tuple[float, float]:
        """When the frame that runs begins and ends [s]."""
        return self.before + self.frames * self.frame_dt, self.before + (self.frames + 1) * self.frame_dt

    @property
    def left(self) -> int:
        """Substeps until the frame's end."""
        return self.substeps - self.done

    def go_on(self, count: int) -> None:
        """By `count` substeps, not beyond the frame's end."""
        self.done += count
        if self.done == self.substeps:
            self.frames, self.done = self.frames + 1, 0

    def cut(self, substeps: int) -> None:
        """Begin a frame here if the frames from here on have another number of substeps, or one is half done."""
        if substeps != self.substeps or self.done:
            self.before, self.frames, self.done = self.time, 0, 0
            self.substeps = substeps

    def set(self, time: float) -> None:
        """Find the frame and substep of `time`; a time between substeps becomes a frame's beginning of its own."""
        steps = round(time / self.dt)
        self.before, self.frames, self.done = 0.0, steps // self.substeps, steps % self.substeps
        if abs(self.time - time) > 1e-6 * self.dt + 1e-12 * abs(time):
            self.before, self.frames, self.done = time, 0, 0

    @property
    def hands(self) -> tuple[float, int, int, float]:
        """All that `turn` needs to go back to this moment."""
        return self.before, self.frames, self.done, self.dt

    def turn(self, hands: tuple[float, int, int, float] | None, time: float) -> None:
        """To `hands`, if their substeps are as long as these, or else to `time` [s]."""
        if hands is not None and hands[3] == self.dt:
            self.before, self.frames, self.done, _ = hands
        else:
            self.set(time)


def safe_substeps(system: System, method: str, frame_dt: float) -> int:
    """As few whole substeps of a frame as the safe step allows. Raises SceneError if there is none, or none long
    enough."""
    if system.bound.dt == 0.0:
        raise SceneError(
            "solver.dt",
            f"{method} has no stable step for this scene (something swings undamped); "
            "give dt in seconds, or another method such as rk4",
        )
    dt = system.integrator.automatic_dt(system.bound, frame_dt)
    if frame_dt > MOST_SUBSTEPS * dt:
        raise SceneError(
            "solver.dt",
            f"the largest safe step of {method} is {system.bound.dt:.3g} s, {frame_dt / dt:.3g} for a frame; "
            "give dt in seconds, or an implicit method such as backward-euler",
        )
    return asked_substeps(frame_dt, min(dt, frame_dt))


def asked_step(solver: Solver, dt: float | str | None, substeps: int | None) -> tuple[float | str, int | None]:
    """What a person asks for in place of the solver's own step, dt [s] or "auto" or substeps of a frame. Raises
    SceneError for both and for what cannot be."""
    if substeps is not None:
        if dt is not None:
            raise SceneError("substeps", f"expected either dt or substeps, got both: {dt} and {substeps}")
        if whole("substeps", substeps, low=1) > MOST_ASKED:
            raise SceneError("substeps", f"expected at most {MOST_ASKED:,} in a frame, got {substeps:.3g}")
        return solver.dt, int(substeps)
    key, asked = ("solver.dt", solver.dt) if dt is None else ("dt", Solver(dt=dt).dt)
    if not isinstance(asked, str) and solver.frame_dt > MOST_ASKED * asked:
        least = solver.frame_dt / MOST_ASKED
        raise SceneError(key, f"expected at least {least:.3g} s, {MOST_ASKED:,} steps for a frame, got {asked:g}")
    return asked, None


def steps_in(seconds: float, dt: float) -> int:
    """The whole number of steps of dt [s] nearest to `seconds`. Raises SceneError for more than anybody waits for."""
    if not seconds <= MOST_ASKED * dt:
        most = f"at most {MOST_ASKED * dt:.3g} s, {MOST_ASKED:,} steps of {dt:.3g} s"
        raise SceneError("seconds", f"expected {most}, got {seconds:g}")
    return round(seconds / dt)


def asked_substeps(frame_dt: float, dt: float) -> int:
    """Whole substeps of a frame, as few as are no longer than dt [s]."""
    if dt > frame_dt * (1.0 + 1e-6):
        told = f"dt = {dt:.3g} s is longer than a frame: steps are {frame_dt:.3g} s"
        warnings.warn(told, StepWarning, stacklevel=5)
    return max(1, ceil(frame_dt / dt * (1.0 - 1e-9)))
