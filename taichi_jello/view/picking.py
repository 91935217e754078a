"""Picking: the ray through a pixel, the first point of a jello on it, and where that point goes as the cursor moves."""

from dataclasses import dataclass

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.view.camera import NEAR, Viewpoint

Pixel = tuple[float, float]  # column and row from the upper left corner
PICK_RADIUS = 8.0  # pixels within which the cursor picks a bare particle
DEPTH_TIE = 2.0  # pixels: of particles that differ by less in their distance to the cursor, the front one is picked
EDGE_TOLERANCE = 1e-6  # barycentric: a ray must not slip through the edge between two triangles
MIN_VOLUME = 1e-12  # m³ per metre of ray: a triangle seen edge on is not hit
MAX_DISTANCE = 50.0  # m, from the eye to a pulled point
DEPTH_RATE = 2.0  # e-folds of the distance for a drag over the window's height


@dataclass(frozen=True)
class Pick:
    """A point [m] of a jello: the mean of at most 24 particles with `weights` that sum to 1."""

    particles: tuple[int, ...]
    weights: tuple[float, ...]
    point: np.ndarray


def ray(viewpoint: Viewpoint, pixel: Pixel, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Origin [m] and direction of the ray through a pixel; the direction is one metre deep along the view."""
    scale = viewpoint.pixels_per_meter(size[1])
    right, up = (pixel[0] - 0.5 * size[0]) / scale, (0.5 * size[1] - pixel[1]) / scale
    axes = viewpoint.axes()
    return viewpoint.eye.copy(), right * axes[0] + up * axes[1] - axes[2]


def pick_triangle(x: np.ndarray, surface: np.ndarray, eye: np.ndarray, direction: np.ndarray) -> Pick | None:
    """The nearest hit of a ray with triangles surface (T, 3) over points x (N, 3) (Möller and Trumbore 1997)."""
    if not len(surface):
        return None
    a, b, c = (x[surface[:, k]] for k in range(3))
    ab, ac, arm = b - a, c - a, eye - a
    side = np.cross(direction, ac)
    volume = np.einsum("ij,ij->i", ab, side)
    facing = np.abs(volume) > MIN_VOLUME
    safe = np.where(facing, volume, 1.0)
    turned = np.cross(arm, ab)
    u = np.einsum("ij,ij->i", arm, side) / safe
    v = turned @ direction / safe
    depth = np.einsum("ij,ij->i", ac, turned) / safe
    inside = (u >= -EDGE_TOLERANCE) & (v >= -EDGE_TOLERANCE) & (u + v <= 1.0 + EDGE_TOLERANCE)
    hit = facing & inside & (depth > NEAR)
    if not hit.any():
        return None
    first = int(np.flatnonzero(hit)[np.argmin(depth[hit])])
    weights = np.clip([1.0 - u[first] - v[first], u[first], v[first]], 0.0, 1.0)
    weights /= weights.sum()
    corners = surface[first]
    return Pick(tuple(corners.tolist()), tuple(weights.tolist()), weights @ x[corners])


def on_particles(body: Body, hit: Pick) -> Pick:
    """A hit on points of an embedded skin, expressed by the particles that carry these points."""
    points = list(hit.particles)
    weights = np.array(hit.weights)[:, None] * body.skin_weights[points]
    particles, which = np.unique(body.skin_corners[points], return_inverse=True)
    shares = np.bincount(which.ravel(), weights.ravel())
    used = shares > 0.0
    return Pick(tuple(particles[used].tolist()), tuple(shares[used].tolist()), hit.point)


def pick_particle(
    x: np.ndarray, allowed: np.ndarray, viewpoint: Viewpoint, pixel: Pixel, size: tuple[int, int]
) -> Pick | None:
    """The particle nearest to the cursor, within PICK_RADIUS; of near ties the one in front. allowed (N,) bool."""
    away = np.hypot(*(viewpoint.project(x, size) - pixel).T)
    away = np.where(allowed & np.isfinite(away), away, np.inf)
    nearest = away.min(initial=np.inf)
    if nearest > PICK_RADIUS:
        return None
    ties = np.flatnonzero(away <= min(nearest + DEPTH_TIE, PICK_RADIUS))
    front = int(ties[np.argmin(np.linalg.norm(x[ties] - viewpoint.eye, axis=1))])
    return Pick((front,), (1.0,), x[front].copy())


def pick(
    body: Body, x: np.ndarray, viewpoint: Viewpoint, pixel: Pixel, size: tuple[int, int], skin: bool = True
) -> Pick | None:
    """What the cursor is on, with the particles at x (N, 3) [m]; None if there is nothing.
    Without the skin, and on jellos that have none, it picks particles."""
    x = np.asarray(x, float)
    if not skin:
        return pick_particle(x, np.ones(len(x), bool), viewpoint, pixel, size)
    eye, direction = ray(viewpoint, pixel, size)
    hits = [pick_triangle(x, body.bare_surface, eye, direction)]
    if len(body.skin):
        fine = pick_triangle(body.skin_points(x), body.skin, eye, direction)
        hits.append(on_particles(body, fine) if fine is not None else None)
    hit = min((one for one in hits if one is not None), key=lambda one: np.linalg.norm(one.point - eye), default=None)
    bare = ~np.isin(body.jello, body.jello[body.surface])
    return hit or pick_particle(x, bare, viewpoint, pixel, size)


def pulled(target: np.ndarray, viewpoint: Viewpoint, right: float, up: float, in_depth: bool) -> np.ndarray:
    """Where a point (3,) [m] goes when the cursor moves by these fractions of the window's height: in the plane that
    faces the eye, or along the line of sight."""
    arm, axes = target - viewpoint.eye, viewpoint.axes()
    if in_depth:
        distance = float(np.linalg.norm(arm))
        wanted = distance * np.exp(np.clip(DEPTH_RATE * up, -50.0, 50.0))
        arm *= float(np.clip(wanted, 2.0 * NEAR, MAX_DISTANCE)) / distance
    else:
        arm += (right * axes[0] + up * axes[1]) * -(arm @ axes[2]) / viewpoint.pixels_per_meter(1)
    return viewpoint.eye + arm
