"""Colliders: floors with a grid that fade into the distance, and solid obstacles."""

from dataclasses import dataclass

import numpy as np
import taichi as ti

from taichi_jello.scene.description import Collider, Scene
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.primitives import WIDTH, Lines, Triangles
from taichi_jello.view.drawing.rows import Array2, Index1, row
from taichi_jello.view.drawing.shading import REACH, TOWARDS_EYE, clip, ground, matte

GRID_SEEN = (0.12 * REACH, 0.66 * REACH)  # m from the origin; the grid lines fade out between the two


@dataclass(frozen=True)
class Surface:
    """A collider's mesh. points (V, 3) [m] from its origin, normal (V, 3), faces (F, 3); level: all in one
    plane."""

    collider: Collider
    points: np.ndarray
    normal: np.ndarray
    faces: np.ndarray
    level: bool

    @classmethod
    def of(cls, collider: Collider) -> "Surface":
        points, faces = collider.mesh(REACH)
        normal = np.zeros_like(points)
        for corner in range(3):
            a, b, c = (points[faces[:, k]] for k in range(3))
            np.add.at(normal, faces[:, corner], np.cross(b - a, c - a))
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        flat = len(points) > 0 and bool(np.all(normal @ normal[0] > 0.9999))
        height = (points - points[:1]) @ normal[0] if flat else np.ones(1)
        return cls(collider, points, normal, faces, flat and bool(np.abs(height).max() < 1e-6 * REACH))


@ti.kernel
def paint(x: Array2, normal: Array2, solid: Index1, look: Array2, rgb: Array2):
    """The colours of points on colliders, as a floor or where `solid` as an obstacle."""
    ti.loop_config(block_dim=256)
    for i in range(x.shape[0]):
        p, n = row(x, i), row(normal, i)
        color = ground(p, n, look)
        if solid[i]:
            color = matte(p, n, look)
        for k in ti.static(range(3)):
            rgb[i, k] = color[k]


class Painted:
    """Points of colliders that move with them, shaded as a floor or as an obstacle."""

    def __init__(self, points: list[np.ndarray], normal: list[np.ndarray], solid: list[bool]):
        sizes = [len(part) for part in points]
        self._base = np.concatenate(points).astype(np.float32)
        self._normal = np.concatenate(normal).astype(np.float32)
        self._owner = np.repeat(np.arange(len(sizes)), sizes)
        self._solid = np.repeat(np.array(solid, np.int32), sizes)
        self._rgb = np.zeros_like(self._base)  # written whole: Vulkan loses what a kernel leaves

    def __len__(self) -> int:
        return len(self._base)

    def paint(self, origins: np.ndarray, look: np.ndarray, x: np.ndarray, rgb: np.ndarray) -> None:
        """Set places x [m] and colours rgb for colliders at `origins` (colliders, 3) [m]."""
        np.add(self._base, origins[self._owner], out=x)
        paint(x, self._normal, self._solid, look, self._rgb)
        rgb[:] = self._rgb


class Surroundings:
    """All colliders of a scene as opaque `triangles` and grid `lines`."""

    def __init__(self, scene: Scene):
        self.surfaces = [Surface.of(collider) for collider in scene.collider]
        starts = np.cumsum([0] + [len(s.points) for s in self.surfaces])
        faces = [s.faces + start for s, start in zip(self.surfaces, starts, strict=False)]
        solid = [not s.level for s in self.surfaces]
        self._meshes = Painted([s.points for s in self.surfaces], [s.normal for s in self.surfaces], solid)
        self.triangles = Triangles.empty(len(self._meshes), np.concatenate(faces))

        edges = [_visible(collider) for collider in scene.collider]
        upright = [np.tile([0.0, 1.0, 0.0], (len(part), 1)) for part in edges]
        self._edges = Painted(edges, upright, [False] * len(edges))
        self._seen = np.concatenate([_fading(e, c) for e, c in zip(edges, scene.collider, strict=True)])[:, None]
        self.lines = Lines.empty(len(self._edges) // 2, WIDTH)
        self._painted = np.zeros(0, np.float32)

    def origins(self, time: float) -> np.ndarray:
        """(colliders, 3) [m]."""
        return np.array([s.collider.place(time) for s in self.surfaces], np.float32)

    def update(self, origins: np.ndarray, look: np.ndarray) -> None:
        """Paint all, unless nothing has moved since."""
        now = np.concatenate([origins, look])
        if np.array_equal(now, self._painted):
            return
        self._painted = now
        if len(self._meshes):
            self._meshes.paint(origins, look, self.triangles.x, self.triangles.rgba[:, :3])
        if len(self._edges):
            self._edges.paint(origins, look, self.lines.x, self.lines.rgb)
            self.lines.rgb[:] += (palette.GRID - self.lines.rgb) * self._seen
            clip(self.lines.x, look, TOWARDS_EYE)


def _away(points: np.ndarray, collider: Collider) -> np.ndarray:
    """How far [m] points lie from the world's vertical axis when the scene starts."""
    places = points + collider.place(0.0)
    return np.hypot(places[..., 0], places[..., 2])


def _fading(ends: np.ndarray, collider: Collider) -> np.ndarray:
    """(2E,) how much of the grid's colour each end shows."""
    near, far = GRID_SEEN
    t = np.clip((far - _away(ends, collider)) / (far - near), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _visible(collider: Collider) -> np.ndarray:
    """(2E, 3) the ends of those edges that have not faded out [m]."""
    edges = np.asarray(collider.edges(REACH), float).reshape(-1, 2, 3)
    return edges[_away(edges, collider).min(1) < GRID_SEEN[1]].reshape(-1, 3)
