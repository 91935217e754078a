"""Where jellos without a position begin: just above what carries them, side by side."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from taichi_jello.physics.colliders.room import Room
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Collider, Scene

CLEARANCE = 0.02  # of its height, above what carries it
GAP = 0.1  # of the widest one, between neighbours
# Barycentric coordinates of points on a triangle, so that a sphere or an edge between its corners is noticed.
SAMPLES = np.array([(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]) / 4.0


def outline(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) [m] the particles that collide and points of the surfaces, or of the springs of what has no surface, and
    (n,) the jello of each."""
    threads = body.springs[np.isin(body.jello[body.springs[:, 0]], body.ropes)]
    faces = np.concatenate([body.bare_surface, np.repeat(threads, [1, 2], axis=1)])
    corners = np.concatenate([body.x[faces], body.skin_points(body.x)[body.skin]])
    owner = np.concatenate([body.jello[faces[:, 0]], body.jello[body.skin_corners[body.skin[:, 0], 0]]])
    samples = np.einsum("sk,tkd->tsd", SAMPLES, corners).reshape(-1, 3)
    own = ~body.embedded
    return np.concatenate([body.x[own], samples]), np.concatenate([body.jello[own], np.repeat(owner, len(SAMPLES))])


def tops(collider: Sequence[Collider], points: np.ndarray) -> np.ndarray:
    """(n,) [m] the heights of the highest colliders below or above `points` (n, 3), at the start; -inf without any."""
    places = [(each, each.place(0.0)) for each in collider]
    return np.max([each.top(*(points - place)[:, ::2].T) + place[1] for each, place in places], axis=0)


def placed(scene: Scene, bodies: list[Body]) -> list[Body]:
    """The bodies of the scene's jellos, those without a position moved to where they begin."""
    free = [j for j, jello in enumerate(scene.jello) if jello.position is None and jello.x is None]
    if not free or not scene.collider or scene.gravity[1] >= 0.0:
        return bodies
    points = row([outline(bodies[j])[0] for j in free])
    where = middle(scene.collider, np.concatenate(points))
    if where is None:
        return bodies
    points = [standing(scene.collider, each + where) for each in points]
    others = [body.extent(0) for j, body in enumerate(bodies) if j not in free]
    if any(overlap(each, other) for each in points for other in others):
        left, gap = points[0][:, 0].min(), GAP * max(np.ptp(each[:, 0]) for each in points)
        aside = np.array([max(high[0] for _, high in others) + gap - left, 0.0, 0.0])
        points = [standing(scene.collider, each + aside) for each in points]
    result = list(bodies)
    for j, each in zip(free, points, strict=True):
        result[j] = replace(bodies[j], x=bodies[j].x + (each[0] - outline(bodies[j])[0][0]))
    return result


def row(points: list[np.ndarray]) -> list[np.ndarray]:
    """The points (n, 3) [m] of each jello, set side by side along x, with the middle of the row at the origin."""
    width = np.array([np.ptp(each[:, 0]) for each in points])
    left = np.cumsum(width + GAP * width.max()) - width
    left -= 0.5 * (left[0] + left[-1] + width[-1])
    moved = []
    for each, start, wide in zip(points, left, width, strict=True):
        centre = 0.5 * (each.min(0) + each.max(0))
        moved.append(each - centre + [start + 0.5 * wide, 0.0, 0.0])
    return moved


def middle(collider: Sequence[Collider], points: np.ndarray) -> np.ndarray | None:
    """(3,) [m] where, at y = 0, the middle of a row of jellos belongs: in the middle of a room, else at the origin, or
    over the first collider that carries something; None without any. points (n, 3) [m]: of the row around the origin.
    """
    rooms = [0.5 * (np.array(room.max) - room.min) + room.place(0.0) for room in collider if isinstance(room, Room)]
    for choice in rooms or [np.zeros(3), *(each.place(0.0) for each in collider)]:
        level = choice * [1.0, 0.0, 1.0]
        if np.isfinite(tops(collider, points + level)).any():
            return level
    return None


def standing(collider: Sequence[Collider], points: np.ndarray) -> np.ndarray:
    """The points (n, 3) [m] of a jello, just above what carries it; as they are if nothing does."""
    lift = lift_out(collider, points)
    if not np.isfinite(lift):
        return points
    size = np.ptp(points, axis=0)
    return points + [0.0, lift + CLEARANCE * (size[1] or size.max() or 1.0), 0.0]


def lift_out(collider: Sequence[Collider], points: np.ndarray) -> float:
    """[m] How far points (n, 3) must rise, or may fall if negative, until the lowest touches what is below it."""
    return float((tops(collider, points) - points[:, 1]).max())


def overlap(points: np.ndarray, box: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether the bounding box of the points (n, 3) overlaps another one, given by opposite corners (3,)."""
    low, high = box
    return bool(np.all((points.min(0) < high) & (points.max(0) > low)))
