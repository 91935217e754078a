"""The midpoint method: both slopes are taken in the middle of the step. Undamped motion grows by (ω dt)⁴/8 a step."""

from taichi_jello.physics.integrators._runge_kutta import RungeKutta


class Midpoint(RungeKutta):
    name, order, safety = "rk2", 2, 0.9
    a = ((), (0.5,))
    b = (0.0, 1.0)
