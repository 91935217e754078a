"""System: a scene's bodies and forces as Taichi fields and kernels, with only what the scene has."""

from dataclasses import replace
from math import ceil
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics import forces as force_folder
from taichi_jello.physics.energies import Probe
from taichi_jello.physics.energy_ledger import Ledger
from taichi_jello.physics.forces._base import MutualForce, ParticleForce
from taichi_jello.physics.forces.field import CallableField, GridField
from taichi_jello.physics.forces.springs.changes_over_time import Changes
from taichi_jello.physics.forces.springs.hooke import Springs
from taichi_jello.physics.forces.springs.packing import reach
from taichi_jello.physics.integrators import scheme
from taichi_jello.physics.integrators._base import Integrator
from taichi_jello.physics.integrators.energy_limits.heat import Heat
from taichi_jello.physics.last_good import LastGood
from taichi_jello.physics.moving_pins import Handles
from taichi_jello.physics.particles import Particles
from taichi_jello.physics.stable_step import Bound
from taichi_jello.physics.state import Memory, State
from taichi_jello.physics.team import Team
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.support import runtime
from taichi_jello.support.plugins import classes

MOVES_ORIGIN = 256.0  # m from the world's origin, where f32 has steps of 0.03 mm


def force_kinds() -> list[type[ParticleForce]]:
    """Every kind of force, found in its folder."""
    return classes(force_folder, ParticleForce)


