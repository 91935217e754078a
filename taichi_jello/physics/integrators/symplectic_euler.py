"""Symplectic (semi-implicit) Euler: v' = v + dt a(x, v), x' = x + dt v'."""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import Acceleration, oscillator_matrix
from taichi_jello.physics.integrators._symplectic import Symplectic


@ti.data_oriented
class SymplecticEuler(Symplectic):
    name, order = "symplectic-euler", 1

    def allocate(self) -> None:
        self.a = self.memory.vectors(self.name, "a")

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        system.accelerations(first, last, self.state.x, self.state.v, t, self.a)

    @ti.func
    def finish(self, system, first, last, t, dt):
        for i in range(first, last):
            self.state.v[i] = self.state.v[i] + dt * self.a[i]
            self.state.x[i] = self.state.x[i] + dt * self.state.v[i]
        system.stop_at_solids(first, last, self.state.x, self.state.x, self.state.v, t, dt, True)

    @classmethod
    def amplification(cls, a: np.ndarray, zeta: np.ndarray) -> np.ndarray:
        def step(x: Any, v: Any, h: Any, acceleration: Acceleration) -> Any:
            v = v + h * acceleration(x, v)
            return x + h * v, v

        return oscillator_matrix(step, a, zeta)
