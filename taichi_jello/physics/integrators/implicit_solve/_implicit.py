"""What the implicit schemes share: each of their stages is one solve of x = z + c v, v = w + c a(x, v).

Contact pushes and never pulls. A scheme of second order that goes on with a push from before it let go, as if it still
pressed, feeds energy: dropped at 5 m/s onto the ground with one step a frame, SDIRK2 came off it with up to 7 % more
than it had, BDF2 with 28 % in several steps. So a step in which anything comes to touch or lets go is made again as one
of backward Euler, which feeds none. Between these steps the order is what it was.
"""

from typing import ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import Integrator
from taichi_jello.physics.integrators.implicit_solve.newton import Newton


def solved(z, w, c, acceleration):
    """(x, v) of that solve where the acceleration is linear, from its value at two velocities."""
    at_zero = acceleration(z, np.zeros_like(z))
    slope = acceleration(z + c, np.ones_like(z)) - at_zero
    v = (w + c * at_zero) / (1.0 - c * slope)
    return z + c * v, v


BEFORE, NOW, AGAIN = range(3)  # sums over what touches as a step begins and now; whether the step is made again
MIX = 0x9E3779B  # a large odd number that mixes bits


@ti.func
def weight(i):
    """A number for particle i such that hardly any other set of particles has the same sum."""
    mixed = (i + 1) * MIX
    return (mixed ^ (mixed >> 15)) * MIX


@ti.data_oriented
class Implicit(Integrator):
    """`stage` sets z and w of the solver and starts it; c = share·dt. `contacts`: the forces that come and go."""

    safety = 1.0
    solves = long_steps = True
    share: ClassVar[float]

    def __init__(self, memory, state, damped, body):
        self.state, self.number = state, memory.number
        accuracy = 1e-3 if memory.owner.precision == "f32" else 1e-9
        self.solver = Newton(memory, body, accuracy)
        self.last_dt, self.prepared, self.generations = 0.0, False, []
        self.memory, self.contacts = memory, ()

    def watch_contact(self, forces):
        """Let steps be made again that change what touches, if anything can: in one stage more."""
        self.contacts = tuple(force for force in forces if force.energy_kind == "contact")
        if self.contacts:
            self.stages += 1
            self.touching = self.memory.table(self.name, "what touches", np.zeros(3, np.int32))

    @ti.func
    def strikes(self, system, first, last, t, begins=0):
        """Whether what touches where the solve has ended, at t, is not what touched when the step began. Not asked for
        while the step only `begins`."""
        system.wait_for_team()  # until everybody has read what was there
        for _ in range(1):
            if first == 0 and last > 0:
                self.touching[NOW] = 0
        system.wait_for_team()
        upto = ti.select(begins, first, last)
        for i in range(first, upto):
            stored = ti.cast(0.0, float)
            for force in ti.static(self.contacts):
                stored += force.energy(i, self.solver.at.x, t)
            if stored > 0.0:
                ti.atomic_add(self.touching[NOW], weight(i))
        system.wait_for_team()
        return ti.cast(begins == 0 and self.touching[NOW] != self.touching[BEFORE], ti.i32)

    @ti.func
    def once(self, system, first, last, wanted, begins):
        """Whether a step that is wanted to be made again has been before."""
        made = self.touching[AGAIN] * (1 - begins)
        system.wait_for_team()
        for _ in range(1):
            if first == 0 and last > 0:
                self.touching[AGAIN] = made | wanted
        return made

    @ti.func
    def end_touch(self, system, first, last):
        """Where the step ends the next one begins."""
        system.wait_for_team()
        for _ in range(1):
            if first == 0 and last > 0:
                self.touching[BEFORE] = self.touching[NOW]

    def remembered(self):
        return {"touching": np.array(self.touching[BEFORE])} if self.contacts else {}

    def recall(self, memory):
        if self.contacts:
            self.touching[BEFORE] = int(memory.get("touching", 0))

    def prepare(self, system, dt):
        generations = [force.generation for force in system.all_forces]
        if not self.prepared or generations != self.generations:
            self.solver.inner_solver.forget()
        if not self.prepared or dt != self.last_dt or generations != self.generations:
            self.solver.prepare(system, self.share * dt)
        self.last_dt, self.prepared, self.generations = dt, True, generations

    def tuned(self):
        self.prepared = False

    @ti.func
    def finish(self, system, first, last, t, dt):
        if ti.static(len(self.contacts) > 0):
            self.strikes(system, first, last, t + dt)
            self.end_touch(system, first, last)
        system.stop_at_solids(first, last, self.state.x, self.solver.at.x, self.solver.at.v, t, dt)
        for i in range(first, last):
            self.state.x[i], self.state.v[i] = self.solver.at.x[i], self.solver.at.v[i]
