"""A rope: a row of particles."""

from dataclasses import dataclass
from typing import Any, ClassVar

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Jello
from taichi_jello.scene.validation import SceneError, number, whole
from taichi_jello.shapes.lattice import MAX_PARTICLES, grid_body


@dataclass(frozen=True, kw_only=True)
class Rope(Jello):
    """`points` in a row along x, `length` [m] from the first to the last, with structural springs between neighbours
    and bend springs."""

    shape: ClassVar[str] = "rope"
    points: int = 16
    length: float = 1.0

    def check(self) -> dict[str, Any]:
        points = whole("points", self.points, low=1)
        if points > MAX_PARTICLES:
            raise SceneError("points", f"expected at most {MAX_PARTICLES:,} particles, got {points:,}")
        return super().check() | {"points": points, "length": number("length", self.length, above=0.0)}

    def body(self) -> Body:
        return grid_body(self, (self.points, 1, 1), (self.length, 1.0, 1.0))
