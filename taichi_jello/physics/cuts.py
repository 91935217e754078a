"""A surface that something has gone through: which part of it is on the right side, and the way there (NumPy only)."""

import numpy as np

from taichi_jello.physics.touching import Touching


def surface_edges(touching: Touching) -> np.ndarray:
    """(E, 2) pairs of points, smaller first: the edges of all surfaces, and the segments of ropes."""
    point_of = np.full(touching.nodes.max() + 1, -1, np.int32)
    point_of[touching.points[: touching.bare]] = np.arange(touching.bare)
    thin = point_of[touching.nodes[touching.solid :, :3]]
    triangles = np.concatenate([touching.triangles[(touching.triangles >= 0).all(1)], thin])
    pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0).astype(np.int32)


def parts(count: int, edges: np.ndarray) -> np.ndarray:
    """(count,) for each point the smallest number of one that edges (E, 2) lead to from it."""
    label = np.arange(count)
    while True:
        least = label[edges].min(1, initial=count)
        before = label.copy()
        for end in range(2):
            np.minimum.at(label, before[edges[:, end]], least)
            np.minimum.at(label, edges[:, end], least)
        label = label[label]
        if np.array_equal(label, before):
            return label


def right_side(
    place: np.ndarray, edges: np.ndarray, cut: np.ndarray, where: np.ndarray, normal: np.ndarray
) -> tuple[float, np.ndarray]:
    """What of a surface with its points at `place` (P, 3) and `edges` (E, 2), of which those numbered `cut` (K,) go
    through triangles of another at `where` (K, 3) with the unit normals `normal` (K, 3), has gone through: how much of
    it, and the unit vector (3,) along which it comes back. The larger of its parts is on the right side; where the cut
    ends within it, so that it hangs together, the larger side of the other one's mean plane."""
    label = parts(len(place), np.delete(edges, cut, axis=0))
    number, size = np.unique(label, return_counts=True)
    largest = number[size.argmax()]
    right = label[edges[cut]] == largest
    split = right[:, 0] != right[:, 1]
    wrong, way = 1.0 - size.max() / len(place), np.zeros(3)
    if split.any():
        side = np.einsum("kd,kd->k", place[edges[cut, 0]] - where, normal)
        sign = np.where(right[:, 0], 1.0, -1.0) * np.where(side < 0.0, -1.0, 1.0)
        way = ((sign * split)[:, None] * normal).sum(0)
    if np.linalg.norm(way) < 0.1 * len(cut):  # whole, or cut around it
        way = normal[0] if np.linalg.norm(normal.sum(0)) < 0.1 * len(cut) else normal.sum(0)
        above = float(np.mean((place - where.mean(0)) @ way > 0.0))
        way, wrong = (way, 1.0 - above) if above >= 0.5 else (-way, above)
    return float(wrong), way / np.linalg.norm(way)


def pierced(a: np.ndarray, b: np.ndarray, c: np.ndarray, p: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the lines from p to q go through the triangles a, b, c, (K, 3) each, and the triangles' unit normals."""
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    before, behind = (np.abs(np.einsum("kd,kd->k", end - a, normal))[:, None] for end in (p, q))
    return (behind * p + before * q) / (before + behind), normal
