"""A ball: a sphere embedded in the lattice cells that it passes through and encloses."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Jello
from taichi_jello.scene.validation import SceneError, number, whole
from taichi_jello.shapes._skin import MAX_EDGE, skinned_body, split_edges
from taichi_jello.shapes.lattice import MAX_PARTICLES

SAMPLES = 4  # of a cell along each axis, to find the fraction of it that is inside


def icosahedron() -> tuple[np.ndarray, np.ndarray]:
    """Its points (12, 3) on the unit sphere and its outward triangles (20, 3)."""
    g = (1.0 + np.sqrt(5.0)) / 2.0
    points = np.array([np.roll([0.0, a, b * g], turn) for turn in range(3) for a in (-1, 1) for b in (-1, 1)])
    found = [(i, j, k) for i in range(12) for j in range(i) for k in range(j)]
    near = [t for t in found if all(np.linalg.norm(points[t[a]] - points[t[a - 1]]) < 2.1 for a in range(3))]
    outward = [t if np.linalg.det(points[list(t)]) > 0 else t[::-1] for t in near]
    return points / np.sqrt(1.0 + g * g), np.array(outward)


def sphere(longest: float) -> tuple[np.ndarray, np.ndarray]:
    """A mesh of the unit sphere with edges of about `longest`: a subdivided icosahedron."""
    points, triangles = icosahedron()
    edge = 1.06
    while edge > longest:
        edge /= 2.0
        points, triangles = split_edges(points, triangles, 1.2 * edge)
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    return points, triangles


@dataclass(frozen=True, kw_only=True)
class Ball(Jello):
    """A ball of `radius` [m], `resolution` lattice cells across."""

    shape: ClassVar[str] = "ball"
    radius: float = 0.5
    resolution: int = 8

    def check(self) -> dict[str, Any]:
        resolution = whole("resolution", self.resolution, low=2)
        if (resolution + 1) ** 3 > MAX_PARTICLES:
            raise SceneError("resolution", f"expected at most {round(MAX_PARTICLES ** (1 / 3)) - 1}, got {resolution}")
        return super().check() | {"radius": number("radius", self.radius, above=0.0), "resolution": resolution}

    def skin(self) -> tuple[np.ndarray, np.ndarray]:
        """A mesh of the unit sphere, fine enough for its cells."""
        return sphere(MAX_EDGE * 2.0 / self.resolution)

    def body(self) -> Body:
        n, r = self.resolution, self.radius
        fine = (np.arange(n * SAMPLES) + 0.5) / (n * SAMPLES) * 2.0 - 1.0
        inside = (fine[:, None, None] ** 2 + fine[:, None] ** 2 + fine**2) <= 1.0
        fraction = inside.reshape(n, SAMPLES, n, SAMPLES, n, SAMPLES).mean((1, 3, 5))
        line = np.linspace(-1.0, 1.0, n + 1)
        nearest = np.maximum(np.maximum(line[:-1], -line[1:]), 0.0) ** 2  # squared distances of cells to the middle
        filled = nearest[:, None, None] + nearest[:, None] + nearest < 1.0 - 1e-9
        within = line[:, None, None] ** 2 + line[:, None] ** 2 + line**2 <= 1.0
        points, triangles = self.skin()
        return skinned_body(self, r * points, triangles, filled, fraction, 2.0 * r / n, within)
