"""Alexander's two-stage SDIRK method of order 2, L-stable, with γ = 1 - 1/√2:

    V₁ = v + γ dt A₁                   at  X₁ = x + γ dt V₁,
    V₂ = v + (1-γ) dt A₁ + γ dt A₂     at  X₂ = x + (1-γ) dt V₁ + γ dt V₂.

The second stage is the end of the step."""

from math import sqrt
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import Acceleration, oscillator_matrix
from taichi_jello.physics.integrators.implicit_solve._implicit import Implicit, solve_linear

GAMMA = 1.0 - 1.0 / sqrt(2.0)


@ti.data_oriented
class SDIRK2(Implicit):
    name, order = "sdirk2", 2
    share = GAMMA
    stages = 2
    repeats_steps = True
    pushes = False  # whether there are accelerations `push` [m/s²] besides those by forces, constant within a step
    push: Any

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        """Where contacts have changed by the end of a stage, the step is repeated with backward Euler."""
        repeats, solves, c, share = 0, 1, GAMMA * dt, GAMMA + s * (1.0 - GAMMA)
        if ti.static(len(self.contacts) > 0):
            begins = ti.cast(s == 0, ti.i32)
            repeats = self.contacts_changed(system, first, last, t + ti.select(s == 1, GAMMA, 1.0) * dt, begins)
            already = self.repeated(system, first, last, repeats, begins)
            repeats = repeats & (1 - already)
            solves = repeats | ti.cast(s < 2, ti.i32) & (1 - already)
        if repeats:
            c, share = dt, 1.0
        for i in range(first, last):
            x, v = self.state.x[i], self.state.v[i]
            if s == 1 and repeats == 0:
                v1 = self.solver.at.v[i]
                x += (1.0 - GAMMA) * dt * v1
                v += (1.0 - GAMMA) / GAMMA * (v1 - v)  # (1-γ) dt A₁
            if ti.static(self.pushes):
                v += GAMMA * dt * self.push[i]
            if solves:
                self.solver.z[i] = x
                self.solver.w[i] = self.solver.at.v[i] = v
        self.solver.start(system, first, last, c, t + share * dt, solves)

    @classmethod
    def amplification(cls, a: np.ndarray, zeta: np.ndarray) -> np.ndarray:
        def step(x: Any, v: Any, h: Any, acceleration: Acceleration) -> Any:
            _, v1 = solve_linear(x, v, GAMMA * h, acceleration)
            before = v + (1.0 - GAMMA) / GAMMA * (v1 - v)
            return solve_linear(x + (1.0 - GAMMA) * h * v1, before, GAMMA * h, acceleration)

        return oscillator_matrix(step, a, zeta)
