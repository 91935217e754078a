"""Handles: pins that move, and the points they hold with them."""

from collections.abc import Sequence

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.scene.keyframes import Move, offset
from taichi_jello.scene.region import places


class Handles:
    """The particles `held` (n,) by pins with keyframes. If two pins hold a particle the later one moves it."""

    def __init__(self, scene: Scene, body: Body):
        self.path: list[tuple[np.ndarray, Sequence[Move]]] = []
        for index, jello in enumerate(scene.jello):
            own = np.flatnonzero(body.jello == index)
            where = places(body.rest[own], body.rest[own])
            self.path += [(own[pin.holds(where)], pin.keyframe) for pin in jello.pin]
        moved = [held for held, rows in self.path if rows]
        self.held = np.unique(np.concatenate(moved)) if moved else np.zeros(0, int)
        self.x, self.mass = body.x, body.mass[self.held]

    def kinetic(self, v: np.ndarray) -> float:
        """½ Σ m v² [J] of the held particles, with all particles at v (N, 3) [m/s]."""
        return 0.5 * float(self.mass @ (v[self.held].astype(float) ** 2).sum(1))

    def motion(self, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) each: the held particles' positions at `start` [m] and their mean velocities until `end` [m/s]. The
        body is given where its handles are at time 0."""
        here, there = np.zeros_like(self.x), np.zeros_like(self.x)
        for held, rows in self.path:
            here[held], there[held] = (offset(rows, time) - offset(rows, 0.0) for time in (start, end))
        return (self.x + here)[self.held], ((there - here) / (end - start))[self.held]
