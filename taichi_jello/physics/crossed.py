"""Solid bodies that have gone through each other like two bars that cross: the least way apart (NumPy only)."""

import numpy as np

from taichi_jello.physics.cuts import parts

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
