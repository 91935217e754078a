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
        self.mean = State.made_in(memory, f"{self.name} mean slope")

    @ti.func
    def go_to(self, system, s, dt):
        """at = state + dt Σ a[s][j] slopes[j]."""
        if ti.static(self.lanes > 1):
            self.go_to_in_passes(system, s, dt)
        else:
            for i in range(system.count):
                x, v = self.state.x[i], self.state.v[i]
                for j in range(s):
                    weight = dt * self.tableau[s * self.stages + j]
                    x += weight * self.slopes_x[j, i]
                    v += weight * self.slopes_v[j, i]
                self.at.x[i], self.at.v[i] = x, v

    @ti.func
    def go_to_in_passes(self, system, s, dt):
        """The same for a CPU: the inner loop is vectorised (see Memory.lanes). Not for a GPU, since Taichi's SPIR-V
        code allows one loop with local arrays a kernel, and the springs' is that one."""
        for p in range(system.passes):
            x, y, z = self.Lanes(0.0), self.Lanes(0.0), self.Lanes(0.0)
            u, v, w = self.Lanes(0.0), self.Lanes(0.0), self.Lanes(0.0)
            first = p * self.lanes
            for j in range(s):
                weight = dt * self.tableau[s * self.stages + j]
                if weight != 0.0:
                    for lane in range(self.lanes):
                        i = first + lane
                        x[lane] += weight * self.slopes_x[j, i][0]
                        y[lane] += weight * self.slopes_x[j, i][1]
                        z[lane] += weight * self.slopes_x[j, i][2]
                        u[lane] += weight * self.slopes_v[j, i][0]
                        v[lane] += weight * self.slopes_v[j, i][1]
                        w[lane] += weight * self.slopes_v[j, i][2]
            for i in range(first, ti.min(first + self.lanes, system.count)):
                lane = i - first
                self.at.x[i] = self.state.x[i] + ti.Vector([x[lane], y[lane], z[lane]])
                self.at.v[i] = self.state.v[i] + ti.Vector([u[lane], v[lane], w[lane]])

    @ti.func
    def stage(self, system, s, t, dt):
        self.go_to(system, s, dt)
        c = self.tableau[(self.stages + 1) * self.stages + s]
        system.accelerations(self.at.x, self.at.v, t + c * dt, self.acceleration)
        for i in range(system.count):
            weight = self.tableau[self.stages * self.stages + s]
            self.slopes_x[s, i] = self.at.v[i]
            self.slopes_v[s, i] = self.acceleration[i]
            self.mean.x[i] = self.mean.x[i] + weight * self.at.v[i]
            self.mean.v[i] = self.mean.v[i] + weight * self.acceleration[i]

    @ti.func
    def finish(self, system, t, dt):
        for i in range(system.count):
            self.state.x[i] = self.state.x[i] + dt * self.mean.x[i]
            self.state.v[i] = self.state.v[i] + dt * self.mean.v[i]
            self.mean.x[i] = ti.Vector([0.0, 0.0, 0.0])
            self.mean.v[i] = ti.Vector([0.0, 0.0, 0.0])

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
