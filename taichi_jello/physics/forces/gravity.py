"""Uniform gravity, F = m g; g may change while the simulation runs."""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce


@ti.data_oriented
class Gravity(ParticleForce):
    title = "gravity"
    energy_kind = "gravity"

    def __init__(self, particles, acceleration):
        self.particles = particles
        self.g = particles.memory.table(self.title, "g", np.array([acceleration], float))

    @classmethod
    def made_for(cls, scene, particles):
        return [cls(particles, scene.gravity)] if any(scene.gravity) else []

    @ti.func
    def on(self, i, x, v, t):
        return self.particles.mass(i) * self.g[0]

    @ti.func
    def energy(self, i, x, t):
        return -self.particles.mass(i) * self.g[0].dot(x[i])
