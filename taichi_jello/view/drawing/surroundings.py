"""Colliders: floors whose grid fades into the distance, and solid obstacles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import taichi as ti

from taichi_jello.scene.description import Collider
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.primitives import Lines, Triangles
from taichi_jello.view.drawing.rows import Array2, Index1, put, row
from taichi_jello.view.drawing.shading import REACH, clip, ground, matte

GRID_FADE = (0.12 * REACH, 0.66 * REACH)  # m from the vertical axis between which grid lines fade out


@dataclass(frozen=True)
class Surface:
    """A collider's mesh. points (V, 3) [m] from its origin, normal (V, 3), faces (F, 3); planar: it is one plane."""

    collider: Collider
    points: np.ndarray
    normal: np.ndarray
    faces: np.ndarray
    planar: bool

    @classmethod
    def of(cls, collider: Collider) -> "Surface":
        points, faces = collider.mesh(REACH)
        normal = np.zeros_like(points)
        for corner in range(3):
            a, b, c = (points[faces[:, k]] for k in range(3))
            np.add.at(normal, faces[:, corner], np.cross(b - a, c - a))
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        parallel = len(points) > 0 and bool(np.all(normal @ normal[0] > 0.9999))
        height = (points - points[:1]) @ normal[0] if parallel else np.ones(1)
        return cls(collider, points, normal, faces, parallel and bool(np.abs(height).max() < 1e-6 * REACH))


@ti.kernel
def shade(x: Array2, normal: Array2, solid: Index1, albedo: Array2, camera: Array2, rgb: Array2):
    """The colours of points on colliders: obstacles with this albedo where `solid`, else floors."""
    ti.loop_config(block_dim=256)
    for i in range(x.shape[0]):
        p, n = row(x, i), row(normal, i)
        color = ground(p, n, camera)
        if solid[i]:
            color = matte(row(albedo, i), p, n, camera)
        put(rgb, i, color)


class Surroundings:
    """Colliders as opaque `triangles` and grid `lines`; both share one array of points."""

    def __init__(self, colliders: Sequence[Collider]):
        self.surfaces = [Surface.of(collider) for collider in colliders]
        ends, fades = zip(*(_grid(collider) for collider in colliders), strict=True)
        meshes = [s.points for s in self.surfaces]
        starts = np.cumsum([0, *map(len, meshes)])
        vertices, numbers = int(starts[-1]), np.arange(len(meshes))

        self._base = np.concatenate([*meshes, *ends]).astype(np.float32)
        upright = np.tile([0.0, 1.0, 0.0], (len(self._base) - vertices, 1))
        self._normal = np.concatenate([*(s.normal for s in self.surfaces), upright]).astype(np.float32)
        self._owner = np.repeat(np.tile(numbers, 2), [len(part) for part in (*meshes, *ends)])
        solid = np.array([not s.planar for s in self.surfaces])[self._owner]
        self._solid = (solid & (np.arange(len(solid)) < vertices)).astype(np.int32)
        self._albedo = np.array([palette.obstacle(each) for each in colliders], np.float32)[self._owner]
        self._fade = np.concatenate(fades)[:, None]
        self._x, self._rgb = np.zeros_like(self._base), np.zeros_like(self._base)

        faces = [s.faces + start for s, start in zip(self.surfaces, starts, strict=False)]
        self.triangles = Triangles.empty(vertices, np.concatenate(faces))
        self.triangles.x = self._x[:vertices]
        self.lines = Lines(self._x[vertices:], self._rgb[vertices:])
        self._last = np.zeros(0, np.float32)

    def origins(self, time: float) -> np.ndarray:
        """(colliders, 3) [m]."""
        return np.array([s.collider.place(time) for s in self.surfaces], np.float32)

    def points(self, time: float) -> np.ndarray:
        """(V, 3) float32: where the points of `triangles` are at `time` [m], whether or not they have been updated."""
        count = len(self.triangles.x)
        return self._base[:count] + self.origins(time)[self._owner[:count]]

    def update(self, origins: np.ndarray, camera: np.ndarray) -> None:
        """Fill triangles and lines, unless neither colliders nor the camera have moved."""
        now = np.concatenate([origins, camera])
        if np.array_equal(now, self._last):
            return
        self._last = now
        np.add(self._base, origins[self._owner], out=self._x)
        if len(self._x):
            shade(self._x, self._normal, self._solid, self._albedo, camera, self._rgb)
        self.triangles.rgba[:, :3] = self._rgb[: len(self.triangles.x)]
        self.lines.rgb[:] += (palette.GRID - self.lines.rgb) * self._fade
        clip(self.lines.x, camera)


def _grid(collider: Collider) -> tuple[np.ndarray, np.ndarray]:
    """Ends (2E, 3) of the grid's visible edges [m], and how much of the grid's colour (2E,) they show."""
    near, far = GRID_FADE
    edges = np.asarray(collider.edges(REACH), float).reshape(-1, 2, 3)
    places = edges + collider.place(0.0)
    away = np.hypot(places[..., 0], places[..., 2])
    seen = away.min(1) < far
    t = np.clip((far - away[seen].ravel()) / (far - near), 0.0, 1.0)
    return edges[seen].reshape(-1, 3), t * t * (3.0 - 2.0 * t)
