"""Backward Euler: v' = v + dt a(x', v'), x' = x + dt v'. Stable at any step; damps oscillations with ω dt > 1 within a
few steps."""

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import oscillator_matrix
from taichi_jello.physics.integrators.implicit_solve._implicit import Implicit, solve_linear


@ti.data_oriented
class BackwardEuler(Implicit):
    name, order = "backward-euler", 1
    share = 1.0

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        for i in range(first, last):
            self.solver.z[i] = self.state.x[i]
            self.solver.w[i] = self.solver.at.v[i] = self.state.v[i]
        self.solver.start(system, first, last, dt, t + dt)

    @classmethod
    def amplification(cls, a: np.ndarray, zeta: np.ndarray) -> np.ndarray:
        return oscillator_matrix(solve_linear, a, zeta)
