"""Explicit Euler (workshop Eq. 5): x' = x + dt v, v' = v + dt a(x, v). Unstable without damping."""

from taichi_jello.physics.integrators._runge_kutta import RungeKutta


class Euler(RungeKutta):
    name, order, safety = "euler", 1, 0.9
    a = ((),)
    b = (1.0,)
