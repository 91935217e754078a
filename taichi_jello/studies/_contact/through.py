"""Whether two jellos go through each other, by the shapes of their surfaces alone (NumPy only, float64)."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from taichi_jello.physics.forces.soft_contact.surface.crossings import Surfaces, goes_through
from taichi_jello.scene.body import Body

HALVINGS = 30  # of a step in which something goes through
Array = np.ndarray[Any, Any]
TETRAHEDRA = np.array([[0, 1, 2, 4], [1, 2, 3, 7], [1, 2, 4, 7], [1, 4, 5, 7], [2, 4, 6, 7]])  # of a cell's corners
OVERLAP = 0.1  # of the cells of either: what slides along the other one has no more of their middles in it


class Sheets:
    """went: whether edges of one went through the other as their middles came level."""

    def __init__(self, body: Body):
        self.surfaces, self.went = Surfaces.of(body), False

    def cut(self, x: Array) -> int:
        """How many edges of either go an odd number of times through a sheet of the other one."""
        surfaces, count = self.surfaces, 0
        place = surfaces.places(x)
        for j in np.flatnonzero(~surfaces.solid):
            ends, corners = surfaces.edges[surfaces.edge_owner != j], surfaces.triangles[surfaces.owner == j]
            through = goes_through(place[ends][:, None], place[corners])
            count += int(np.count_nonzero(through.sum(1) % 2))
        return count

    def look(self, x: Array, level: bool) -> None:
        if level:
            self.went = self.cut(x) > 0


class Lines:
    """went: whether the segments of one rope, or of the line through the middles of one row of cells, have gone through
    those of the other one to one side more often than back."""

    def __init__(self, lines: Callable[[Array], list[Array]]):
        """lines: the segments (S, 2, 3) of both for the particles at x (N, 3)."""
        self.lines, self.net = lines, 0
        self.before: list[Array] | None = None

    @property
    def went(self) -> bool:
        return self.net != 0

    def look(self, x: Array, level: bool) -> None:
        after = self.lines(x)
        if self.before is not None:
            self.net += crossed(self.before, after)
        self.before = after


class Solids:
    """went: whether more than OVERLAP of one, of the middles of its cells or the points of a rope, was in the cells of
    the other one as both came level."""

    def __init__(self, body: Body, cells: list[Array]):
        """cells (C, 8): of each, none of a rope."""
        self.body, self.cells, self.went = body, cells, False

    def look(self, x: Array, level: bool) -> None:
        if level:
            parts = [x[own].mean(1) if len(own) else x[self.body.jello == j] for j, own in enumerate(self.cells)]
            shares = [share_inside(parts[1 - j], x[own]) for j, own in enumerate(self.cells) if len(own)]
            self.went = max(shares) > OVERLAP


def watched(body: Body) -> Sheets | Lines | Solids:
    """What tells whether two jellos go through each other: its `look` is called with the particles (N, 3) after each
    step, and with whether their middles have come level in it."""
    springs, owner = body.springs[body.family == 0], body.jello[body.cells[:, 0]]
    cells = [body.cells[owner == j] for j in (0, 1)]
    faced = np.isin((0, 1), body.jello[body.surface[:, 0]])
    if any(has_faces and not len(own) for has_faces, own in zip(faced, cells, strict=True)):
        return Sheets(body)
    ropes = [springs[body.jello[springs[:, 0]] == j] for j in (0, 1)]
    rows = [all(len(np.intersect1d(a, b)) == 4 for a, b in pairwise(own)) for own in cells]
    if all(rows):
        pairs = list(zip(ropes, cells, strict=True))
        return Lines(lambda x: [joined(x[own].mean(1)) if len(own) else x[rope] for rope, own in pairs])
    return Solids(body, cells)


def joined(middle: Array) -> Array:
    """The segments (C - 1, 2, 3) that join the places (C, 3) one after the other."""
    return np.stack([middle[:-1], middle[1:]], 1)


def share_inside(points: Array, cells: Array) -> float:
    """How much of the points (P, 3) is within the cells with corners (C, 8, 3), each of five tetrahedra."""
    a, b, c, d = np.moveaxis(cells[:, TETRAHEDRA].reshape(-1, 4, 3), 1, 0)
    sides = np.stack([b - a, c - a, d - a], 2)
    whole = np.abs(np.linalg.det(sides)) > 1e-12 * np.ptp(points) ** 3
    part = np.einsum("tij,ptj->pti", np.linalg.inv(sides[whole]), points[:, None] - a[whole])
    return float(np.mean(np.any((part.min(2) >= 0.0) & (part.sum(2) <= 1.0), axis=1)))


def crossed(before: list[Array], after: list[Array]) -> int:
    """How many more of the segments (A, 2, 3) and (B, 2, 3) go through each other to one side than to the other one, on
    straight ways from `before` to `after`: they meet within both where the volume between them is 0."""
    pairs = np.indices((len(after[0]), len(after[1]))).reshape(2, -1)
    start, end = ([line[own] for line, own in zip(lines, pairs, strict=True)] for lines in (before, after))
    above, last = (segments_cross(*lines)[0] >= 0.0 for lines in (start, end))
    some = above != last
    start, way = [line[some] for line in start], [(b - a)[some] for a, b in zip(start, end, strict=True)]
    low, high = np.zeros(len(start[0])), np.ones(len(start[0]))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        volume, within = segments_cross(*(a + middle[:, None, None] * b for a, b in zip(start, way, strict=True)))
        early = (volume >= 0.0) == above[some]
        low, high = np.where(early, middle, low), np.where(early, high, middle)
    return int(np.sum(np.where(last[some], 1, -1) * within))


def segments_cross(one: Array, other: Array) -> tuple[Array, Array]:
    """(K,) six times the volume between each of the segments (K, 2, 3) and its other one, whose sign changes as one
    line goes through the other, or as they turn by where they are parallel; and whether the lines are nearest to each
    other within both segments."""
    p, q = one[:, 0], other[:, 0]
    d, e, r = one[:, 1] - p, other[:, 1] - q, p - q
    dd, ee, de = ((u * w).sum(-1) for u, w in ((d, d), (e, e), (d, e)))
    dr, er = (d * r).sum(-1), (e * r).sum(-1)
    size = np.maximum(dd * ee - de * de, 1e-30)
    s, t = (de * er - dr * ee) / size, (dd * er - de * dr) / size
    return -np.einsum("kd,kd->k", np.cross(d, e), r), (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
