"""The workshop's jello: a regular grid of particles with structural, shear and bend springs."""

from dataclasses import dataclass
from math import prod
from typing import Any, ClassVar

import numpy as np

from taichi_jello.body import Body
from taichi_jello.scene import FAMILIES, Jello, SceneError, Vector, vector, whole

LARGEST = 4_000_000  # particles; beyond it a scene is taken for a mistyped one

# One offset of each opposite pair, so that every spring is made once (workshop, "interconnected springs").
OFFSETS = {
    "structural": [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "shear": [(1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)]
    + [(1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1)],
    "bend": [(2, 0, 0), (0, 2, 0), (0, 0, 2)],
}
QUAD = np.array([[0, 1, 3], [0, 3, 2]])


def connect(index: np.ndarray, offset: tuple[int, int, int]) -> np.ndarray:
    """(S, 2) pairs of neighbours `offset` apart in the grid `index` (n, m, l)."""
    near = tuple(slice(max(0, -o), n - max(0, o)) for o, n in zip(offset, index.shape, strict=True))
    far = tuple(slice(max(0, o), n - max(0, -o)) for o, n in zip(offset, index.shape, strict=True))
    if any(abs(o) >= n for o, n in zip(offset, index.shape, strict=True) if o):
        return np.zeros((0, 2), np.int32)
    return np.stack([index[near].ravel(), index[far].ravel()], 1).astype(np.int32)


def surface(index: np.ndarray) -> np.ndarray:
    """(T, 3) outward triangles on the six sides of the grid; a grid one point thick has both its sides."""
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        if index.shape[u] < 2 or index.shape[v] < 2:
            continue
        for side in (0, -1):
            face = np.moveaxis(index, (axis, u, v), (0, 1, 2))[side]
            corners = np.stack([face[:-1, :-1], face[1:, :-1], face[:-1, 1:], face[1:, 1:]], -1).reshape(-1, 4)
            outward = QUAD if side == -1 else QUAD[:, ::-1]
            triangles.append(corners[:, outward].reshape(-1, 3))
    return np.concatenate(triangles).astype(np.int32) if triangles else np.zeros((0, 3), np.int32)


def hexahedra(index: np.ndarray) -> np.ndarray:
    """(C, 8) corners of the cells between the points of the grid, the last axis fastest; see Body.cells."""
    if min(index.shape) < 2:
        return np.zeros((0, 8), np.int32)
    ends = (slice(None, -1), slice(1, None))
    return np.stack([index[a, b, c].ravel() for a in ends for b in ends for c in ends], 1).astype(np.int32)


def rotation(degrees: Vector) -> np.ndarray:
    """The matrix that turns about x, then y, then z."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


@dataclass(frozen=True, kw_only=True)
class Box(Jello):
    """`points` along each axis of a box of `size` [m]; an axis with one point has no thickness."""

    shape: ClassVar[str] = "box"
    points: tuple[int, int, int] = (8, 8, 8)
    size: Vector = (1.0, 1.0, 1.0)

    def check(self) -> dict[str, Any]:
        if isinstance(self.points, (str, int, float)) or len(self.points) != 3:
            raise SceneError("points", f"expected three whole numbers, got {self.points!r}")
        points = tuple(whole(f"points.{axis}", n, low=1) for axis, n in enumerate(self.points))
        if prod(points) > LARGEST:
            raise SceneError("points", f"expected at most {LARGEST:,} particles, got {prod(points):,}")
        return super().check() | {"points": points, "size": vector("size", self.size, above=0.0)}

    def body(self) -> Body:
        n = np.array(self.points)
        index = np.arange(n.prod(), dtype=np.int32).reshape(n)
        unit = np.stack(np.unravel_index(index.ravel(), n), 1) / np.maximum(n - 1, 1)
        spacing = np.where(n > 1, np.array(self.size) / np.maximum(n - 1, 1), 0.0)
        rest = (unit - np.where(n > 1, 0.5, 0.0)) * self.size

        pairs, steps, families = [np.zeros((0, 2), np.int32)], [np.zeros((0, 3))], [np.zeros(0, np.int8)]
        for family in dict.fromkeys(self.springs):
            for offset in OFFSETS[family]:
                found = connect(index, offset)
                pairs.append(found)
                steps.append(np.tile(np.array(offset) * spacing, (len(found), 1)))
                families.append(np.full(len(found), FAMILIES.index(family), np.int8))
        springs, step, kind = np.concatenate(pairs), np.concatenate(steps), np.concatenate(families)
        length = np.linalg.norm(step, axis=1)

        turned = rest @ rotation(self.rotation).T
        held = [np.all((unit >= np.array(p.min) - 1e-9) & (unit <= np.array(p.max) + 1e-9), 1) for p in self.pin]
        lower_first = np.where(springs[:, :1] < springs[:, 1:], 1.0, -1.0)
        return Body(
            rest=rest,
            x=turned + self.position,
            v=np.array(self.velocity) + np.cross(self.spin, turned),
            mass=np.full(len(rest), self.mass / len(rest)),
            pinned=np.any(held, axis=0) if held else np.zeros(len(rest), bool),
            jello=np.zeros(len(rest), np.int32),
            springs=np.sort(springs, axis=1),
            rest_length=length,
            stiffness=np.array([self.coefficient("stiffness", f) for f in FAMILIES])[kind],
            damping=np.array([self.coefficient("damping", f) for f in FAMILIES])[kind],
            family=kind,
            direction=lower_first * step / length[:, None],
            surface=surface(index),
            cells=hexahedra(index),
        )
