"""What every time-stepping scheme offers: a name, an order, a step, and how it treats a damped oscillator."""

from typing import Any, ClassVar

import numpy as np

from taichi_jello.physics.stable_step import Bound, largest_dt, spectral_radius
from taichi_jello.physics.state import Memory, State
from taichi_jello.physics.stepper import Stepper
from taichi_jello.scene.body import Body

FADE = 0.1  # s


class Integrator:
    """One scheme. A step from t to t + dt [s after the frame began] is: `stage` for s = 0 … stages - 1, then `finish`.

    A subclass sets `name`, `order` (2 for error ∝ dt², …), `safety` and `stages`, `automatic`, the rule in words, if
    its `automatic_dt` is not the safe one, and defines
    - `@ti.func stage(self, system, first, last, s, t, dt)` and `@ti.func finish(self, system, first, last, t, dt)` for
      the particles first … last - 1: loops over these, which touch no others, and calls of `system.accelerations`,
      which waits until all particles are where they should be. They are compiled once each, within one loop over a
      frame for each thread of a team or as parallel tasks (stages unrolled took 7 s to compile for RK4, this 0.5 s);
    - `amplification(a, zeta)`: the (…, 2, 2) matrices of one step of length a for x'' = -x - 2ζx', from which
      `dt = "auto"` is found;
    - `looks_at`, at which part of a step forces look for what is touched in it: the middle, where it looks beyond the
      step's beginning, so that as much is found too late as is given up too early;
    - with `has_begin`, `@ti.func begin(self, system, first, last, t)`, run before the first step of a frame;
    - with `solves`, a `solver` (see integrators/implicit_solve) whose turns follow each stage until its mode is 0, and
      `prepare(system, dt)`, called before steps of that length.
    """

    name: ClassVar[str]
    order: ClassVar[int]
    safety: ClassVar[float]
    stages: int = 1
    looks_at: float = 0.0
    has_begin: bool = False
    solves: bool = False
    long_steps: bool = False  # they may be longer than what swings takes
    fixed_step: bool = True  # it takes the step that it is told
    loads: bool = True  # what forces hold is heavier by the mass that they add
    automatic: ClassVar[str] = ""
    solver: Any
    prepare: Any
    stage: Any
    finish: Any
    begin: Any

    def __init__(self, memory: Memory, state: State, damped: bool, body: Body):
        """Allocate what the scheme keeps between stages of stepping `state`, the particles of `body`; `damped`: forces
        read velocities."""
        raise TypeError(f"{type(self).__name__} must define __init__()")

    def make_stepper(self, system: Any) -> Any:
        """What takes its steps."""
        return Stepper(system, self)

    def meet(self, forces: tuple[Any, ...]) -> None:
        """Allocate what depends on the forces of the scene."""

    @property
    def passes(self) -> int:
        """How often a step evaluates all springs, if it does not solve."""
        return self.stages

    @classmethod
    def evaluations(cls, damped: bool) -> int:
        """How often a step of an explicit scheme evaluates all forces; `damped`: they read velocities."""
        return 1

    @classmethod
    def bound(cls, forces: tuple[Any, ...], drag: float) -> Bound:
        """The step that is safe with these forces as they are now."""
        return largest_dt(cls.amplification, cls.safety, [force.rates() for force in forces], drag)

    def automatic_dt(self, bound: Bound, frame_dt: float) -> float:
        """The step [s] that dt = "auto" asks for."""
        return bound.dt

    def fades_beyond(self, dt: float) -> float:
        """The frequency [Hz] beyond which undamped swings lose half of their amplitude within FADE, by steps of dt [s]
        alone; infinite if none do."""
        a = np.geomspace(1e-3, 50.0, 400)
        fades = spectral_radius(self.amplification(a, np.zeros(1))) < 0.5 ** (dt / FADE)
        return float(a[fades.argmax()] / (2.0 * np.pi * dt)) if fades.any() else float("inf")

    def tuned(self) -> None:
        """Numbers of a force have changed."""

    def remembered(self) -> dict[str, np.ndarray]:
        """What it needs besides x and v to go on to the same bits."""
        return {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Go on from where `memory` was asked for; with an empty one, from any state."""

    @classmethod
    def amplification(cls, a: np.ndarray, zeta: np.ndarray) -> np.ndarray:
        raise TypeError(f"{cls.__name__} must define amplification()")


def oscillator_matrix(step: Any, a: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """The 2×2 matrix of `step(x, v, a, acceleration)` -> (x, v), which is linear, by its effect on two states."""
    a, zeta = np.broadcast_arrays(np.asarray(a, float), np.asarray(zeta, float))

    def acceleration(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -x - 2.0 * zeta * v

    columns = [step(np.full_like(a, x), np.full_like(a, v), a, acceleration) for x, v in ((1.0, 0.0), (0.0, 1.0))]
    return np.stack([np.stack(column, -1) for column in columns], -1)
