"""Explicit Runge–Kutta methods: the method is its tableau, this is the one engine for all of them."""

from typing import ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import Integrator, oscillator_matrix
from taichi_jello.physics.state import State


@ti.data_oriented
class RungeKutta(Integrator):
    """Stage s evaluates the accelerations k_s at t + c_s dt from v_s = v + dt Σ a_sj k_j, and the step ends at
    v + dt Σ b_j k_j (Butcher tableau; c_s = Σ a_sj). Since the slope of x is the stage's v, the positions follow from
    the same k: x_s = x + c_s dt v + dt² Σ (a²)_sj k_j, the end likewise with b a (Nyström's form of the method)."""

    a: ClassVar[tuple[tuple[float, ...], ...]]
    b: ClassVar[tuple[float, ...]]
    has_begin = True

    def __init__(self, memory, state, damped, body):
        self.state, self.stages = state, len(self.b)
        self.looks_at = 0.5 if self.stages > 1 else 0.0
        rows = np.array([[*row, *[0.0] * (self.stages - len(row))] for row in (*self.a, self.b)])
        both = np.stack([rows @ rows[:-1], rows], -1)
        self.lanes, self.Lanes = memory.lanes, memory.lane_vector
        self.weights = memory.table(self.name, "weights for x and v", both.reshape(-1, 2))
        self.c = memory.table(self.name, "c", rows.sum(1))
        self.at = State.made_in(memory, f"{self.name} stage")
        self.acceleration = memory.vectors(f"{self.name} stage", "a")
        self.slopes = memory.vectors(self.name, "accelerations of all stages", self.stages)

    @classmethod
    def evaluations(cls, damped):
        return len(cls.b)

    @ti.func
    def begin(self, system, first, last, t):
        for i in range(first, last):
            self.at.x[i], self.at.v[i] = self.state.x[i], self.state.v[i]

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        system.accelerations(first, last, self.at.x, self.at.v, t + self.c[s] * dt, self.acceleration)
        for i in range(first, last):
            self.slopes[s, i] = self.acceleration[i]
        if ti.static(self.lanes == 1):
            for i in range(first, last):
                self.go_on(i, s, dt)
        else:
            for p in range(first // self.lanes, (last + self.lanes - 1) // self.lanes):
                self.go_on_in_pass(p * self.lanes, ti.min((p + 1) * self.lanes, last), s, dt)

    @ti.func
    def go_on(self, i, s, dt):
        """To where the row of the tableau after s leads."""
        before, dx, dv = self.state.v[i], ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0])
        for j in range(s + 1):
            weight, k = self.weights[(s + 1) * self.stages + j], self.slopes[j, i]
            dx += weight[0] * k
            dv += weight[1] * k
        self.at.x[i] = self.state.x[i] + dt * (self.c[s + 1] * before + dt * dx)
        self.at.v[i] = before + dt * dv

    @ti.func
    def go_on_in_pass(self, first, last, s, dt):
        """The same for the particles first … last - 1 of one pass. What is reckoned is stored in local arrays, so that
        LLVM vectorises it: a store to a field might move all other fields."""
        for axis in ti.static(range(3)):
            x, v = self.Lanes(0.0), self.Lanes(0.0)
            for j in range(s + 1):
                weight = self.weights[(s + 1) * self.stages + j]
                for lane in range(self.lanes):
                    k = self.slopes[j, first + lane][axis]
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
