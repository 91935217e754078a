"""A surface that something has gone through: which part of it is on the right side, and the way there (NumPy only)."""

from collections.abc import Iterator

import numpy as np

from taichi_jello.physics.touching import Touching

AROUND = 2.0  # distances between the points: how far from a cut that is


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


def goes_through(ends: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(E, T) bool: whether the lines between the `ends` (E, 2, 3) go through the triangles with `corners` (T, 3, 3)."""
    a, b, c = np.moveaxis(corners[None] - ends[:, None, :1], 2, 0)
    way = np.broadcast_to((ends[:, 1] - ends[:, 0])[:, None], a.shape)
    volumes = np.stack([np.einsum("etd,etd->et", way, np.cross(u, w)) for u, w in ((b, c), (c, a), (a, b))])
    normal = np.cross(b - a, c - a)
    sides = np.einsum("etd,etd->et", a, normal) * np.einsum("etd,etd->et", a - way, normal)
    return ((volumes.min(0) > 0.0) | (volumes.max(0) < 0.0)) & (sides < 0.0)


def ways_back(
    touching: Touching, jello: np.ndarray, x: np.ndarray, place: np.ndarray, edges: np.ndarray, hits: np.ndarray
) -> Iterator[tuple[np.ndarray, int, np.ndarray]]:
    """For each two that have gone through each other, and each of them: which points (P,) are to leave which other
    jello, and along which way (3,). hits (E,): the elements that the edges (E, 2) of points at `place` (Q, 3) go
    through, -1 for none; jello (N,): that of each particle at x (N, 3)."""
    edge, whose = np.flatnonzero(hits >= 0), jello[touching.points]
    elements = touching.nodes[hits[edge], :3]
    where, normal = pierced(*np.moveaxis(x[elements], 1, 0), *np.moveaxis(place[edges[edge]], 1, 0))
    pair = np.stack([whose[edges[edge, 0]], jello[elements[:, 0]]], 1)
    for both in np.unique(np.sort(pair, 1), axis=0):
        found = []
        for one, other in (both, both[::-1]):
            own = np.flatnonzero((pair == (one, other)).all(1))
            if len(own):
                points, its = np.flatnonzero(whose == one), np.flatnonzero(whose[edges[:, 0]] == one)
                inner, cut = np.searchsorted(points, edges[its]), np.searchsorted(its, edge[own])
                found.append((*right_side(place[points], inner, cut, where[own], normal[own]), one, other))
        _, out, one, other = min(found, key=lambda side: side[0])
        reach = AROUND * touching.spacing[both].max()
        cuts = where[(np.sort(pair, 1) == np.sort(both)).all(1)]
        for j, k, apart in ((one, other, out), (other, one, -out)):
            points = np.flatnonzero(whose == j)
            close = np.linalg.norm(place[points][:, None] - cuts, axis=2).min(1) < reach
            if touching.radius[k] == 0.0:
                low, high = x[jello == k].min(0), x[jello == k].max(0)
                close |= np.all((low <= place[points]) & (place[points] <= high), axis=1)
            yield points[close], int(k), apart
