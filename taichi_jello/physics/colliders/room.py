"""The inside of a box: six planes that face inwards."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from taichi_jello.physics.colliders.plane import Grid, grid, signed_distance
from taichi_jello.scene.description import Collider, SceneError, Vector, vector


@dataclass(frozen=True, kw_only=True)
class Room(Collider):
    """Everything stays between the corners `min` and `max` [m]."""

    type: ClassVar[str] = "box"
    signed_distance: ClassVar[Any] = staticmethod(signed_distance)
    min: Vector = (-2.0, 0.0, -2.0)
    max: Vector = (2.0, 4.0, 2.0)

    def check(self) -> dict[str, Any]:
        low, high = vector("min", self.min), vector("max", self.max)
        if any(a >= b for a, b in zip(low, high, strict=True)):
            raise SceneError("max", f"expected more than min {list(low)} on every axis, got {list(high)}")
        return {"min": low, "max": high}

    def rows(self, start: float, end: float) -> np.ndarray:
        rows = np.zeros((6, 10))
        rows[:3, :3], rows[3:, :3] = self.min, self.max
        rows[:3, 6:9], rows[3:, 6:9] = np.eye(3), -np.eye(3)
        return rows

    def floor_grid(self) -> Grid:
        size = np.array(self.max) - np.array(self.min)
        x, _, z = np.eye(3)
        return grid(np.array([size[0] / 2, 0.0, size[2] / 2]), z, x, (size[2] / 2, size[0] / 2), 0.5)

    def mesh(self, reach: float) -> tuple[np.ndarray, np.ndarray]:
        return self.floor_grid()[:2]

    def edges(self, reach: float) -> np.ndarray:
        size = np.array(self.max) - np.array(self.min)
        corners = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)]) * size
        pairs = [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]
        return np.concatenate([self.floor_grid()[2], corners[np.array(pairs)]])

    def origin(self, time: float) -> np.ndarray:
        return np.array(self.min)

    def distance(self, points: np.ndarray) -> np.ndarray:
        return np.minimum(points, np.array(self.max) - np.array(self.min) - points).min(1)

    def top(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.zeros(len(x))

    def floor(self) -> float | None:
        return self.min[1]
