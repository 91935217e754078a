"""A ball, still or moving."""

from dataclasses import dataclass
from math import pi, sin
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.colliders.plane import six_faces
from taichi_jello.scene.description import Collider, Vector, number, vector
from taichi_jello.scene.validation import FASTEST


@ti.func
def signed_distance(p, shape):
    """(normal, distance) of the point `p` relative to the centre; `shape[3]` is the radius.

    At the very centre every direction is as good; up is taken, so that the force stays finite.
    """
    length = p.norm()
    middle = length < 1e-12
    n = ti.select(middle, ti.Vector([0.0, 1.0, 0.0]), p / ti.select(middle, 1.0, length))
    return ti.Vector([n[0], n[1], n[2], length - shape[3]])


@ti.func
def core_entry(a, b, shape):
    """(normal, fraction) of where the way from a to b enters the core, the ball of half the radius; a fraction of 2 if
    it does not. Roots of |a + s (b - a)|² = r²."""
    way, r = b - a, 0.5 * shape[3]
    quick, along = ti.max(way.dot(way), 1e-30), a.dot(way)
    beyond = a.dot(a) - r * r
    root = along * along - quick * beyond
    fraction = (-along - ti.sqrt(ti.max(root, 0.0))) / quick
    hits = (beyond >= 0.0) & (along < 0.0) & (root > 0.0) & (fraction <= 1.0)
    n = (a + fraction * way) / r
    return ti.Vector([n[0], n[1], n[2], ti.select(hits, fraction, 2.0)])


@dataclass(frozen=True, kw_only=True)
class Sphere(Collider):
    """A ball of `radius` [m]. Its centre [m] moves with `velocity` [m/s] and swings by `swing` [m] every `period` [s]:
    center + velocity·t + swing·sin(2πt/period). Within a frame it moves in a straight line."""

    type: ClassVar[str] = "sphere"
    signed_distance: ClassVar[Any] = staticmethod(signed_distance)
    core_entry: ClassVar[Any] = staticmethod(core_entry)
    center: Vector = (0.0, 0.0, 0.0)
    radius: float = 0.5
    velocity: Vector = (0.0, 0.0, 0.0)
    swing: Vector = (0.0, 0.0, 0.0)
    period: float = 1.0

    def check(self) -> dict[str, Any]:
        return {name: vector(name, getattr(self, name)) for name in ("center", "swing")} | {
            "velocity": vector("velocity", self.velocity, most=FASTEST),
            "radius": number("radius", self.radius, above=0.0),
            "period": number("period", self.period, above=0.0),
        }

    @property
    def thickness(self) -> float:
        return 2.0 * self.radius

    def origin(self, time: float) -> np.ndarray:
        wave = sin(2.0 * pi * (time / self.period % 1.0))
        return np.array(self.center) + np.array(self.velocity) * time + np.array(self.swing) * wave

    def rows(self, start: float, end: float) -> np.ndarray:
        here = self.origin(start)
        velocity = (self.origin(end) - here) / (end - start)
        return np.array([[*here, *velocity, 0.0, 0.0, 0.0, self.radius]])

    def mesh(self, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """A cube of 16×16 quads a side, pushed onto the sphere."""
        points, triangles = six_faces(np.ones(3), 2 / 16)
        points = np.tan(points * (pi / 4))
        return points * (self.radius / np.linalg.norm(points, axis=1, keepdims=True)), triangles

    def distance(self, points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points, axis=1) - self.radius

    def top(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        squared = self.radius**2 - x**2 - z**2
        return np.where(squared > 0.0, np.sqrt(np.maximum(squared, 0.0)), -np.inf)
