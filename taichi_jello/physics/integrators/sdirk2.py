"""Alexander's two-stage SDIRK method of order 2, L-stable: both stages solve with c = γ dt, γ = 1 - 1/√2."""

from math import sqrt

import taichi as ti

from taichi_jello.physics.integrators._base import oscillator_matrix
from taichi_jello.physics.integrators.implicit_solve._implicit import Implicit, solved

GAMMA = 1.0 - 1.0 / sqrt(2.0)


@ti.data_oriented
class SDIRK2(Implicit):
    """V₁ = v + γ dt A₁ at X₁ = x + γ dt V₁; then V₂ = v + (1-γ) dt A₁ + γ dt A₂ at X₂ = x + (1-γ) dt V₁ + γ dt V₂.
    The second stage is the end of the step."""

    name, order = "sdirk2", 2
    share = GAMMA
    stages = 2

    def meet(self, forces):
        self.watch_contact(forces)

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        """Where a stage has ended with another contact than the step began with, the step is one of backward Euler."""
        again, wanted, c, share = 0, 1, GAMMA * dt, GAMMA + s * (1.0 - GAMMA)
        if ti.static(len(self.contacts) > 0):
            begins = ti.cast(s == 0, ti.i32)
            again = self.strikes(system, first, last, t + ti.select(s == 1, GAMMA, 1.0) * dt, begins)
            made = self.once(system, first, last, again, begins)
            again = again & (1 - made)
            wanted = again | ti.cast(s < 2, ti.i32) & (1 - made)
        if again:
            c, share = dt, 1.0
        for i in range(first, last):
            x, v = self.state.x[i], self.state.v[i]
            if s == 1 and again == 0:
                v1 = self.solver.at.v[i]
                x += (1.0 - GAMMA) * dt * v1
                v += (1.0 - GAMMA) / GAMMA * (v1 - v)
            if wanted:
                self.solver.z[i] = x
                self.solver.w[i] = self.solver.at.v[i] = v
        self.solver.start(system, first, last, c, t + share * dt, wanted)

    @classmethod
    def amplification(cls, a, zeta):
        return oscillator_matrix(sdirk2_step, a, zeta)


def sdirk2_step(x, v, h, acceleration):
    _, v1 = solved(x, v, GAMMA * h, acceleration)
    before = v + (1.0 - GAMMA) / GAMMA * (v1 - v)
    return solved(x + (1.0 - GAMMA) * h * v1, before, GAMMA * h, acceleration)
