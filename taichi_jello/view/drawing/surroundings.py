"""Colliders: floors whose grid fades into the distance, and solid obstacles."""

from dataclasses import dataclass

import numpy as np
import taichi as ti

from taichi_jello.scene.description import Collider, Scene
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
def shade(x: Array2, normal: Array2, solid: Index1, camera: Array2, rgb: Array2):
    """The colours of points on colliders: obstacles where `solid`, else floors."""
    ti.loop_config(block_dim=256)
    for i in range(x.shape[0]):
        p, n = row(x, i), row(normal, i)
        color = ground(p, n, camera)
        if solid[i]:
            color = matte(p, n, camera)
        put(rgb, i, color)


class ShadedPoints:
    """Points that move with their colliders, shaded as floors or obstacles. One item a collider: points and normal
    (n, 3) from its origin [m], and whether it is an obstacle."""

    def __init__(self, points: list[np.ndarray], normal: list[np.ndarray], solid: list[bool]):
        sizes = [len(part) for part in points]
        self._base = np.concatenate(points).astype(np.float32)
        self._normal = np.concatenate(normal).astype(np.float32)
        self._owner = np.repeat(np.arange(len(sizes)), sizes)
        self._solid = np.repeat(np.array(solid, np.int32), sizes)
        self._rgb = np.zeros_like(self._base)  # contiguous: Vulkan loses what a kernel does not write

    def fill(self, origins: np.ndarray, camera: np.ndarray, x: np.ndarray, rgb: np.ndarray) -> None:
        """Set positions x [m] and colours rgb for colliders at `origins` (colliders, 3) [m]."""
        if len(x):
            np.add(self._base, origins[self._owner], out=x)
            shade(x, self._normal, self._solid, camera, self._rgb)
            rgb[:] = self._rgb


class Surroundings:
    """All colliders of a scene as opaque `triangles` and grid `lines`."""

    def __init__(self, scene: Scene):
        self.surfaces = [Surface.of(collider) for collider in scene.collider]
        starts = np.cumsum([0] + [len(s.points) for s in self.surfaces])
        faces = [s.faces + start for s, start in zip(self.surfaces, starts, strict=False)]
        solid = [not s.planar for s in self.surfaces]
        self._meshes = ShadedPoints([s.points for s in self.surfaces], [s.normal for s in self.surfaces], solid)
        self.triangles = Triangles.empty(starts[-1], np.concatenate(faces))

        edges, fades = zip(*(_grid(collider) for collider in scene.collider), strict=True)
        upright = [np.tile([0.0, 1.0, 0.0], (len(ends), 1)) for ends in edges]
        self._edges = ShadedPoints(list(edges), upright, [False] * len(edges))
        self._fade = np.concatenate(fades)[:, None]
        self.lines = Lines.empty(len(self._fade) // 2)
        self._last = np.zeros(0, np.float32)
        self.version = 0  # counts the updates that changed something

    def origins(self, time: float) -> np.ndarray:
        """(colliders, 3) [m]."""
        return np.array([s.collider.place(time) for s in self.surfaces], np.float32)

    def update(self, origins: np.ndarray, camera: np.ndarray) -> None:
        """Fill triangles and lines, unless neither colliders nor the camera have moved."""
        now = np.concatenate([origins, camera])
        if np.array_equal(now, self._last):
            return
        self._last = now
        self.version += 1
        self._meshes.fill(origins, camera, self.triangles.x, self.triangles.rgba[:, :3])
        self._edges.fill(origins, camera, self.lines.x, self.lines.rgb)
        self.lines.rgb[:] += (palette.GRID - self.lines.rgb) * self._fade
        clip(self.lines.x, camera)


def _grid(collider: Collider) -> tuple[np.ndarray, np.ndarray]:
    """(2E, 3) ends of the grid's edges [m] that have not faded out, and how much of the grid's colour (2E,) they
    show."""
    near, far = GRID_FADE
    edges = np.asarray(collider.edges(REACH), float).reshape(-1, 2, 3)
    places = edges + collider.place(0.0)
    away = np.hypot(places[..., 0], places[..., 2])
    seen = away.min(1) < far
    t = np.clip((far - away[seen].ravel()) / (far - near), 0.0, 1.0)
    return edges[seen].reshape(-1, 3), t * t * (3.0 - 2.0 * t)
