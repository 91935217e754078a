"""Explicit Runge–Kutta methods: the method is its tableau, this is the one engine for all of them."""

from typing import ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import Integrator, oscillator_matrix
from taichi_jello.physics.state import State


@ti.data_oriented
class RungeKutta(Integrator):
    """Stage s is evaluated at t + c[s] dt from x + dt Σ a[s][j] k_j; the step is x + dt Σ b[j] k_j (Butcher tableau;
    c[s] = Σ a[s][j])."""

    a: ClassVar[tuple[tuple[float, ...], ...]]
    b: ClassVar[tuple[float, ...]]

    def __init__(self, memory, state, damped):
        self.state, self.stages = state, len(self.b)
        square = [[*row, *[0.0] * (self.stages - len(row))] for row in self.a]
        # The whole tableau in one table: the rows of a, then b, then c.
        self.tableau = memory.table(self.name, "tableau", np.array([*square, self.b, np.sum(square, 1)]).ravel())
        self.lanes, self.Lanes = memory.lanes, memory.lane_vector
        self.at = State.made_in(memory, f"{self.name} stage")
        self.acceleration = memory.vectors(f"{self.name} stage", "a")
        self.slopes_x = memory.vectors(self.name, "slopes of x", self.stages)
        self.slopes_v = memory.vectors(self.name, "slopes of v", self.stages)

    @ti.func
    def combine(self, p, dt, start: ti.template(), slopes: ti.template(), row, count, out: ti.template()):
        """out = start + dt Σ w[s] slopes[s] over the first `count` stages, w the tableau's row, for pass p's particles."""
        x, y, z = self.Lanes(0.0), self.Lanes(0.0), self.Lanes(0.0)
        first = p * self.lanes
        for s in range(count):
            weight = self.tableau[row * self.stages + s]
            for lane in range(self.lanes):
                slope = slopes[s, first + lane]
                x[lane] += weight * slope[0]
                y[lane] += weight * slope[1]
                z[lane] += weight * slope[2]
        for lane in range(self.lanes):
            out[first + lane] = start[first + lane] + dt * ti.Vector([x[lane], y[lane], z[lane]])

    @ti.func
    def stage(self, system, s, t, dt):
        for p in range(system.passes):
            self.combine(p, dt, self.state.x, self.slopes_x, s, s, self.at.x)
            self.combine(p, dt, self.state.v, self.slopes_v, s, s, self.at.v)
        c = self.tableau[(self.stages + 1) * self.stages + s]
        system.accelerations(self.at.x, self.at.v, t + c * dt, self.acceleration)
        for i in range(system.count):
            self.slopes_x[s, i] = self.at.v[i]
            self.slopes_v[s, i] = self.acceleration[i]

    @ti.func
    def finish(self, system, t, dt):
        for p in range(system.passes):
            self.combine(p, dt, self.state.x, self.slopes_x, self.stages, self.stages, self.state.x)
            self.combine(p, dt, self.state.v, self.slopes_v, self.stages, self.stages, self.state.v)

    @classmethod
    def amplification(cls, a, zeta):
        def step(x, v, h, acceleration):
            slopes: list[tuple[np.ndarray, np.ndarray]] = []
            for row in cls.a:
                xs = x + h * sum((w * k[0] for w, k in zip(row, slopes, strict=True)), np.zeros_like(x))
                vs = v + h * sum((w * k[1] for w, k in zip(row, slopes, strict=True)), np.zeros_like(v))
                slopes.append((vs, acceleration(xs, vs)))
            x = x + h * sum(w * k[0] for w, k in zip(cls.b, slopes, strict=True))
            v = v + h * sum(w * k[1] for w, k in zip(cls.b, slopes, strict=True))
            return x, v

        return oscillator_matrix(step, a, zeta)
