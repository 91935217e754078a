"""What lies under the cursor: the ray through a place in the window, and the first point of a jello that it meets."""

from dataclasses import dataclass

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.view.camera import NEAR, Viewpoint

Place = tuple[float, float]  # column and row [pixels], from the upper left corner
REACH = 8.0  # pixels between the cursor and a bare particle that it still picks
CROWD = 2.0  # pixels by which one particle may be farther from the cursor than another and, being in front, be picked
EDGE = 1e-6  # of a triangle: a ray through the edge of two triangles must not slip between them
FLAT = 1e-12  # m³ per metre: of triangles seen edge on, nothing is seen


@dataclass(frozen=True)
class Pick:
    """A point [m] of a jello: the mean of some of its particles, 24 at most, by `weights`, which sum to 1."""

    particles: tuple[int, ...]
    weights: tuple[float, ...]
    point: np.ndarray


def ray(viewpoint: Viewpoint, at: Place, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Where the ray through `at` begins [m], and its way: a metre of depth, so that depth · way leads to a depth."""
    scale = viewpoint.pixels_per_meter(size[1])
    across, up = (at[0] - 0.5 * size[0]) / scale, (0.5 * size[1] - at[1]) / scale
    right, upwards, back = viewpoint.axes()
    return viewpoint.eye.copy(), across * right + up * upwards - back


def pick_skin(x: np.ndarray, surface: np.ndarray, eye: np.ndarray, way: np.ndarray) -> Pick | None:
    """The first triangle of surface (T, 3) that the ray meets, by Möller and Trumbore's method over all at once."""
    if not len(surface):
        return None
    a, b, c = (x[surface[:, k]] for k in range(3))
    ab, ac, arm = b - a, c - a, eye - a
    side = np.cross(way, ac)
    volume = np.einsum("ij,ij->i", ab, side)
    seen = np.abs(volume) > FLAT
    safe = np.where(seen, volume, 1.0)
    turned = np.cross(arm, ab)
    u = np.einsum("ij,ij->i", arm, side) / safe
    v = turned @ way / safe
    depth = np.einsum("ij,ij->i", ac, turned) / safe
    met = seen & (u >= -EDGE) & (v >= -EDGE) & (u + v <= 1.0 + EDGE) & (depth > NEAR)
    if not met.any():
        return None
    first = int(np.flatnonzero(met)[np.argmin(depth[met])])
    weights = np.clip([1.0 - u[first] - v[first], u[first], v[first]], 0.0, 1.0)
    weights /= weights.sum()
    corners = surface[first]
    return Pick(tuple(int(k) for k in corners), tuple(float(w) for w in weights), weights @ x[corners])


def carriers(body: Body, found: Pick) -> Pick:
    """A pick among the points of embedded skins as a pick among the particles that carry them."""
    on = list(found.particles)
    weights = np.array(found.weights)[:, None] * body.skin_weights[on]
    particles, which = np.unique(body.skin_corners[on], return_inverse=True)
    shares = np.bincount(which.ravel(), weights.ravel())
    used = shares > 0.0
    return Pick(tuple(particles[used].tolist()), tuple(shares[used].tolist()), found.point)


def pick_particle(
    x: np.ndarray, allowed: np.ndarray, viewpoint: Viewpoint, at: Place, size: tuple[int, int]
) -> Pick | None:
    """The particle nearest to the ray, within REACH; of those that crowd there, the one in front.

    allowed (N,) bool: which may be picked."""
    places = viewpoint.project(x, size)
    away = np.hypot(*(places - at).T)
    away[~allowed] = np.inf
    away = np.nan_to_num(away, nan=np.inf)
    nearest = away.min(initial=np.inf)
    if nearest > REACH:
        return None
    crowd = np.flatnonzero(away <= min(nearest + CROWD, REACH))
    one = int(crowd[np.argmin(np.linalg.norm(x[crowd] - viewpoint.eye, axis=1))])
    return Pick((one,), (1.0,), x[one].copy())


def pick(
    body: Body, x: np.ndarray, viewpoint: Viewpoint, at: Place, size: tuple[int, int], skin: bool = True
) -> Pick | None:
    """What of the body, its particles at x (N, 3) [m], the cursor at `at` is on; None where there is nothing.

    Without the skin, and on jellos that have none, particles are picked."""
    x = np.asarray(x, float)
    if not skin:
        return pick_particle(x, np.ones(len(x), bool), viewpoint, at, size)
    eye, way = ray(viewpoint, at, size)
    met = [pick_skin(x, body.bare_surface, eye, way)]
    if len(body.skin):
        fine = pick_skin(body.skin_points(x), body.skin, eye, way)
        met.append(carriers(body, fine) if fine is not None else None)
    found = min((one for one in met if one is not None), key=lambda one: np.linalg.norm(one.point - eye), default=None)
    bare = ~np.isin(body.jello, body.jello[body.surface])
    return found or pick_particle(x, bare, viewpoint, at, size)
