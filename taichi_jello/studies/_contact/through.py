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
    """went: whether edges of one jello were through a sheet as the middles of both came level."""

    def __init__(self, body: Body):
        self.surfaces, self.went = Surfaces.of(body), False

    def look(self, x: Array, level: bool) -> None:
        if level:
            self.went, place = False, self.surfaces.places(x)
            for j in np.flatnonzero(~self.surfaces.solid):
                ends = place[self.surfaces.edges[self.surfaces.edge_owner != j]]
                through = goes_through(ends[:, None], place[self.surfaces.triangles[self.surfaces.owner == j]])
                self.went |= bool(np.any(through.sum(1) % 2))


class Lines:
    """went: whether the segments of one line, a rope or the line through the middles of a row of cells, have gone
    through those of the other one to one side more often than back."""

    def __init__(self, lines: Callable[[Array], list[Array]]):
        """lines: the segments (S, 2, 3) of both for the particles at x (N, 3)."""
        self.lines, self.net, self.went = lines, 0, False
        self.before: list[Array] = []

    def look(self, x: Array, level: bool) -> None:
        after = self.lines(x)
        if self.before:
            self.net += crossed(self.before, after)
        self.before, self.went = after, self.net != 0


class Solids:
    """went: whether more than OVERLAP of one jello, of the middles of its cells or the points of a rope, was in the
    cells of the other one as both came level."""

    def __init__(self, body: Body, cells: list[Array]):
        """cells (C, 8): of each, none of a rope."""
        self.body, self.cells, self.went = body, cells, False

    def look(self, x: Array, level: bool) -> None:
        if level:
            parts = [x[own].mean(1) if len(own) else x[self.body.jello == j] for j, own in enumerate(self.cells)]
            shares = [share_inside(parts[1 - j], x[own]) for j, own in enumerate(self.cells) if len(own)]
            self.went = max(shares) > OVERLAP


def watched(body: Body) -> Sheets | Lines | Solids:
    """What finds out whether two jellos go through each other: call its `look` after each step with the particles
    (N, 3), and with whether the middles of both have come level in the step."""
    springs, owner = body.springs[body.family == 0], body.jello[body.cells[:, 0]]
    cells = [body.cells[owner == j] for j in (0, 1)]
    faced = np.isin((0, 1), body.jello[body.surface[:, 0]])
    if any(has_faces and not len(own) for has_faces, own in zip(faced, cells, strict=True)):
        return Sheets(body)
    ropes = [springs[body.jello[springs[:, 0]] == j] for j in (0, 1)]
    if not all(len(np.intersect1d(a, b)) == 4 for own in cells for a, b in pairwise(own)):
        return Solids(body, cells)

    def lines(x: Array) -> list[Array]:
        middles = [x[own].mean(1) for own in cells]
        rows = [np.stack([middle[:-1], middle[1:]], 1) for middle in middles]
        return [row if len(own) else x[rope] for row, own, rope in zip(rows, cells, ropes, strict=True)]

    return Lines(lines)


def share_inside(points: Array, cells: Array) -> float:
    """The fraction of the points (P, 3) within the cells with corners (C, 8, 3), each of five tetrahedra."""
    a, b, c, d = np.moveaxis(cells[:, TETRAHEDRA].reshape(-1, 4, 3), 1, 0)
    sides = np.stack([b - a, c - a, d - a], 2)
    whole = np.abs(np.linalg.det(sides)) > 1e-12 * np.ptp(points) ** 3
    part = np.einsum("tij,ptj->pti", np.linalg.inv(sides[whole]), points[:, None] - a[whole])
    return float(np.mean(np.any((part.min(2) >= 0.0) & (part.sum(2) <= 1.0), axis=1)))


def crossed(before: list[Array], after: list[Array]) -> int:
    """How many more pairs of the segments (A, 2, 3) and (B, 2, 3) go through each other to one side than to the other,
    on straight ways from `before` to `after`: where the volume between two is 0, and they meet within both."""
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
    """(K,) six times the volume between two segments (K, 2, 3), whose sign changes as one line goes through the other,
    or as they turn past parallel; and whether the lines are nearest to each other within both segments."""
    p, q = one[:, 0], other[:, 0]
    d, e, r = one[:, 1] - p, other[:, 1] - q, p - q
    dd, ee, de = ((u * w).sum(-1) for u, w in ((d, d), (e, e), (d, e)))
    dr, er = (d * r).sum(-1), (e * r).sum(-1)
    size = np.maximum(dd * ee - de * de, 1e-30)
    s, t = (de * er - dr * ee) / size, (dd * er - de * dr) / size
    return -np.einsum("kd,kd->k", np.cross(d, e), r), (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
