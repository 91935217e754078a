"""The base of the implicit schemes: each stage solves x = z + c v, v = w + c a(x, v).

A scheme of order 2 that extrapolates a contact force past the moment of release feeds energy: dropped at 5 m/s with
one step a frame, SDIRK2 left the ground with up to 7 % more energy than before, BDF2 with 28 %. So a step in which a
contact begins or ends is repeated with backward Euler, which feeds none.
"""

from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import Acceleration, Integrator, serial
from taichi_jello.physics.integrators.implicit_solve.newton import Newton


def solve_linear(z: Any, w: Any, c: Any, acceleration: Acceleration) -> Any:
    """(x, v) of that stage for a linear acceleration, from its values at two velocities."""
    at_zero = acceleration(z, np.zeros_like(z))
    slope = acceleration(z + c, np.ones_like(z)) - at_zero
    v = (w + c * at_zero) / (1.0 - c * slope)
    return z + c * v, v


BEFORE, NOW, REPEATED = range(3)  # hash of the contacts at the start of the step and now; whether the step is repeated
MIX = 0x9E3779B  # a large odd number that mixes bits


@ti.func
def hashed(i):
    """A number for particle i such that hardly any two sets of particles have the same sum."""
    mixed = (i + 1) * MIX
    return (mixed ^ (mixed >> 15)) * MIX


@ti.data_oriented
class Implicit(Integrator):
    """`stage` sets z and w of the solver and starts it, with c = share·dt. repeats_steps: in one more stage, where
    `contacts` change."""

    safety = 1.0
    solves = long_steps = True
    repeats_steps = False
    share: ClassVar[float]

    def allocate(self) -> None:
        self.solver = Newton(self.memory, self.body)
        self.last_dt, self.prepared = 0.0, False
        self.generations: list[int] = []
        self.contacts: tuple[Any, ...] = ()

    def use_forces(self, forces: tuple[Any, ...]) -> None:
        if self.repeats_steps:
            self.contacts = tuple(force for force in forces if force.energy_kind == "contact")
        if self.contacts:
            self.stages += 1
            self.touching = self.memory.table(self.name, "contacts", np.zeros(3, np.int32))

    @ti.func
    def contacts_changed(self, system, first, last, t, begins=0):
        """Whether the contacts where the solve has ended, at t, differ from those at the start of the step; 0 if the
        step only `begins`."""
        system.wait_for_team()  # until every thread has read the last hash
        if serial(first, last):
            self.touching[NOW] = 0
        system.wait_for_team()
        end = ti.select(begins, first, last)
        for i in range(first, end):
            stored = ti.cast(0.0, float)
            for force in ti.static(self.contacts):
                stored += force.energy(i, self.solver.at.x, t)
            if stored > 0.0:
                ti.atomic_add(self.touching[NOW], hashed(i))
        system.wait_for_team()
        return ti.cast(begins == 0 and self.touching[NOW] != self.touching[BEFORE], ti.i32)

    @ti.func
    def repeated(self, system, first, last, repeats, begins):
        """Whether this step has been repeated already; notes that it now `repeats`."""
        already = self.touching[REPEATED] * (1 - begins)
        system.wait_for_team()
        if serial(first, last):
            self.touching[REPEATED] = already | repeats
        return already

    @ti.func
    def keep_contacts(self, system, first, last):
        """The contacts at the end of this step are those at the start of the next."""
        system.wait_for_team()
        if serial(first, last):
            self.touching[BEFORE] = self.touching[NOW]

    def remembered(self) -> dict[str, np.ndarray]:
        return {"touching": np.array(self.touching[BEFORE])} if self.contacts else {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        if self.contacts:
            self.touching[BEFORE] = int(memory.get("touching", 0))

    def prepare(self, system: Any, dt: float) -> None:
        generations = [force.generation for force in system.all_forces]
        if not self.prepared or generations != self.generations:
            self.solver.preconditioner.forget()
            self.prepared = False
        if not self.prepared or dt != self.last_dt:
            self.solver.prepare(system, self.share * dt)
        self.last_dt, self.prepared, self.generations = dt, True, generations

    def tuned(self) -> None:
        self.prepared = False

    @ti.func
    def finish(self, system, first, last, t, dt):
        if ti.static(len(self.contacts) > 0):
            self.contacts_changed(system, first, last, t + dt)
            self.keep_contacts(system, first, last)
        system.stop_at_solids(first, last, self.state.x, self.solver.at.x, self.solver.at.v, t, dt)
        for i in range(first, last):
            self.state.x[i], self.state.v[i] = self.solver.at.x[i], self.solver.at.v[i]
