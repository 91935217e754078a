"""The classical Runge–Kutta method of order 4. Stable up to ω dt = 2√2 undamped, up to 2.61 at any damping ratio."""

from taichi_jello.physics.integrators._runge_kutta import RungeKutta


class RK4(RungeKutta):
    name, order, safety = "rk4", 4, 0.95
    a = ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0))
    b = (1 / 6, 1 / 3, 1 / 3, 1 / 6)
