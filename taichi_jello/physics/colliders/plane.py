"""The half-space below a plane of any orientation."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_jello.scene.description import Collider, SceneError, Vector, vector

STEEPEST = 0.1  # the least upward part of the normal of a plane that something can stand on


@ti.func
def signed_distance(p, shape):
    """(normal, distance) of the point `p` relative to a point of the plane; `shape` holds the unit normal.

    The workshop's plane equation: distance = n · (p - p0), negative below the plane.
    """
    n = ti.Vector([shape[0], shape[1], shape[2]])
    return ti.Vector([n[0], n[1], n[2], n.dot(p)])


Grid = tuple[np.ndarray, np.ndarray, np.ndarray]


def grid(center: np.ndarray, u: np.ndarray, v: np.ndarray, half: tuple[float, float], cell: float) -> Grid:
    """A rectangle of about `cell`-sized quads spanned by the unit vectors u and v: vertices, triangles (normal u × v)
    and the segments between neighbouring vertices (E, 2, 3)."""
    nu, nv = (max(1, round(2 * size / cell)) for size in half)
    a, b = np.meshgrid(np.linspace(-half[0], half[0], nu + 1), np.linspace(-half[1], half[1], nv + 1), indexing="ij")
    vertices = center + a[..., None] * u + b[..., None] * v
    index = np.arange(a.size, dtype=np.int32).reshape(a.shape)
    p, q, r, s = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.stack([np.stack([p, q, r], -1), np.stack([p, r, s], -1)], 2).reshape(-1, 3)
    along_u = np.stack([vertices[:-1], vertices[1:]], 2).reshape(-1, 2, 3)
    along_v = np.stack([vertices[:, :-1], vertices[:, 1:]], 2).reshape(-1, 2, 3)
    return vertices.reshape(-1, 3), triangles, np.concatenate([along_u, along_v])


def six_faces(half: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and outward triangles of a box of half sizes (3,) around the origin, a grid on each face."""
    points, triangles, start = [], [], 0
    for axis in range(3):
        for side in (-1.0, 1.0):
            n, u, v = np.roll(np.eye(3), -axis, axis=0)
            u, v = (u, v) if side > 0 else (v, u)
            face = grid(side * n * half[axis], u, v, (float(half @ abs(u)), float(half @ abs(v))), cell)
            points.append(face[0])
            triangles.append(face[1] + start)
            start += len(face[0])
    return np.concatenate(points), np.concatenate(triangles).astype(np.int32)


@dataclass(frozen=True, kw_only=True)
class Plane(Collider):
    """Everything stays on the side of the plane through `point` [m] that `normal` points to."""

    type: ClassVar[str] = "plane"
    signed_distance: ClassVar[Any] = staticmethod(signed_distance)
    point: Vector = (0.0, 0.0, 0.0)
    normal: Vector = (0.0, 1.0, 0.0)

    def check(self) -> dict[str, Any]:
        normal = np.array(vector("normal", self.normal))
        length = float(np.linalg.norm(normal))
        if length == 0.0:
            raise SceneError("normal", "expected a direction, got the zero vector")
        return {"point": vector("point", self.point), "normal": tuple(float(c) for c in normal / length)}

    def rows(self, start: float, end: float) -> np.ndarray:
        return np.array([[*self.point, 0.0, 0.0, 0.0, *self.normal, 0.0]])

    def grid(self, reach: float) -> Grid:
        normal = np.array(self.normal)
        u = np.cross([0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0], normal)
        u = np.array([1.0, 0.0, 0.0]) if normal[1] == 1.0 else u / np.linalg.norm(u)
        return grid(np.zeros(3), u, np.cross(normal, u), (reach, reach), 0.5)

    def mesh(self, reach: float) -> tuple[np.ndarray, np.ndarray]:
        return self.grid(reach)[:2]

    def edges(self, reach: float) -> np.ndarray:
        return self.grid(reach)[2]

    def origin(self, time: float) -> np.ndarray:
        return np.array(self.point)

    def distance(self, points: np.ndarray) -> np.ndarray:
        return points @ np.array(self.normal)

    def top(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        nx, ny, nz = self.normal
        return -(nx * x + nz * z) / ny if ny > STEEPEST else np.full(len(x), -np.inf)

    def extent(self) -> None:
        return None

    def floor(self) -> float | None:
        return self.point[1] if self.normal[1] > 0.999 else None
