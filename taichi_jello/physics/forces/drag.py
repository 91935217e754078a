"""Drag of a still medium, F = -m γ v, which slows everything at the same rate γ [1/s]."""

import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce, Rates, even_block
from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Scene


@ti.data_oriented
class Drag(ParticleForce):
    title = "drag"
    reads_velocity = True
    has_curvature = True

    def __init__(self, particles: Particles, rate: float):
        self.particles, self.rate = particles, rate

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list["Drag"]:
        return [cls(particles, scene.drag)] if scene.drag else []

    @ti.func
    def on(self, i, x, v, t):
        return -self.rate * self.particles.mass(i) * v[i]

    @ti.func
    def curvature(self, i, x, v, t, h):
        return even_block(self.rate * self.particles.mass(i) / h)

    def rates(self) -> Rates:
        return Rates(damping=self.rate)
