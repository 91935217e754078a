"""Uniform gravity, F = m g; g may change while the simulation runs."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce
from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Scene
from taichi_jello.scene.keyframes import gravity


@ti.data_oriented
class Gravity(ParticleForce):
    title = "gravity"
    energy_kind = "gravity"

    def __init__(self, particles: Particles, acceleration: Iterable[float], live: bool):
        self.particles, self.acceleration, self.live = particles, tuple(acceleration), live
        self.g = particles.memory.table(self.title, "g", np.array([self.acceleration], float))

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list["Gravity"]:
        if scene.keyframe:
            return [cls(particles, gravity(scene.keyframe, 0.0), live=False)]
        return [cls(particles, scene.gravity, live=True)] if any(scene.gravity) else []

    def tuning(self) -> dict[str, Any]:
        """Nothing where keyframes set gravity."""
        return {"gravity": self.acceleration} if self.live else {}

    def tune(self, name: str, value: Any) -> None:
        self.set(value)

    def set(self, acceleration: Iterable[float]) -> None:
        """Set gravity to `acceleration` (3,) [m/s²]."""
        self.acceleration = tuple(map(float, acceleration))
        self.g.from_numpy(np.array([self.acceleration], self.particles.memory.number))

    @ti.func
    def on(self, i, x, v, t):
        return self.particles.mass(i) * self.g[0]

    @ti.func
    def energy(self, i, x, t):
        return -self.particles.mass(i) * self.g[0].dot(x[i])
