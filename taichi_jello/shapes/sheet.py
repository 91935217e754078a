"""Cloth: one layer of particles."""

from dataclasses import dataclass
from typing import Any, ClassVar

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Jello
from taichi_jello.scene.validation import SceneError, number, shown
from taichi_jello.shapes.lattice import counts, grid_body


@dataclass(frozen=True, kw_only=True)
class Sheet(Jello):
    """A level sheet of `points` [n, m] with `size` [width along x, depth along z] [m] and no thickness."""

    shape: ClassVar[str] = "sheet"
    points: tuple[int, int] = (12, 12)
    size: tuple[float, float] = (1.0, 1.0)

    def check(self) -> dict[str, Any]:
        if isinstance(self.size, (str, int, float)) or len(self.size) != 2:
            raise SceneError("size", f"expected two numbers [width, depth], got {shown(self.size)}")
        size = tuple(number(f"size.{axis}", one, above=0.0) for axis, one in enumerate(self.size))
        return super().check() | {"points": counts("points", self.points, 2), "size": size}

    def body(self) -> Body:
        return grid_body(self, (self.points[0], 1, self.points[1]), (self.size[0], 1.0, self.size[1]))
