"""Explicit Runge–Kutta methods: a scheme is a tableau, this class steps any of them."""

from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import Acceleration, Integrator, oscillator_matrix
from taichi_jello.physics.state import State


@ti.data_oriented
class RungeKutta(Integrator):
    """Stage s evaluates the accelerations k_s at t + c_s dt, and the step ends with the weights b (Butcher tableau):

        v_s = v + dt Σ a_sj k_j,    x_s = x + c_s dt v + dt² Σ (a²)_sj k_j,    c_s = Σ a_sj.

    x_s follows from the same k because the slope of x is the v of the stage (Nyström's form); for the end of the step
    the last weights are b a."""

    a: ClassVar[tuple[tuple[float, ...], ...]]
    b: ClassVar[tuple[float, ...]]
    has_begin = True

    def allocate(self) -> None:
        memory, self.stages = self.memory, len(self.b)
        self.search_at = 0.5 if self.stages > 1 else 0.0
        rows = np.array([[*row, *[0.0] * (self.stages - len(row))] for row in (*self.a, self.b)])
        both = np.stack([rows @ rows[:-1], rows], -1)
        self.lanes, self.Lanes = memory.lanes, memory.lane_vector
        self.weights = memory.table(self.name, "weights for x and v", both.reshape(-1, 2))
        self.c = memory.table(self.name, "c", rows.sum(1))
        self.at = State.made_in(memory, f"{self.name} stage")
        self.acceleration = memory.vectors(f"{self.name} stage", "a")
        self.k = memory.vectors(self.name, "accelerations of all stages", self.stages)

    @classmethod
    def evaluations(cls, damped: bool) -> int:
        return len(cls.b)

    @ti.func
    def begin(self, system, first, last, t):
        for i in range(first, last):
            self.at.x[i], self.at.v[i] = self.state.x[i], self.state.v[i]

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        system.accelerations(first, last, self.at.x, self.at.v, t + self.c[s] * dt, self.acceleration)
        for i in range(first, last):
            self.k[s, i] = self.acceleration[i]
        if ti.static(self.lanes == 1):
            for i in range(first, last):
                self.advance(i, s, dt)
        else:
            for p in range(first // self.lanes, (last + self.lanes - 1) // self.lanes):
                self.advance_pass(p * self.lanes, ti.min((p + 1) * self.lanes, last), s, dt)

    @ti.func
    def advance(self, i, s, dt):
        """Move particle i to stage s + 1."""
        before, dx, dv = self.state.v[i], ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0])
        for j in range(s + 1):
            weight, k = self.weights[(s + 1) * self.stages + j], self.k[j, i]
            dx += weight[0] * k
            dv += weight[1] * k
        self.at.x[i] = self.state.x[i] + dt * (self.c[s + 1] * before + dt * dx)
        self.at.v[i] = before + dt * dv

    @ti.func
    def advance_pass(self, first, last, s, dt):
        """Move the particles first … last - 1 of one pass to stage s + 1, in local arrays: LLVM does not vectorise
        stores to fields, which might alias."""
        for axis in ti.static(range(3)):
            x, v = self.Lanes(0.0), self.Lanes(0.0)
            for j in range(s + 1):
                weight = self.weights[(s + 1) * self.stages + j]
                for lane in range(self.lanes):
                    k = self.k[j, first + lane][axis]
                    x[lane] += weight[0] * k
                    v[lane] += weight[1] * k
            for lane in range(self.lanes):
                before = self.state.v[first + lane][axis]
                x[lane] = self.state.x[first + lane][axis] + dt * (self.c[s + 1] * before + dt * x[lane])
                v[lane] = before + dt * v[lane]
            for i in range(first, last):
                self.at.x[i][axis], self.at.v[i][axis] = x[i - first], v[i - first]

    @ti.func
    def finish(self, system, first, last, t, dt):
        system.stop_at_solids(first, last, self.state.x, self.at.x, self.at.v, t, dt)
        for i in range(first, last):
            self.state.x[i], self.state.v[i] = self.at.x[i], self.at.v[i]

    @classmethod
    def amplification(cls, a: np.ndarray, zeta: np.ndarray) -> np.ndarray:
        def step(x: Any, v: Any, h: Any, acceleration: Acceleration) -> Any:
            start = np.stack([x, v])
            slopes: list[np.ndarray] = []
            for row in (*cls.a, cls.b):
                at = start + h * sum((w * k for w, k in zip(row, slopes, strict=True)), np.zeros_like(start))
                slopes.append(np.stack([at[1], acceleration(*at)]))
            return at[0], at[1]

        return oscillator_matrix(step, a, zeta)
