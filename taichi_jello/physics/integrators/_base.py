"""Integrator: the interface of a time-stepping scheme."""

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.stable_step import Bound, largest_dt, spectral_radius
from taichi_jello.physics.state import Memory, State
from taichi_jello.physics.stepper import Stepper
from taichi_jello.scene.body import Body

Acceleration = Callable[[np.ndarray, np.ndarray], np.ndarray]  # of x and v
OscillatorStep = Callable[[np.ndarray, np.ndarray, np.ndarray, Acceleration], tuple[np.ndarray, np.ndarray]]

FADE_TIME = 0.1  # s


@ti.func
def serial(first, last):
    """True in one thread only: for code that a single member of the team runs."""
    return first == 0 and last > 0


class Integrator:
    """One scheme. A step from t to t + dt [s since the frame began] is `stage` for s = 0 … stages - 1, then `finish`.

    A subclass sets `name`, `order` (2 for an error ∝ dt², …), `safety`, `stages`, and defines
    - `allocate`, which makes the fields it needs;
    - `@ti.func stage(self, system, first, last, s, t, dt)` and `@ti.func finish(self, system, first, last, t, dt)` for
      the particles first … last - 1: loops over these, which write to no others, and calls of `system.accelerations`,
      which waits for all threads. Stages are a loop, since unrolled ones of RK4 take 7 s to compile instead of 0.5;
    - `amplification(a, zeta)`, the (…, 2, 2) matrices of a step of length a for x'' = -x - 2ζx', for `dt = "auto"`;
    - with `has_begin`, `@ti.func begin(self, system, first, last, t)`, run before the first step of a frame;
    - with `solves`, a `solver` (see implicit_solve/) whose turns follow each stage until its mode is 0, and
      `prepare(system, dt)`, called before steps of that length.
    """

    name: ClassVar[str]
    order: ClassVar[int]
    safety: ClassVar[float]
    stages: int = 1
    search_at: float = 0.0  # fraction of a step at which contacts are searched for
    has_begin: bool = False
    solves: bool = False
    long_steps: bool = False  # steps may exceed the periods of the springs
    fixed_step: bool = True  # False: the scheme divides the given step
    adds_mass: bool = True  # the mass that a hand adds moves with the particles it holds
    automatic: ClassVar[str] = ""  # how `automatic_dt` is chosen if it is not the safe step
    solver: Any
    prepare: Any
    stage: Any
    finish: Any
    begin: Any

    def __init__(self, memory: Memory, state: State, damped: bool, body: Body):
        """For `state`, the particles of `body`; damped: some force reads velocities."""
        self.memory, self.state, self.damped, self.body = memory, state, damped, body
        self.allocate()

    def allocate(self) -> None:
        """Make the fields that the scheme keeps between stages."""

    def use_forces(self, forces: tuple[Any, ...]) -> None:
        """Make the fields that depend on the forces of the scene."""

    def make_stepper(self, system: Any) -> Any:
        """The object that takes steps of this scheme."""
        return Stepper(system, self)

    @property
    def passes(self) -> int:
        """How often a step of an explicit scheme evaluates all springs."""
        return self.stages

    @property
    def passes_so_far(self) -> int:
        """How often the steps of an implicit scheme have evaluated all springs since it was made."""
        return int(self.solver.passes)

    @classmethod
    def evaluations(cls, damped: bool) -> int:
        """How often a step of an explicit scheme evaluates all forces; damped: some force reads velocities."""
        return 1

    @classmethod
    def bound(cls, forces: tuple[Any, ...], drag: float) -> Bound:
        """The safe step with these forces as they are now."""
        return largest_dt(cls.amplification, cls.safety, [force.rates() for force in forces], drag)

    def automatic_dt(self, bound: Bound, frame_dt: float) -> float:
        """The step [s] for dt = "auto"."""
        return bound.dt

    def fades_beyond(self, dt: float) -> float:
        """The frequency [Hz] above which steps of dt [s] alone halve an undamped oscillation within FADE_TIME; infinite
        if there is none."""
        a = np.geomspace(1e-3, 50.0, 400)
        fades = spectral_radius(self.amplification(a, np.zeros(1))) < 0.5 ** (dt / FADE_TIME)
        return float(a[fades.argmax()] / (2.0 * np.pi * dt)) if fades.any() else float("inf")

    def tuned(self) -> None:
        """Called after a parameter of a force has changed."""

    def remembered(self) -> dict[str, np.ndarray]:
        """What the scheme needs besides x and v to continue bit for bit."""
        return {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Continue from what `remembered` returned; if empty, from any state."""

    @classmethod
    def amplification(cls, a: np.ndarray, zeta: np.ndarray) -> np.ndarray:
        raise NotImplementedError


def oscillator_matrix(step: OscillatorStep, a: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """The (…, 2, 2) matrices of a linear `step(x, v, a, acceleration)` -> (x, v), by its effect on two states."""
    a, zeta = np.broadcast_arrays(np.asarray(a, float), np.asarray(zeta, float))

    def acceleration(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -x - 2.0 * zeta * v

    columns = [step(np.full_like(a, x), np.full_like(a, v), a, acceleration) for x, v in ((1.0, 0.0), (0.0, 1.0))]
    return np.stack([np.stack(column, -1) for column in columns], -1)
