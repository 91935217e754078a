"""The interface of forces on particles."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Scene


@dataclass(frozen=True)
class AddedMass:
    """A spring of `stiffness` [N/m] and `damping` [N·s/m] on particles of at least `least` [kg] each, to which it adds
    a mass [kg], shared out as its force is: see stable_step.py for the safe step."""

    stiffness: float
    damping: float
    mass: float
    least: float


@dataclass(frozen=True)
class Rates:
    """How fast a force can make the particles move, in every configuration.

    squared_frequency [1/s²] bounds the eigenvalues of M⁻¹K and damping [1/s] those of M⁻¹C from above; damping_time [s]
    bounds C/K from below on all that this force makes oscillate (infinity: nothing). added_mass: counted separately.
    """

    squared_frequency: float = 0.0
    damping: float = 0.0
    damping_time: float = float("inf")
    added_mass: AddedMass | None = None


@ti.func
def cut(whole, at, others):
    """Where a team cuts `others` if it cuts a `whole` of something else at `at`."""
    return ti.cast(ti.cast(at, ti.i64) * others // whole, ti.i32)


@ti.func
def block(across, along, n):
    """The symmetric matrix across·(I - nnᵀ) + along·nnᵀ for a unit vector n: its xx, yy, zz, yz, xz and xy."""
    b = along - across
    m = b * n
    return ti.Vector(
        [across + m[0] * n[0], across + m[1] * n[1], across + m[2] * n[2], m[1] * n[2], m[0] * n[2], m[0] * n[1]]
    )


@ti.func
def even_block(across):
    """The same for across·I."""
    return ti.Vector([across, across, across, 0.0, 0.0, 0.0])


class Capabilities:
    """What only some forces do. Each is off unless a force switches it on and defines the functions named here.

    in_passes: `on_pass(first, last, x, v, t, f)` adds the forces on the particles of one pass (see Memory.lanes) to f.
    prepares: `prepare(first, last, x, v, t)` runs before any force is asked for: one loop over its own `points`, each
        of which writes to its own place only; a team shares them out.
    has_curvature: for an implicit step of h [s], `curvature(i, x, v, t, h)` is a block (see `block`) [N/m] that bounds
        -∂f/∂x - ∂f/∂v / h, made symmetric and never negative, for particle i and what couples it to others.
    couples: the same as a matrix: `resist_on_pass(first, last, x, p, h, q)` adds its product with the displacements p
        to q, `hold(i, x, h)` is its diagonal block, `pairs(h)` are the particles (2, S) that it couples and a bound
        [N/m] for each pair; `generation` counts how often these have changed other than by `tune`. A force with
        neither is still applied where the step ends, but the solver does not know its slope.
    internal: it acts between the particles of a jello and keeps their momentum.
    adds_mass: it makes a few particles heavier. `accelerate(first, last, x, v, t, a)` corrects what all other forces
        give them, `added_mass(i)` [kg] and `on_held(i, x, v, t)` [N] are of one particle.
    ends_steps: `end_step(system, first, last, x, t)` runs when the particles first … last - 1 have reached x at the
        end of a step. What it keeps from step to step, `remembered()` returns and `recall(memory)` restores.
    sweep: continuous collision detection at the end of every step (see continuous_collision.py).
    works: names for the energy ledger of what dissipates in a force that also stores energy;
        `powers(i, x, v, t)` is a vector with particle i's share of each [W].
    """

    in_passes: bool = False
    prepares: bool = False
    points: int = 0
    has_curvature: bool = False
    couples: bool = False
    generation: int = 0
    internal: bool = False
    adds_mass: bool = False
    ends_steps: bool = False
    sweep: Any = None
    works: tuple[str, ...] = ()
    prepare: Any
    end_step: Any
    powers: Any
    accelerate: Any
    added_mass: Any
    on_held: Any


class ParticleForce(Capabilities):
    """A force on particles. `on(i, x, v, t)`, a ti.func, is the force [N] on particle i for the fields x and v of all
    particles, `t` seconds after the current frame began. If it stores energy, `energy_kind` says which and the ti.func
    `energy(i, x, t)` is particle i's share [J]."""

    title: ClassVar[str]
    energy_kind: ClassVar[str | None] = None
    reads_velocity: bool = False
    on: Any

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list[Any]:
        """What a scene needs of it: [] if nothing, so that nothing is compiled."""
        raise TypeError(f"{cls.__name__} must define made_for()")

    @property
    def acts(self) -> bool:
        """False while it does nothing."""
        return True

    def rates(self) -> Rates:
        return Rates()

    def tuning(self) -> dict[str, Any]:
        """The numbers of this force that may change while the simulation runs, by name."""
        return {}

    def tune(self, name: str, value: Any) -> None:
        """Change one of them; the kernels are not compiled anew."""
        raise TypeError(f"{type(self).__name__} must define tune()")

    def parts(self, x: np.ndarray, v: np.ndarray, frame_dt: float, dt: float) -> int:
        """In how many parts automatic steps of dt [s] are to be taken in a frame that begins at x and v (N, 3)."""
        return 1

    def set_state(self, state: Any) -> None:
        """Follow springs that have been torn: a SpringState."""

    def remembered(self) -> dict[str, np.ndarray]:
        """What a run needs besides x and v to go on to the same bits."""
        return {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Restore the moment of `memory`."""

    def begin_frame(self, start: float, end: float) -> None:
        """Bring live values up to date for the frame from `start` to `end` [s]."""


class MutualForce(ParticleForce):
    """Contact between jellos: forces that are equal and opposite, and the neighbour list they come from.

    Narrow phase: contacts are found once a step, in an implicit step at each evaluation. `find_contacts(r, system,
    first, last, x, v, ahead)`, a ti.func, is one of `rounds` rounds for the particles at x + ahead v; all members of
    the team finish a round before the next begins.

    Broad phase: `near`, a neighbour list (see neighbour_list.py), is valid until particles have moved too far. `fresh`
    says that it is valid as far as known, `forget()` invalidates it, `refresh(system, t, dt)` rebuilds it; the ti.func
    `watch(first, last, x, v, t, dt)` runs before each step and `stale()` then says whether the step must wait.

    Step size: `parts` is more than one only where something moves farther than `nearest` [m] in a step. With a `brake`
    (see inelastic_brake.py) deep contacts lose speed at the end of a step.
    """

    near: Any
    surface: Any
    rounds: int
    nearest: float
    fresh: Any
    brake: Any = None
    find_contacts: Any
    refresh: Any
    forget: Any
    watch: Any
    stale: Any