@ti.data_oriented
class System(Team):
    """All particles of `body` under the forces that `scene` needs, stepped by one scheme: `method` is its name, its
    class or chooses it (see run/auto_method.py).

    team: how many threads at most share the loop over a frame's substeps, each with its own particles, waiting for each
    other between the stages: the form for a CPU. 0: parallel tasks for every stage, the form for a GPU. All give the
    same bits; by default chosen by arch, threads and size.
    """

    def __init__(
        self,
        scene: Scene,
        body: Body,
        *,
        method: str | type[Integrator] | Any,
        team: int | None = None,
        ledger: bool = False,
    ):
        super().__init__(Memory(len(body), reach(body), runtime.current()), team)
        self.origin = self._choose_origin(scene, body)
        if self.origin.any():
            body = replace(body, x=body.x - self.origin)
        v = np.where(body.pinned[:, None], 0.0, body.v)
        self.state = State.made_in(self.memory, "state", body.x, v)
        self.good = LastGood(self.memory, self.state, self.team, body.x, v)
        self.particles = Particles(body, self.memory, self.origin)
        self._make_forces(scene, body)
        damped = any(force.reads_velocity for force in self.all_forces)
        if isinstance(method, str):
            method = scheme(method)
        Scheme = method if isinstance(method, type) else method.scheme(self.all_forces, damped)
        self.integrator: Integrator = Scheme(self.memory, self.state, damped, body)
        self.integrator.use_forces(self.all_forces)
        for sweep in self.sweeps:
            sweep.whole = self.integrator.long_steps
        self.handles = Handles(scene, body)
        self.ledger: Any = Ledger(self.all_forces, self.memory, len(self.handles.held) > 0) if ledger else None
        self.books = self.ledger is not None and self.ledger.columns > 0
        self.probe, self.stepper = Probe(self), self.integrator.make_stepper(self)
        self.memory.fill()
        self.changes = Changes(scene, body, list(self.all_forces))
        self.parts = 1  # that each step of the current frame is taken in
        self.drag, self.mass = scene.drag, float(body.mass.sum())
        self.find_bound()

    def _make_forces(self, scene: Scene, body: Body) -> None:
        """The forces that the scene needs, sorted by what they can do (see ParticleForce)."""
        made = {kind: kind.made_for(scene, self.particles) for kind in force_kinds()}
        self.absent = [kind.title for kind, found in made.items() if not found]
        self.all_forces = tuple(force for found in made.values() for force in found)
        springs = next((force for force in self.all_forces if isinstance(force, Springs)), None)
        self.heat = Heat(self, springs, body) if springs else None
        self.springs_first = springs is not None
        passes = [force for force in self.all_forces if force.in_passes]
        self.in_passes = tuple(sorted(passes, key=lambda force: force is not springs))
        self.one_by_one = tuple(force for force in self.all_forces if not force.in_passes)
        self.prepared = tuple(force for force in self.all_forces if force.prepares)
        self.adding_mass = tuple(force for force in self.all_forces if force.adds_mass)
        self.ending_steps = tuple(force for force in self.all_forces if force.ends_steps)
        self.sweeps = tuple(force.sweep for force in self.all_forces if force.sweep)
        self.mutual = tuple(force for force in self.all_forces if isinstance(force, MutualForce))
        self.brakes = tuple(force.brake for force in self.mutual if force.brake)
        self.rounds = max((force.rounds for force in self.mutual), default=0)
        outer = [f for f in self.all_forces if f.has_curvature and not f.internal and f not in self.mutual]
        self.closed = bool(self.mutual) and not outer and not body.pinned.any()  # jellos can touch only each other

    @staticmethod
    def _choose_origin(scene: Scene, body: Body) -> np.ndarray:
        """(3,) [m] of the positions in fields: the middle of a body far from the world's origin, in whole metres, for
        f32. Force fields and changes of gravity need positions in the world."""
        in_world = any(isinstance(force, (GridField, CallableField)) for force in scene.force)
        middle = np.round(body.x.mean(0))
        return np.zeros(3) if in_world or scene.keyframe or np.abs(middle).max() < MOVES_ORIGIN else middle

    def find_bound(self) -> None:
        """Find the safe step of the forces as they are now."""
        self.rates = [force.rates() for force in self.all_forces]
        self.bound: Bound = self.integrator.bound(self.all_forces, self.drag)

    @property
    def tuning(self) -> dict[str, Any]:
        """The numbers that may change while the simulation runs."""
        return {name: value for force in self.all_forces for name, value in force.tuning().items()}

    def tune(self, **numbers: Any) -> None:
        """Change some of `tuning`; the safe step follows. Raises ValueError for what the scene does not have."""
        for name, value in numbers.items():
            owners = [force for force in self.all_forces if name in force.tuning()]
            if not owners:
                raise ValueError(f"{name}: expected one of {', '.join(self.tuning)}")
            if not np.isfinite(value).all() or (np.ndim(value) == 0 and value < 0.0):
                raise ValueError(f"{name}: expected finite numbers, not negative, got {value!r}")
            for force in owners:
                force.tune(name, value)
        self.integrator.tuned()
        self.find_bound()

    @ti.func
    def accelerations(self, first, last, x, v, t, a, finds_contacts: ti.template() = False):
        """a = f(x, v, t)/m for the particles first … last - 1, f the sum of the forces the scene has, with contacts
        found anew at x if `finds_contacts`, as for a long implicit step.

        (Everywhere in the step `f[i] = f[i] + …`, since Taichi makes `f[i] += …` an atomic addition in a parallel
        loop: measured, it halves the speed.)"""
        if ti.static(finds_contacts):
            self.find_contacts(first, last, x, v, 0.0)
        self.wait_for_team()  # until x and v of all particles are there
        if ti.static(len(self.prepared) > 0):
            for force in ti.static(self.prepared):
                force.prepare(self.share_of(first, force.points), self.share_of(last, force.points), x, v, t)
            self.wait_for_team()  # until what the forces prepare is there
        for p in range(first // self.lanes, (last + self.lanes - 1) // self.lanes):
            start = p * self.lanes
            end = ti.min(start + self.lanes, last)
            if ti.static(not self.springs_first):
                for i in range(start, end):
                    a[i] = ti.Vector([0.0, 0.0, 0.0])
            for force in ti.static(self.in_passes):
                force.on_pass(start, end, x, v, t, a)
            for i in range(start, end):
                total = a[i]
                for force in ti.static(self.one_by_one):
                    total += force.on(i, x, v, t)
                a[i] = total * self.particles.inverse_mass(i)
        for force in ti.static(self.adding_mass):
            force.accelerate(first, last, x, v, t, a)
        self.wait_for_team()  # until nobody needs x and v any more

    @ti.func
    def stop_at_solids(self, first, last, x0, x, v, t, dt, drifted: ti.template() = False):
        """At the end of a step from x0 to x and v, or, drifted, to x by dt v: take back what passed through a thin
        solid. Returns whether anything did."""
        stopped = 0
        for sweep in ti.static(self.sweeps):
            stopped = stopped | sweep.stop(self, first, last, x0, x, v, t, dt, drifted)
        return stopped

    @ti.func
    def end_step(self, first, last, t):
        """Move the anchors of friction at the end of a step."""
        for force in ti.static(self.ending_steps):
            force.end_step(self, first, last, self.state.x, t)

    @ti.func
    def brake(self, first, last):
        """Slow down deep contacts at the end of a step."""
        for brake in ti.static(self.brakes):
            brake.brake(self, first, last, self.state.x, self.state.v)

    @ti.func
    def find_contacts(self, first, last, x, v, ahead):
        """Find contacts between jellos at x + ahead v, with the team's share of the particles first … last - 1."""
        for r in ti.static(range(self.rounds)):
            self.wait_for_team()  # until x and v of all particles, and then what the last round found, are there
            for force in ti.static(self.mutual):
                if ti.static(r < force.rounds):
                    force.find_contacts(r, self, first, last, x, v, ahead)

    @ti.func
    def inertia(self, i):
        """The mass [kg] of particle i and what forces add to it."""
        m = self.particles.mass(i)
        for force in ti.static(self.adding_mass):
            m += force.added_mass(i)
        return m

    def steps(self, first: int, last: int, dt: float) -> None:
        """Substeps `first` to `last` of the current frame, dt [s] each, in `parts`: see Stepper.one_step."""
        self.stepper.take(first * self.parts, last * self.parts, dt / self.parts)

    def get_ready(self, integrator: Integrator, dt: float) -> None:
        """Prepare for steps of dt [s] by `integrator`."""
        if integrator.solves:
            integrator.prepare(self, dt)
        for sweep in self.sweeps:
            sweep.check_speed(self.good.v, dt)

    def refresh(self, t: float, dt: float) -> None:
        """Rebuild the neighbour lists that are not known to be valid."""
        for force in self.mutual:
            if not force.fresh:
                force.refresh(self, t, dt)

    def forget(self) -> None:
        """Invalidate all neighbour lists."""
        for force in self.mutual:
            force.forget()

    def begin_frame(
        self, start: float, end: float, within: bool = False, dt: float = 0.0, automatic: bool = False
    ) -> float:
        """Bring live values up to date for the frame from `start` to `end` [s], with steps of dt [s], by default one;
        within: it has begun already. `automatic` steps may be taken in parts. Returns the kinetic energy [J] that
        handles gain as their speed changes."""
        gained = 0.0
        if not within:
            if len(self.handles.held):
                gained = self._move_handles(start, end)
            self.parts = self._choose_parts(end - start, dt) if automatic else 1
        self.changes.begin(start, self.good.x)
        for force in self.all_forces:
            force.begin_frame(start, end)
        self.refresh(0.0, (dt or end - start) / self.parts)
        return gained

    def _move_handles(self, start: float, end: float) -> float:
        x, v, held, gained = self.good.x.copy(), self.good.v.copy(), self.handles.held, 0.0
        x[held], v[held] = self.handles.motion(start, end)
        if not (np.array_equal(x, self.good.x) and np.array_equal(v, self.good.v)):
            gained = self.handles.kinetic(v) - self.handles.kinetic(self.good.v)
            self.good.set(x, v)
            self.forget()
        return gained

    def _choose_parts(self, frame_dt: float, dt: float) -> int:
        """In how many parts automatic steps of dt [s] are taken in the frame that begins."""
        asked = [force.parts(self.good.x, self.good.v, frame_dt, dt) for force in self.all_forces]
        if dt > self.bound.wild_dt * (1.0 + 1e-9) and self.heat and self.heat.wild():
            asked.append(ceil(dt / self.bound.wild_dt * (1.0 - 1e-9)))
        return max(asked, default=1)

    def remembered(self, within: bool) -> dict[str, np.ndarray]:
        """What a run needs besides x and v to go on from here to the same bits; `within` a frame that has begun."""
        memory = {"parts": np.array(self.parts)} if within and self.parts > 1 else {}
        for force in self.all_forces:
            memory |= force.remembered()
        return memory

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Restore the moment of `memory`."""
        self.parts = int(memory.get("parts", 1))
        for force in self.all_forces:
            force.recall(memory)

    def write(self, x: np.ndarray, v: np.ndarray) -> None:
        """Set the state, (N, 3) each."""
        self.good.set(x - self.origin if self.origin.any() else x, v)
        self.forget()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """The last good state, x and v, (N, 3) each; x in float64 if it is far from the world's origin."""
        x, v = self.good.x.copy(), self.good.v.copy()
        return (x + self.origin if self.origin.any() else x), v

    def keep_if_finite(self) -> int | None:
        """Keep the state as good, or go back; see LastGood.keep."""
        bad = self.good.keep()
        if bad is not None:
            self.forget()
        return bad

    def energies(self, t: float) -> dict[str, float]:
        """Kinetic, elastic, gravity and contact energy [J] `t` seconds after the current frame began."""
        found = self.probe.energies(t)
        if self.origin.any() and "gravity" in self.tuning:
            found["gravity"] -= self.mass * float(np.dot(self.tuning["gravity"], self.origin))
        return found
