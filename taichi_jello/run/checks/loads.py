"""Loads on the contact springs of jellos: stacked weight, falls, and colliders that close in on them (NumPy only)."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Collider, Scene

MOMENTS = 61  # at which the positions of moving colliders are sampled
TRACES = 64  # sphere-tracing steps, at most
NEAR = 1e-4  # m, the distance to a surface at which a trace ends
OVERLAP = 0.25  # of the lower jello's height: how deep in it a jello may start and still count as lying on it


@dataclass(frozen=True)
class Piles:
    """Which jello lies on which. lies_on (J,): the jello below each, -1 for none; carried (J,) [kg]: the mass on top of
    each; fall (J,) [m]: the height of each above what is below it, infinite if nothing is."""

    lies_on: np.ndarray
    carried: np.ndarray
    fall: np.ndarray

    @classmethod
    def of(cls, scene: Scene, body: Body) -> "Piles":
        points, owner = touching(body)
        jellos, axes = range(len(scene.jello)), upright(scene)
        along = points @ axes.T  # the last axis is up
        low, high = (np.array([f(along[owner == j], axis=0) for j in jellos]) for f in (np.min, np.max))
        mass, held = np.bincount(body.jello, body.mass), np.isin(jellos, body.jello[body.pinned])
        lies_on, fall = np.full(len(mass), -1), np.full(len(mass), np.inf)
        for j in jellos:
            beside = np.any((low[:, :2] >= high[j, :2]) | (high[:, :2] <= low[j, :2]), axis=1)
            room = low[j, 2] - high[:, 2]
            below = ~beside & (room > -OVERLAP * (high[:, 2] - low[:, 2])) & (low[:, 2] < low[j, 2])
            if scene.contact.touch and below.any():
                lies_on[j] = np.flatnonzero(below)[room[below].argmin()]
                fall[j] = max(room[lies_on[j]], 0.0)
            ground = drop(scene.collider, points[owner == j], axes[2])
            if ground < fall[j]:
                lies_on[j], fall[j] = -1, max(ground, 0.0)
        carried = np.zeros(len(mass))
        for j in np.argsort(-low[:, 2]):  # from the top down
            if lies_on[j] >= 0 and not held[j]:
                carried[lies_on[j]] += mass[j] + carried[j]
        return cls(lies_on, carried, fall)


def touching(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """The points that collide, (n, 3) [m]: particles and points of embedded skins; and the jello of each, (n,)."""
    bare = ~body.embedded
    owner = np.concatenate([body.jello[bare], body.jello[body.skin_corners[:, 0]]])
    return np.concatenate([body.x[bare], body.skin_points(body.x)]), owner


def upright(scene: Scene) -> np.ndarray:
    """(3, 3): two horizontal unit vectors and the one opposite to gravity."""
    up = -np.array(scene.gravity) / np.linalg.norm(scene.gravity)
    level = np.cross(np.eye(3)[np.abs(up).argmin()], up)
    level /= np.linalg.norm(level)
    return np.stack([level, np.cross(up, level), up])


def drop(collider: Any, points: np.ndarray, up: np.ndarray) -> float:
    """How far [m] the lowest of the points (n, 3) can fall before it meets a collider; infinite if it meets none."""
    lowest = points[points @ up <= (points @ up).min() + 1e-6 * (np.ptp(points @ up) or 1.0)].mean(0)
    return min((trace(each, lowest, -up) for each in collider), default=np.inf)


def trace(collider: Collider, start: np.ndarray, way: np.ndarray) -> float:
    """The distance [m] from `start` (3,) to a collider along the unit vector `way`, at time 0; infinite if the ray
    misses (sphere tracing, Hart 1996)."""
    gone, here = 0.0, start - collider.place(0.0)
    for _ in range(TRACES):
        left = float(collider.distance((here + gone * way)[None])[0])
        if left < NEAR:
            return gone
        gone += left
        if not gone < 1e6:
            break
    return np.inf


@dataclass(frozen=True)
class Press:
    """Two `colliders` leave jello `jello`, of extent `size` [m] between them, a gap of only `gap` [m]."""

    jello: int
    colliders: tuple[int, int]
    size: float
    gap: float


def presses(scene: Scene, body: Body) -> list[Press]:
    """The jellos that moving colliders squeeze along an axis: for each the axis on which it is squeezed most."""
    if not scene.collider:
        return []
    moments = np.linspace(0.0, scene.seconds, MOMENTS)
    keys = [key.time for each in scene.collider for key in each.keyframe if key.time <= scene.seconds]
    moments = np.unique(np.concatenate([moments, keys]))
    places = np.array([[each.place(t) for t in moments] for each in scene.collider])  # (C, M, 3)
    moved = places - places[:, :1]
    if not moved.any():
        return []
    points, owner = touching(body)
    found = []
    for j in range(len(scene.jello)):
        own = points[owner == j]
        middle, sizes, worst = 0.5 * (own.min(0) + own.max(0)), np.ptp(own, axis=0), None
        for axis in np.flatnonzero(sizes > 0.0):
            ways = [[trace(each, middle, side * np.eye(3)[axis]) for each in scene.collider] for side in (-1.0, 1.0)]
            a, b = (int(np.argmin(way)) for way in ways)
            if a == b or not np.isfinite(ways[0][a] + ways[1][b]):
                continue
            gap = float(ways[0][a] + ways[1][b] + (moved[b, :, axis] - moved[a, :, axis]).min())
            if gap < sizes[axis] and (worst is None or gap - sizes[axis] < worst.gap - worst.size):
                worst = Press(j, (a, b), float(sizes[axis]), max(gap, 0.0))
        found += [worst] if worst else []
    return found
