"""What the implicit schemes share: each of their stages is one solve of x = z + c v, v = w + c a(x, v)."""

from typing import ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import Integrator
from taichi_jello.physics.solve.newton import Newton


def solved(z, w, c, acceleration):
    """(x, v) of that solve where the acceleration is linear, from its value at two velocities."""
    at_zero = acceleration(z, np.zeros_like(z))
    slope = acceleration(z + c, np.ones_like(z)) - at_zero
    v = (w + c * at_zero) / (1.0 - c * slope)
    return z + c * v, v


@ti.data_oriented
class Implicit(Integrator):
    """`stage` sets z and w of the solver and starts it; c = share·dt."""

    safety = 1.0
    solves = long_steps = True
    share: ClassVar[float]

    def __init__(self, memory, state, damped, body):
        self.state, self.number = state, memory.number
        self.solver = Newton(memory, body, accuracy=1e-3 if memory.owner.precision == "f32" else 1e-9)
        self.last_dt, self.prepared, self.generations = 0.0, False, []

    def prepare(self, system, dt):
        generations = [force.generation for force in system.all_forces]
        if not self.prepared or dt != self.last_dt or generations != self.generations:
            self.solver.prepare(system, self.share * dt)
        self.last_dt, self.prepared, self.generations = dt, True, generations

    def tuned(self):
        self.prepared = False

    @ti.func
    def finish(self, system, first, last, t, dt):
        system.stop_at_solids(first, last, self.state.x, self.solver.at.x, self.solver.at.v, t, dt)
        for i in range(first, last):
            self.state.x[i], self.state.v[i] = self.solver.at.x[i], self.solver.at.v[i]
