"""Uniform gravity, F = m g; g may change while the simulation runs."""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce


@ti.data_oriented
class Gravity(ParticleForce):
    title = "gravity"
    energy_kind = "gravity"

    def __init__(self, particles, acceleration):
        self.particles, self.acceleration = particles, tuple(acceleration)
        self.g = particles.memory.table(self.title, "g", np.array([acceleration], float))

    @classmethod
    def made_for(cls, scene, particles):
        return [cls(particles, scene.gravity)] if any(scene.gravity) else []

    def tuning(self):
        return {"gravity": self.acceleration}

    def tune(self, name, value):
        self.acceleration = tuple(map(float, value))
        self.g.from_numpy(np.array([self.acceleration], self.particles.memory.number))

    @ti.func
    def on(self, i, x, v, t):
        return self.particles.mass(i) * self.g[0]

    @ti.func
    def energy(self, i, x, t):
        return -self.particles.mass(i) * self.g[0].dot(x[i])
