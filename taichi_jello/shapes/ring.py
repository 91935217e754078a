"""A ring: a bar of the lattice bent round until its ends are one."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import FAMILIES, Jello, SceneError, number
from taichi_jello.shapes.lattice import OFFSETS, connect, counts, hexahedra, rotation, surface


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
            pairs.append(np.unique(np.sort(found, 1), axis=0))  # those across the seam are met twice
            families.append(np.full(len(pairs[-1]), FAMILIES.index(family), np.int8))
        springs, kind = np.concatenate(pairs), np.concatenate(families)
        way = rest[springs[:, 1]] - rest[springs[:, 0]]
        length = np.linalg.norm(way, axis=1)
        turned, low = rest @ rotation(self.rotation).T, rest.min(0)
        held = [pin.holds((rest - low) / np.ptp(rest, axis=0)) for pin in self.pin]
        return Body(
            rest=rest,
            x=turned + self.position,
            v=np.array(self.velocity) + np.cross(self.spin, turned),
            mass=np.full(len(rest), self.mass / len(rest)),
            pinned=np.any(held, axis=0) if held else np.zeros(len(rest), bool),
            jello=np.zeros(len(rest), np.int32),
            springs=springs,
            rest_length=length,
            stiffness=np.array([self.coefficient("stiffness", f) for f in FAMILIES])[kind],
            damping=np.array([self.coefficient("damping", f) for f in FAMILIES])[kind],
            family=kind,
            direction=way / length[:, None],
            surface=surface(closed)[4 * (m - 1) ** 2 :],  # without the two ends of the bar
            cells=hexahedra(closed),
        )
