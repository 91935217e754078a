"""A solid box, its sides along the axes: a slab, a step, a pillar."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.colliders.plane import six_faces
from taichi_jello.scene.description import Collider, SceneError, Vector, vector


@ti.func
def signed_distance(p, shape):
    """(normal, distance) of the point `p` relative to the centre; `shape` holds the half sizes.

    Inside, the nearest face counts; outside, the nearest point of the box.
    """
    half = ti.Vector([shape[0], shape[1], shape[2]])
    over = ti.abs(p) - half
    nearest = ti.max(over[0], over[1], over[2])
    beyond = ti.max(over, 0.0)
    outside = beyond.norm()
    side = ti.select(p < 0.0, -1.0, 1.0)
    face = ti.select(over[1] == nearest, ti.Vector([0.0, 1.0, 0.0]), ti.Vector([0.0, 0.0, 1.0]))
    face = ti.select(over[0] == nearest, ti.Vector([1.0, 0.0, 0.0]), face)
    n = side * ti.select(nearest < 0.0, face, beyond / ti.max(outside, 1e-20))
    return ti.Vector([n[0], n[1], n[2], ti.select(nearest < 0.0, nearest, outside)])


@ti.func
def core_entry(a, b, shape):
    """(normal, fraction) of where the way from a to b enters the core; a fraction of 2 if it does not. The core is the
    box less a quarter of its least size on every side, `shape[3]`."""
    inner = ti.Vector([shape[0], shape[1], shape[2]]) - shape[3]
    way = b - a
    enters, leaves, n = ti.cast(-1e30, float), ti.cast(1e30, float), ti.Vector([0.0, 0.0, 0.0])
    for axis in ti.static(range(3)):
        if ti.abs(way[axis]) < 1e-30:
            if ti.abs(a[axis]) >= inner[axis]:
                leaves = -1e30
        else:
            side = ti.select(way[axis] > 0.0, -1.0, 1.0)
            near = (side * inner[axis] - a[axis]) / way[axis]
            if near > enters:
                enters = near
                n = ti.Vector([0.0, 0.0, 0.0])
                n[axis] = side
            leaves = ti.min(leaves, (-side * inner[axis] - a[axis]) / way[axis])
    hits = (enters >= 0.0) & (enters <= 1.0) & (enters < leaves)
    return ti.Vector([n[0], n[1], n[2], ti.select(hits, enters, 2.0)])


@dataclass(frozen=True, kw_only=True)
class Block(Collider):
    """A solid box around `center`, `size` [m] along x, y and z."""

    type: ClassVar[str] = "block"
    signed_distance: ClassVar[Any] = staticmethod(signed_distance)
    core_entry: ClassVar[Any] = staticmethod(core_entry)
    center: Vector = (0.0, 0.0, 0.0)
    size: Vector = (1.0, 1.0, 1.0)

    def check(self) -> dict[str, Any]:
        size = vector("size", self.size)
        if min(size) <= 0.0:
            raise SceneError("size", f"expected three numbers greater than 0, got {list(size)}")
        return {"center": vector("center", self.center), "size": size}

    @property
    def thickness(self) -> float:
        return min(self.size)

    def rows(self, start: float, end: float) -> np.ndarray:
        half = np.array(self.size) / 2.0
        return np.array([[*self.center, 0.0, 0.0, 0.0, *half, half.min() / 2.0]])

    def mesh(self, reach: float) -> tuple[np.ndarray, np.ndarray]:
        half = np.array(self.size) / 2.0
        return six_faces(half, max(0.25, half.max() / 8.0))

    def origin(self, time: float) -> np.ndarray:
        return np.array(self.center)

    def distance(self, points: np.ndarray) -> np.ndarray:
        over = abs(points) - np.array(self.size) / 2.0
        return np.linalg.norm(np.maximum(over, 0.0), axis=1) + np.minimum(over.max(1), 0.0)

    def top(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        width, height, depth = self.size
        return np.where((abs(x) < width / 2.0) & (abs(z) < depth / 2.0), height / 2.0, -np.inf)
