"""What every force on particles offers to the system."""

from dataclasses import dataclass
from typing import Any, ClassVar

import taichi as ti

from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Scene


@dataclass(frozen=True)
class Burden:
    """A spring of stiffness k [N/m] and damping c [N·s/m] on particles of at least `least` [kg] each, to which it adds
    a mass M [kg] that it shares out as its force: see stable_step.py for what that does to the step."""

    k: float
    c: float
    mass: float
    least: float


@dataclass(frozen=True)
class Rates:
    """How fast a force can make the particles move, in whatever configuration.

    squared_frequency [1/s²] bounds the eigenvalues of M⁻¹K and damping [1/s] those of M⁻¹C from above;
    damping_time [s] bounds C/K from below on all that this force makes swing (infinity if it makes nothing swing).
    burden: what of the force brings a mass of its own, not counted in the others.
    """

    squared_frequency: float = 0.0
    damping: float = 0.0
    damping_time: float = float("inf")
    burden: Burden | None = None


@ti.func
def cut(whole, at, others):
    """Where `others` are cut for the members of a team if the `whole` of something else is cut at `at`."""
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


class ParticleForce:
    """A force on single particles. A subclass answers in `made_for` what a scene needs of it: often nothing.

    It defines `@ti.func on(self, i, x, v, t)`, the force [N] on particle i for the fields x, v of all particles at
    `t` seconds after the current frame began, or, with `in_passes`, `@ti.func on_pass(self, first, last, x, v, t, f)`,
    which adds the forces on the particles first … last - 1 of one pass (see Memory.lanes) to f; and, if `energy_kind`
    is set, `@ti.func energy(self, i, x, t)` [J].

    With `prepares` it also defines `points`, a whole number, and `@ti.func prepare(self, first, last, x, v, t)`, one
    loop over its own points first … last - 1, each of which writes to its own place only. The members of a team
    share the points, and all of them are done before any force on a particle is asked for.

    With `burdens` it also acts on a few particles that it makes heavier. It defines `@ti.func load(self, first, last,
    x, v, t, a)`, which changes the accelerations a that all else gives those of them among first … last - 1; and for
    one particle `@ti.func added_mass(self, i)` [kg] and `@ti.func on_held(self, i, x, v, t)`, its force [N].

    For implicit steps of length c [s] it also offers how it stiffens the step, -∂f/∂x - ∂f/∂v / c, made symmetric and
    never negative: with `has_curvature`, `@ti.func curvature(self, i, x, v, t, c)`, the 3×3 block [N/m] of particle i,
    six numbers as `block` gives them, which must bound what ties i to others as well; or, with `couples`, `@ti.func
    resist_on_pass(self, first, last, x, p, c, q)`, which adds its product with the displacements p to q, `@ti.func
    hold(self, i, x, c)`, the block that this has for particle i, and `pairs(c)`, the particles (i, j) that it ties
    together and the most that it stiffens each pair by; `generation` counts how often these have changed, other than
    by `tune`. A force with neither still acts at the end of the step, but the solve does not see it coming.

    `acts`: False while it does nothing, as a hand that is open.

    With a `sweep` (see continuous_collision.py) every step ends with a look whether it went through something.

    For the energy ledger (see physics/energy_ledger.py) a force that stores energy and also has losses names these in
    `works` and defines `@ti.func powers(self, i, x, v, t)`, a vector with particle i's share of each [W].
    """

    title: ClassVar[str]
    energy_kind: ClassVar[str | None] = None
    reads_velocity: bool = False
    in_passes: bool = False
    prepares: bool = False
    burdens: bool = False
    points: int = 0
    has_curvature: bool = False
    couples: bool = False
    generation: int = 0
    acts: bool = True
    sweep: Any = None
    works: tuple[str, ...] = ()
    prepare: Any
    on: Any
    powers: Any
    load: Any
    added_mass: Any
    on_held: Any

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list[Any]:
        raise TypeError(f"{cls.__name__} must define made_for()")

    def rates(self) -> Rates:
        return Rates()

    def tuning(self) -> dict[str, Any]:
        """The numbers of this force that may change while the simulation runs, by name."""
        return {}

    def tune(self, name: str, value: Any) -> None:
        """Change one of them; the kernels are not compiled anew."""
        raise TypeError(f"{type(self).__name__} must define tune()")

    def begin_frame(self, start: float, end: float) -> None:
        """Bring live values up to date for the frame from `start` to `end` [s]."""


class MutualForce(ParticleForce):
    """A force between jellos: what it does to some particles it does to others the other way.

    It finds what touches once a step, for all evaluations of the step; where a step is solved for, at each evaluation.
    It defines `rounds` and `@ti.func look(self, r: ti.template(), system, first, last, x, v, ahead)`, one round of
    looking at the particles at x + ahead v, by the member of the team whose particles are first … last - 1 (it cuts
    what else there is by `system.share_of`); all members have done a round before the next one begins.

    It keeps for many steps what is `near` (see neighbour_list.py), which is right as long as the particles have not
    moved too far. It defines `fresh`, whether it is right to its knowledge; `forget()`, after which it is not;
    `refresh(system, t, dt)`, which brings it up to date for the state of the system `t` seconds after the current frame
    began and steps of dt [s]; `@ti.func watch(self, first, last, x, v, t, dt)`, which before each step looks whether
    one of the particles first … last - 1 may move too far in it; and `@ti.func stale(self)`, whether any may: then the
    step has to wait.

    It may need a frame's steps taken in parts: `parts(x, v, frame_dt, dt)` says in how many, for the frame that begins
    with the particles at x and v, (N, 3) arrays. `nearest` [m]: the way beyond which a step is taken in parts.
    `stride(dt, solves, damping)` tells it how long the steps are that follow, whether they are solved for, and how fast
    [1/s] dashpots can damp. With a `brake` (see inelastic_brake.py) what has gone deep into something loses speed at
    the end of a step.
    """

    near: Any
    surface: Any
    rounds: int
    nearest: float
    fresh: Any
    brake: Any = None
    look: Any
    refresh: Any
    forget: Any
    watch: Any
    stale: Any
    parts: Any
    stride: Any
