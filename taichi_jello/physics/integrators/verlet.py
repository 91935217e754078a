"""Velocity Verlet, the dashpots by the trapezoid rule: v' = v + dt/2 [a(x, v) + a(x', v')]."""

import taichi as ti

from taichi_jello.physics.integrators._base import oscillator_matrix
from taichi_jello.physics.integrators._symplectic import Symplectic

# v' stands on both sides. Three rounds of putting the last v' in reach the trapezoid rule's stability limit within
# 3 % up to a damping ratio of 0.2. Where no force reads velocities one evaluation a step is all.
ROUNDS = 3


@ti.data_oriented
class VelocityVerlet(Symplectic):
    name, order = "verlet", 2
    looks_at = 0.5

    def __init__(self, memory, state, damped, body):
        self.state, self.damped = state, damped
        self.stages = self.evaluations(damped)
        self.has_begin = not damped
        self.a = memory.vectors(self.name, "a")
        if damped:
            self.half = memory.vectors(self.name, "half-step v")

    @classmethod
    def evaluations(cls, damped):
        return ROUNDS + 1 if damped else 1

    @ti.func
    def begin(self, system, first, last, t):
        system.accelerations(first, last, self.state.x, self.state.v, t, self.a)

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        """Undamped: kick and drift, then the new force. Damped: stage 0 evaluates at the old end, stage 1 begins
        with kick and drift, every later one refines the new velocity."""
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
            if ti.static(self.damped):
                self.state.v[i] = self.half[i] + 0.5 * dt * self.a[i]
            else:
                self.state.v[i] = self.state.v[i] + 0.5 * dt * self.a[i]

    @classmethod
    def amplification(cls, a, zeta):
        def step(x, v, h, acceleration):
            half = v + 0.5 * h * acceleration(x, v)
            x = x + h * half
            v = half + 0.5 * h * acceleration(x - h * half, v)
            for _ in range(ROUNDS):
                v = half + 0.5 * h * acceleration(x, v)
            return x, v

        return oscillator_matrix(step, a, zeta)
