"""Velocity Verlet, with dashpots by the trapezoidal rule: v' = v + dt/2 [a(x, v) + a(x', v')]."""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import Acceleration, oscillator_matrix
from taichi_jello.physics.integrators._symplectic import Symplectic

# Fixed-point iterations for v', which is on both sides where forces read velocities. Three come within 3 % of the
# stability limit of the trapezoidal rule up to a damping ratio of 0.2.
ITERATIONS = 3


@ti.data_oriented
class VelocityVerlet(Symplectic):
    name, order = "verlet", 2
    search_at = 0.5

    def allocate(self) -> None:
        self.stages = self.evaluations(self.damped)
        self.has_begin = not self.damped
        self.a = self.memory.vectors(self.name, "a")
        self.half = self.memory.vectors(self.name, "half-step v") if self.damped else self.state.v

    @classmethod
    def evaluations(cls, damped: bool) -> int:
        return ITERATIONS + 1 if damped else 1

    @ti.func
    def begin(self, system, first, last, t):
        system.accelerations(first, last, self.state.x, self.state.v, t, self.a)

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        """Undamped: half kick and drift, then the new force. Damped: stage 0 evaluates the force at the start, stage 1
        begins with half kick and drift, every later one refines the new velocity."""
        if ti.static(self.damped):
            for i in range(first, last):
                if s == 1:
                    self.half[i] = self.state.v[i] + 0.5 * dt * self.a[i]
                    self.state.x[i] = self.state.x[i] + dt * self.half[i]
                if s > 0:
                    self.state.v[i] = self.half[i] + 0.5 * dt * self.a[i]
            if s == 1:
                system.stop_at_solids(first, last, self.state.x, self.state.x, self.half, t, dt, True)
            system.accelerations(first, last, self.state.x, self.state.v, t + dt * ti.min(s, 1), self.a)
        else:
            for i in range(first, last):
                self.state.v[i] = self.state.v[i] + 0.5 * dt * self.a[i]
                self.state.x[i] = self.state.x[i] + dt * self.state.v[i]
            system.stop_at_solids(first, last, self.state.x, self.state.x, self.state.v, t, dt, True)
            system.accelerations(first, last, self.state.x, self.state.v, t + dt, self.a)

    @ti.func
    def finish(self, system, first, last, t, dt):
        for i in range(first, last):
            self.state.v[i] = self.half[i] + 0.5 * dt * self.a[i]

    @classmethod
    def amplification(cls, a: np.ndarray, zeta: np.ndarray) -> np.ndarray:
        def step(x: Any, v: Any, h: Any, acceleration: Acceleration) -> Any:
            half = v + 0.5 * h * acceleration(x, v)
            x = x + h * half
            v = half + 0.5 * h * acceleration(x - h * half, v)
            for _ in range(ITERATIONS):
                v = half + 0.5 * h * acceleration(x, v)
            return x, v

        return oscillator_matrix(step, a, zeta)
