"""The classical fourth-order Runge–Kutta method. Stable undamped up to ω dt = 2√2; whatever the damping, to 2.61."""

from taichi_jello.physics.integrators._runge_kutta import RungeKutta


class RK4(RungeKutta):
    name, order, safety = "rk4", 4, 0.95
    a = ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0))
    b = (1 / 6, 1 / 3, 1 / 3, 1 / 6)
