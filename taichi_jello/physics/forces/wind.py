"""Wind, F = m γ (w - v): air that moves at w drags everything along. Calm until it is tuned; then w may change."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce, Rates, even_block
from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Force, Scene, Vector, number, vector
from taichi_jello.scene.validation import FASTEST

RATE = 1.5  # 1/s: a jello in the wind is at two thirds of its speed within a second


@dataclass(frozen=True, kw_only=True)
class Wind(Force):
    """Air that moves at `velocity` [m/s] and takes the jellos along at `rate` [1/s]. At rest it does nothing: the still
    air that slows them is the scene's drag."""

    key: ClassVar[str] = "wind"
    velocity: Vector = (0.0, 0.0, 0.0)
    rate: float = RATE

    def check(self) -> dict[str, Any]:
        return {"velocity": vector("velocity", self.velocity, most=FASTEST), "rate": number("rate", self.rate, low=0.0)}


def with_wind(scene: Scene) -> Scene:
    """The scene with a wind that can be tuned: its own if it has one, else none until then."""
    own = any(isinstance(force, Wind) for force in scene.force)
    return scene if own else replace(scene, force=(*scene.force, Wind()))


@ti.data_oriented
class WindForce(ParticleForce):
    title = "wind"
    reads_velocity = True
    has_curvature = True

    def __init__(self, wind: Wind, particles: Particles):
        self.particles, self.rate, self.velocity = particles, wind.rate, tuple(wind.velocity)
        # Rows: the velocity [m/s], and in each column the rate [1/s] while it blows.
        self.air = particles.memory.table(self.title, "air", self._rows())

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list["WindForce"]:
        return [cls(force, particles) for force in scene.force if isinstance(force, Wind)]

    def _rows(self) -> np.ndarray:
        return np.array([self.velocity, [self._rate_now()] * 3])

    def _rate_now(self) -> float:
        return self.rate if self.acts else 0.0

    @property
    def acts(self) -> bool:
        return any(self.velocity)

    def tuning(self) -> dict[str, Any]:
        return {"wind": self.velocity}

    def tune(self, name: str, value: Any) -> None:
        self.velocity = tuple(map(float, value))
        self.air.from_numpy(self._rows().astype(self.particles.memory.number))

    @ti.func
    def on(self, i, x, v, t):
        return self.particles.mass(i) * self.air[1] * (self.air[0] - v[i])

    @ti.func
    def curvature(self, i, x, v, t, h):
        return even_block(self.particles.mass(i) * self.air[1][0] / h)

    def rates(self) -> Rates:
        return Rates(damping=self._rate_now())
