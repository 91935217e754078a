"""A ring: a bar of the lattice bent into a circle."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Jello
from taichi_jello.scene.validation import FAMILIES, SceneError, number
from taichi_jello.shapes.lattice import OFFSETS, connect, counts, hexahedra, spring_body, surface


@dataclass(frozen=True, kw_only=True)
class Ring(Jello):
    """A ring in the x-y plane, `radius` [m] to the middle of a square bar of `thickness` [m]; `points` [n, m]: around,
    and along each side of the bar."""

    shape: ClassVar[str] = "ring"
    radius: float = 0.5
    thickness: float = 0.25
    points: tuple[int, int] = (24, 4)

    def check(self) -> dict[str, Any]:
        points = counts("points", self.points, 2)
        if points[0] < 5 or points[1] < 2:
            raise SceneError("points", f"expected at least 5 around and 2 across, got {list(points)}")
        thickness = number("thickness", self.thickness, above=0.0)
        radius = number("radius", self.radius, above=0.5 * thickness)
        return super().check() | {"radius": radius, "thickness": thickness, "points": points}

    def body(self) -> Body:
        n, m = self.points
        index = np.arange(n * m * m, dtype=np.int32).reshape(n, m, m)
        closed, beyond = index.take(range(n + 1), 0, mode="wrap"), index.take(range(n + 2), 0, mode="wrap")
        around, depth, out = np.moveaxis(np.indices(index.shape), 0, -1).reshape(-1, 3).T
        angle = 2.0 * np.pi * around / n
        away = self.radius + self.thickness * (out / (m - 1) - 0.5)
        rest = np.stack([away * np.cos(angle), away * np.sin(angle), self.thickness * (depth / (m - 1) - 0.5)], 1)

        pairs, families = [np.zeros((0, 2), np.int32)], [np.zeros(0, np.int8)]
        for family in dict.fromkeys(self.springs):
            found = np.concatenate([connect(beyond, offset) for offset in OFFSETS[family]])
            pairs.append(np.unique(np.sort(found, 1), axis=0))  # those across the seam are found twice
            families.append(np.full(len(pairs[-1]), FAMILIES.index(family), np.int8))
        springs = np.concatenate(pairs)
        return spring_body(
            self,
            rest,
            springs=springs,
            vectors=rest[springs[:, 1]] - rest[springs[:, 0]],
            family=np.concatenate(families),
            mass=np.full(len(rest), self.mass / len(rest)),
            surface=surface(closed)[4 * (m - 1) ** 2 :],  # without the two ends of the bar
            cells=hexahedra(closed),
        )
