"""Ropes that go through solids: found by the places where they enter and leave, and their way out (NumPy only)."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from taichi_jello.body import Body
from taichi_jello.physics.crossed import way_apart
from taichi_jello.physics.cuts import goes_through, pierced
from taichi_jello.physics.touching import Touching

AGAINST = -0.5  # the cosine of the sides by which a rope enters and leaves what it goes through, at most
HALF = 0.5  # of a segment
DEEP = 0.3  # of a solid's thickness, or of the way through it: how far from its surface is deep
SAMPLES = 9  # places on a way through


class Threads:
    """ropes: the segments (S, 2) of particles of each rope, in their order; solids: the triangles (T, 3) of points of
    each solid, their corners round as seen from outside; both by their jello."""

    def __init__(self, touching: Touching, body: Body):
        segments = touching.nodes[touching.solid :, :2]
        triangles = outward(touching, body.rest)
        whose, owner = body.jello[touching.points], body.jello[segments[:, 0]]
        self.first = np.searchsorted(body.jello, np.arange(len(touching.rope)))
        self.whose, self.jello, self.thickness = whose, body.jello, touching.thickness
        self.ropes = {j: segments[owner == j] for j in np.flatnonzero(touching.rope)}
        self.solids = {j: triangles[whose[triangles[:, 0]] == j] for j in np.flatnonzero(touching.firm)}
        self.skinned = np.isin(np.arange(len(touching.rope)), body.jello[body.embedded])

    def close(self, x: np.ndarray, deep: bool) -> list[tuple[Any, Any]]:
        """The ropes and solids whose boxes meet with the particles at x (N, 3). deep: whether a rope has been deep in a
        contact; where none has, solids with a skin, whose points are close to each other, are left out."""
        solids = [j for j in self.solids if deep or not self.skinned[j]]
        low, high = (extreme.reduceat(x, self.first) for extreme in (np.minimum, np.maximum))
        return [(a, b) for a in self.ropes for b in solids if meet(low[a], high[a], low[b], high[b]).all()]

    def ways_off(
        self, x: np.ndarray, place: np.ndarray, close: list[tuple[Any, Any]], leaving: np.ndarray
    ) -> Iterator[tuple[np.ndarray, int, np.ndarray]]:
        """For each rope that goes through a solid, of those that are `close`, and for both: which points (Q,) bool, at
        `place` (Q, 3), are to leave which other jello, and along which way (3,). Both part as wholes: where a rope goes
        through, what is around has no side that is nearer. leaving (Q,): the jello that a point was to leave until now,
        -1 for none; such a rope is to leave until no part of it is within."""
        for rope, solid in close:
            ends = prolonged(x[self.ropes[rope]].astype(float))
            corners = place[self.solids[solid]]
            found = crossings(ends, corners)
            begun = bool(np.any(leaving[self.whose == rope] == solid)) and len(found[0]) > 0
            if begun or passes(ends, corners, self.thickness[solid], *found):
                out = way_apart(x[self.jello == rope], x[self.jello == solid])
                yield self.whose == rope, solid, out
                yield self.whose == solid, rope, -out


def outward(touching: Touching, rest: np.ndarray) -> np.ndarray:
    """(T, 3) of points: the triangles of all solids, each once, their corners round as seen from outside."""
    bare = touching.triangles[(touching.triangles >= 0).all(1) & (touching.triangles < touching.bare).all(1)]
    skin = touching.triangles[(touching.triangles >= touching.bare).all(1)]
    corners, inner = rest[touching.points[bare]], rest[touching.inner[bare]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum("td,td->t", normal, (corners - inner).sum(1)) < 0.0
    bare = np.where(inwards[:, None], bare[:, ::-1], bare)
    return np.concatenate([bare, np.unique(skin, axis=0)])


def prolonged(ends: np.ndarray) -> np.ndarray:
    """A rope whose segments have `ends` (S, 2, 3), with half of a segment more at both ends: what ends just before it
    would leave is through, too."""
    ends = ends.copy()
    ends[0, 0] += HALF * (ends[0, 0] - ends[0, 1])
    ends[-1, 1] += HALF * (ends[-1, 1] - ends[-1, 0])
    return ends


def crossings(ends: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where a rope whose segments, in order, have `ends` (S, 2, 3) goes through the triangles with `corners` (T, 3, 3),
    from its beginning on: along (K,), how many segments are before it; enters (K,) bool, or leaves; normal (K, 3)."""
    rope = ends.reshape(-1, 3)
    near = corners[meet(corners.min(1), corners.max(1), rope.min(0), rope.max(0)).all(1)]
    segment, triangle = np.nonzero(goes_through(ends, near))
    p, q = np.moveaxis(ends[segment], 1, 0)
    a, b, c = np.moveaxis(near[triangle], 1, 0)
    where, normal = pierced(a, b, c, p, q)
    along = segment + np.linalg.norm(where - p, axis=1) / np.linalg.norm(q - p, axis=1)
    order = np.argsort(along)
    return along[order], np.einsum("kd,kd->k", q - p, normal)[order] < 0.0, normal[order]


def passes(
    ends: np.ndarray, corners: np.ndarray, thick: float, along: np.ndarray, enters: np.ndarray, normal: np.ndarray
) -> bool:
    """Whether a rope with these `crossings` goes through what is `thick` [m]: enters it by one side, leaves it by
    another that faces the other way, and is deep in it between. (One that is wound tightly round a bar does the same,
    but near its face.)"""
    for k in range(len(along) - 1):
        if enters[k] and not enters[k + 1] and normal[k] @ normal[k + 1] < AGAINST:
            inside = at(ends, np.linspace(along[k], along[k + 1], SAMPLES))
            length = np.linalg.norm(np.diff(inside, axis=0), axis=1).sum()
            low, high = inside.mean(0) - length, inside.mean(0) + length
            around = meet(corners.min(1), corners.max(1), low, high).all(1)
            if distances(inside, corners[around]).max() > DEEP * min(length, thick):
                return True
    return False


def at(ends: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(K, 3) the places on a rope that are `along` (K,) of its segments, whole ones and parts, from its beginning."""
    segment = np.minimum(along.astype(int), len(ends) - 1)
    return ends[segment, 0] + (along - segment)[:, None] * (ends[segment, 1] - ends[segment, 0])


def distances(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(P,) [m]: how far the points (P, 3) are from the nearest of the triangles with `corners` (T, 3, 3)."""
    edge = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(edge[:, 0], edge[:, 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    way = points[:, None, None] - corners  # (P, T, 3, 3), from each corner
    part = np.clip(np.einsum("ptkd,tkd->ptk", way, edge) / np.einsum("tkd,tkd->tk", edge, edge), 0.0, 1.0)
    least = np.linalg.norm(way - part[..., None] * edge, axis=3).min(2)
    above = np.all(np.einsum("ptkd,tkd->ptk", way, np.cross(normal[:, None], edge)) >= 0.0, axis=2)
    return np.where(above, np.abs(np.einsum("ptd,td->pt", way[:, :, 0], normal)), least).min(1)


def meet(low: np.ndarray, high: np.ndarray, other_low: np.ndarray, other_high: np.ndarray) -> np.ndarray:
    return (low <= other_high) & (other_low <= high)
