"""Jellos that begin crossed, an edge of one through a face of another (NumPy only).

Touching is not crossing: two jellos are crossed if they are so with the second one shifted a little in each of eight
directions. Shifted, no edge lies in the plane of a face.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from taichi_jello.scene.body import Body

SHIFTS = 1e-3 * (2.0 * np.indices((2, 2, 2)).reshape(3, -1).T - 1.0) * [1.0, 0.7, 0.5]  # shortest edges
PAIRS_AT_ONCE = 2**16  # of an edge and a triangle that are tested together


@dataclass(frozen=True)
class Surfaces:
    """The edges (E, 2) and triangles (T, 3) of the surfaces of all jellos, with the segments of ropes among the edges.
    They index particles, then the points of skins. edge_owner (E,), owner (T,): the jello of each; solid (J,) bool:
    which jellos have cells."""

    body: Body
    edges: np.ndarray
    triangles: np.ndarray
    edge_owner: np.ndarray
    owner: np.ndarray
    solid: np.ndarray

    @classmethod
    def of(cls, body: Body) -> "Surfaces":
        whose = np.concatenate([body.jello, body.jello[body.skin_corners[:, 0]]])
        triangles = np.unique(np.sort(np.concatenate([body.bare_surface, len(body) + body.skin]), 1), axis=0)
        faced, structural = np.isin(body.jello, whose[triangles[:, 0]]), body.springs[body.family == 0]
        ropes = np.sort(structural[~faced[structural[:, 0]]], 1)
        sides = triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2)
        edges = np.unique(np.concatenate([sides, ropes]), axis=0)
        solid = np.isin(np.arange(body.jello.max() + 1), body.jello[body.cells[:, 0]])
        return cls(body, edges, triangles, whose[edges[:, 0]], whose[triangles[:, 0]], solid)

    def places(self, x: np.ndarray) -> np.ndarray:
        """(P, 3) [m] the points that edges and triangles index, with the particles at x (N, 3)."""
        return np.concatenate([x, self.body.skin_points(x)])


def crossings(surfaces: Surfaces) -> Iterator[tuple[int, int, np.ndarray]]:
    """The pairs of jellos that begin crossed, each with a place (3,) where they are."""
    place = surfaces.places(surfaces.body.x.astype(float))
    jellos = range(len(surfaces.solid))
    ends = [place[surfaces.edges[surfaces.edge_owner == j]] for j in jellos]
    corners = [place[surfaces.triangles[surfaces.owner == j]] for j in jellos]
    some = np.array([j for j in jellos if len(ends[j])], int)
    low, high = (np.array([f(ends[j].reshape(-1, 3), 0) for j in some]) for f in (np.min, np.max))
    pairs = np.argwhere(np.triu(meet(low[:, None], high[:, None], low, high), 1))
    for a, b in some[pairs].tolist():
        where = crossed(ends[a], corners[a], ends[b], corners[b])
        if where is not None:
            yield a, b, where


def crossed(ends: np.ndarray, corners: np.ndarray, its_ends: np.ndarray, its_corners: np.ndarray) -> np.ndarray | None:
    """A place (3,) where two surfaces of edges (E, 2, 3) and triangles (T, 3, 3) cross, if they do."""
    shortest = min(np.linalg.norm(line[:, 1] - line[:, 0], axis=1).min() for line in (ends, its_ends))
    where = None
    for shift in shortest * SHIFTS:
        where = pierced(ends, its_corners + shift)
        if where is None:
            where = pierced(its_ends + shift, corners)
        if where is None:
            break
    return where


def pierced(ends: np.ndarray, corners: np.ndarray) -> np.ndarray | None:
    """A place (3,) where one of the edges (E, 2, 3) goes through one of the triangles (T, 3, 3), if one does. The
    larger set is halved across its longest axis until few pairs are in the same box."""
    low, high = corners.min((0, 1), initial=np.inf), corners.max((0, 1), initial=-np.inf)
    ends = ends[meet(ends.min(1), ends.max(1), low, high)]
    low, high = ends.min((0, 1), initial=np.inf), ends.max((0, 1), initial=-np.inf)
    corners = corners[meet(corners.min(1), corners.max(1), low, high)]
    if len(ends) * len(corners) <= PAIRS_AT_ONCE:
        i, j = np.nonzero(meet(ends.min(1)[:, None], ends.max(1)[:, None], corners.min(1), corners.max(1)))
        found = np.flatnonzero(goes_through(ends[i], corners[j]))
        return where_through(ends[i[found[0]]], corners[j[found[0]]]) if len(found) else None
    larger = max(ends, corners, key=len)
    middle = larger.mean(1)
    order = np.argsort(middle[:, np.ptp(middle, axis=0).argmax()])
    for half in np.array_split(larger[order], 2):
        where = pierced(half, corners) if larger is ends else pierced(ends, half)
        if where is not None:
            return where
    return None


def meet(low: np.ndarray, high: np.ndarray, other_low: np.ndarray, other_high: np.ndarray) -> np.ndarray:
    """Whether boxes with corners (..., 3) meet."""
    found: np.ndarray = np.all((low <= other_high) & (other_low <= high), axis=-1)
    return found


def goes_through(ends: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(...) bool: whether the edges (..., 2, 3) go through the triangles (..., 3, 3)."""
    start, way = ends[..., 0, :], ends[..., 1, :] - ends[..., 0, :]
    a, b, c = (corners[..., k, :] - start for k in range(3))
    volumes = np.stack([(way * np.cross(u, w)).sum(-1) for u, w in ((b, c), (c, a), (a, b))])  # of one sign inside
    normal = np.cross(b - a, c - a)
    inside: np.ndarray = (volumes.min(0) > 0.0) | (volumes.max(0) < 0.0)
    return inside & ((a * normal).sum(-1) * ((a - way) * normal).sum(-1) < 0.0)


def where_through(ends: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(3,) where an edge goes through a triangle."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    before, behind = np.abs((ends - corners[0]) @ normal)
    place: np.ndarray = (behind * ends[0] + before * ends[1]) / (before + behind)
    return place
