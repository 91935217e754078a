"""Bodies that have gone through each other like two bars that cross: the least way apart (NumPy only)."""

from collections.abc import Iterator

import numpy as np

from taichi_jello.physics.cuts import parts
from taichi_jello.physics.touching import AT_ONCE, Touching

BEYOND = 2.0  # times as far as contacts reach: how far from their middle what holds each other is
AGREE = 0.6  # as much of all normals as their sum is, where they press one way
DIRECTIONS = 300


def clusters(place: np.ndarray, reach: float) -> np.ndarray:
    """(K,) numbers: places (K, 3) have the same one where steps of about `reach` [m] lead from one to the other: from
    one to the next of the cubes, half as long, that hold any."""
    cubes, which = np.unique(np.floor(2.0 * place / reach).astype(int), axis=0, return_inverse=True)
    first, second = np.nonzero(np.triu(np.abs(cubes[:, None] - cubes).max(2) <= 2, 1))
    return parts(len(cubes), np.stack([first, second], 1))[which.ravel()]


def hold_each_other(normal: np.ndarray, depth: np.ndarray, deep: np.ndarray) -> bool:
    """Whether contacts with the normals (K, 3), all seen from one body, press against each other, some of them deep."""
    return bool(np.any(depth > deep)) and float(np.linalg.norm(normal.sum(0))) < AGREE * len(normal)


def way_apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The unit vector (3,) along which particles at `one` (A, 3) have the least way until they are all beyond those at
    `other` (B, 3), of DIRECTIONS spread over the sphere (Fibonacci's lattice)."""
    number = np.arange(DIRECTIONS) + 0.5
    up, turn = 1.0 - 2.0 * number / DIRECTIONS, np.pi * (1.0 + 5.0**0.5) * number
    level = np.sqrt(1.0 - up * up)
    way = np.stack([level * np.cos(turn), up, level * np.sin(turn)], 1)
    length = (other @ way.T).max(0) - (one @ way.T).min(0)
    return way[length.argmin()]


def ways_apart(
    touching: Touching, jello: np.ndarray, x: np.ndarray, place: np.ndarray, touched: np.ndarray
) -> Iterator[tuple[np.ndarray, int, np.ndarray]]:
    """For each two that hold each other, and each of them: which points (Q,) bool are to leave which other jello, and
    along which way (3,). touched (AT_ONCE Q, 6): the contacts of points at `place` (Q, 3), see Tangles._press; jello
    (N,): that of each particle at x (N, 3)."""
    whose, found = jello[touching.points], np.flatnonzero(touched[:, 5])
    pair = np.sort(np.stack([whose[found // AT_ONCE], touched[found, 5].astype(int) - 1], 1), 1)
    for a, b in np.unique(pair, axis=0):
        own = found[(pair == (a, b)).all(1)]
        normal = np.where(whose[own // AT_ONCE, None] == a, 1.0, -1.0) * touched[own, :3]
        where = place[own // AT_ONCE]
        label = clusters(where, 1.5 * touching.spacing[[a, b]].max())
        for here in (label == number for number in np.unique(label)):
            if not hold_each_other(normal[here], *touched[own[here], 3:5].T):
                continue
            middle = where[here].mean(0)
            reach = BEYOND * np.linalg.norm(where[here] - middle, axis=1).max()
            one, other = (x[(jello == j) & within(x, middle, reach)] for j in (a, b))
            if len(one) and len(other):
                out, close = way_apart(one, other), within(place, middle, reach)
                yield (whose == a) & close, b, out
                yield (whose == b) & close, a, -out


def within(place: np.ndarray, middle: np.ndarray, reach: float) -> np.ndarray:
    return np.linalg.norm(place - middle, axis=1) < reach
