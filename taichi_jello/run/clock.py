"""Clock: a simulation's time in whole frames and substeps, and the number of substeps of a frame."""

import warnings
from dataclasses import dataclass
from math import ceil

from taichi_jello.physics.system import System
from taichi_jello.scene.description import SceneError, Solver
from taichi_jello.scene.validation import whole

MAX_AUTOMATIC_SUBSTEPS = 1_000_000  # of a frame
MAX_STEPS = 1_000_000_000  # of a frame, or in one call, on request: about an hour of a small body


class StepWarning(UserWarning):
    """The requested step is longer than the scene's safe step."""


@dataclass
class Clock:
    """`frames` of frame_dt [s] since `before` [s], and `done` of the `substeps` of the current frame."""

    frame_dt: float
    substeps: int
    before: float = 0.0
    frames: int = 0
    done: int = 0

    @property
    def dt(self) -> float:
        """The substep [s]."""
        return self.frame_dt / self.substeps

    @property
    def time(self) -> float:
        """[s] since the scene's beginning."""
        return self.before + self.frames * self.frame_dt + self.done * self.dt

    @property
    def frame(self) -> tuple[float, float]:
        """Beginning and end of the current frame [s]."""
        return self.before + self.frames * self.frame_dt, self.before + (self.frames + 1) * self.frame_dt

    @property
    def left(self) -> int:
        """Substeps to the end of the frame."""
        return self.substeps - self.done

    def go_on(self, count: int) -> None:
        """Advance by `count` substeps, not beyond the frame's end."""
        self.done += count
        if self.done == self.substeps:
            self.frames, self.done = self.frames + 1, 0

    def cut(self, substeps: int) -> None:
        """Begin a new frame here if the number of substeps changes or a frame is incomplete."""
        if substeps != self.substeps or self.done:
            self.before, self.frames, self.done = self.time, 0, 0
            self.substeps = substeps

    @property
    def state(self) -> tuple[float, int, int, float]:
        """What `restore` needs."""
        return self.before, self.frames, self.done, self.dt

    def restore(self, state: tuple[float, int, int, float] | None, time: float) -> None:
        """Go to `state` if its substep is the same, else to `time` [s]; between substeps a new frame begins there."""
        if state is not None and state[3] == self.dt:
            self.before, self.frames, self.done, _ = state
            return
        steps = round(time / self.dt)
        self.before, self.frames, self.done = 0.0, steps // self.substeps, steps % self.substeps
        if abs(self.time - time) > 1e-6 * self.dt + 1e-12 * abs(time):
            self.before, self.frames, self.done = time, 0, 0


def safe_substeps(system: System, method: str, frame_dt: float) -> int:
    """The smallest number of substeps of a frame with a safe step. Raises SceneError if there is none, or if it is too
    large."""
    if system.bound.dt == 0.0:
        raise SceneError(
            "solver.dt",
            f"{method} has no stable step for this scene (something swings undamped); "
            "give dt in seconds, or another method such as rk4",
        )
    dt = system.integrator.automatic_dt(system.bound, frame_dt)
    if frame_dt > MAX_AUTOMATIC_SUBSTEPS * dt:
        raise SceneError(
            "solver.dt",
            f"the largest safe step of {method} is {system.bound.dt:.3g} s, {frame_dt / dt:.3g} for a frame; "
            "give dt in seconds, or an implicit method such as backward-euler",
        )
    return asked_substeps(frame_dt, min(dt, frame_dt))


def asked_step(solver: Solver, dt: float | str | None, substeps: int | None) -> tuple[float | str, int | None]:
    """The step to use: dt [s] or "auto", or substeps of a frame, by default the solver's own. Raises SceneError for
    both and for an invalid one."""
    if substeps is not None:
        if dt is not None:
            raise SceneError("substeps", f"expected either dt or substeps, got both: {dt} and {substeps}")
        if whole("substeps", substeps, low=1) > MAX_STEPS:
            raise SceneError("substeps", f"expected at most {MAX_STEPS:,} in a frame, got {substeps:.3g}")
        return solver.dt, int(substeps)
    key, step = ("solver.dt", solver.dt) if dt is None else ("dt", Solver(dt=dt).dt)
    if not isinstance(step, str) and solver.frame_dt > MAX_STEPS * step:
        least = solver.frame_dt / MAX_STEPS
        raise SceneError(key, f"expected at least {least:.3g} s, {MAX_STEPS:,} steps for a frame, got {step:g}")
    return step, None


def steps_in(seconds: float, dt: float) -> int:
    """The number of steps of dt [s] nearest to `seconds`. Raises SceneError for more than MAX_STEPS."""
    if not seconds <= MAX_STEPS * dt:
        most = f"at most {MAX_STEPS * dt:.3g} s, {MAX_STEPS:,} steps of {dt:.3g} s"
        raise SceneError("seconds", f"expected {most}, got {seconds:g}")
    return round(seconds / dt)


def asked_substeps(frame_dt: float, dt: float) -> int:
    """The smallest number of substeps of a frame that are no longer than dt [s]."""
    if dt > frame_dt * (1.0 + 1e-6):
        message = f"dt = {dt:.3g} s is longer than a frame: steps are {frame_dt:.3g} s"
        warnings.warn(message, StepWarning, stacklevel=5)
    return max(1, ceil(frame_dt / dt * (1.0 - 1e-9)))
