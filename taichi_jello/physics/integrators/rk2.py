"""The midpoint method: the slope half a step on. Undamped motion grows by a⁴/8 a step, a = ω dt."""

from taichi_jello.physics.integrators._runge_kutta import RungeKutta


class Midpoint(RungeKutta):
    name, order, safety = "rk2", 2, 0.9
    a = ((), (0.5,))
    b = (0.0, 1.0)
