"""A ball cut out of the lattice."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from taichi_jello.body import Body
from taichi_jello.scene import Jello, SceneError, number, whole
from taichi_jello.shapes.lattice import LARGEST, body_of, corners


@dataclass(frozen=True, kw_only=True)
class Ball(Jello):
    """A ball of `radius` [m] with `resolution` cells of the lattice across it."""

    shape: ClassVar[str] = "ball"
    radius: float = 0.5
    resolution: int = 8

    def check(self) -> dict[str, Any]:
        resolution = whole("resolution", self.resolution, low=2)
        if (resolution + 1) ** 3 > LARGEST:
            raise SceneError("resolution", f"expected at most {round(LARGEST ** (1 / 3)) - 1}, got {resolution}")
        return super().check() | {"radius": number("radius", self.radius, above=0.0), "resolution": resolution}

    def body(self) -> Body:
        n = self.resolution
        middle = (np.arange(n) + 0.5) / n * 2.0 - 1.0
        filled = (middle[:, None, None] ** 2 + middle[:, None] ** 2 + middle**2) <= 1.0
        return body_of(self, corners(filled), np.full(3, 2.0 * self.radius / n), filled)
