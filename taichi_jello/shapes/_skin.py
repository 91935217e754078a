"""A fine skin embedded in the filled cells of a lattice (NumPy only)."""

from dataclasses import replace

import numpy as np

from taichi_jello.scene.body import CORNERS, Body
from taichi_jello.scene.description import Jello
from taichi_jello.shapes.lattice import body_of, corners, hexahedra

MIN_SHARE = 0.5  # of a whole cell's mass at each particle: a lighter one would dictate the step
MAX_EDGE = 0.6  # of a cell: longest edge of a skin that still bends with its cells


def skinned_body(
    jello: Jello,
    points: np.ndarray,
    triangles: np.ndarray,
    filled: np.ndarray,
    fraction: np.ndarray,
    spacing: float,
    inside: np.ndarray,
) -> Body:
    """The Body of a jello with a skin, `triangles` (T, 3) over `points` (V, 3) [m], embedded in the cells `filled`
    (n, m, l), `spacing` [m] wide.

    The points are relative to the middle of the grid; fraction (n, m, l) of each cell is inside the skin; inside
    (n+1, m+1, l+1) bool: whether each grid point is.
    """
    index = corners(filled)
    body = body_of(jello, index, np.full(3, spacing), filled, mass_shares(index, filled * fraction))
    cells, weights = embed(points / spacing + 0.5 * np.array(filled.shape), filled)
    held = index[tuple((cells[:, None] + CORNERS).transpose(2, 0, 1))]
    return replace(
        body,
        skin_corners=held.astype(np.int32),
        skin_weights=weights,
        skin=triangles.astype(np.int32),
        inside=inside[index >= 0],
    )


def mass_shares(index: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    """(N,) shares of the mass: each cell gives an eighth of its filled fraction to each corner; see MIN_SHARE."""
    volume = np.zeros(index.shape)
    for corner in CORNERS:
        place = tuple(slice(a, a + n) for a, n in zip(corner, fraction.shape, strict=True))
        volume[place] += fraction / 8.0
    volume = np.maximum(volume[index >= 0], MIN_SHARE)
    return volume / volume.sum()


def embed(places: np.ndarray, filled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The filled cell (V, 3) around each place (V, 3), in units of cells, and the trilinear weights (V, 8) of its
    corners. A place that rounding puts into an empty cell, or outside, moves to the nearest filled one."""
    cell = np.clip(np.floor(places).astype(int), 0, np.array(filled.shape) - 1)
    astray = np.flatnonzero(~filled[tuple(cell.T)])
    if len(astray):
        full = np.stack(np.nonzero(filled), 1)
        for some in np.array_split(astray, -(-len(astray) * len(full) // 10_000_000)):
            away = np.maximum(np.abs(places[some, None] - (full + 0.5)) - 0.5, 0.0)
            cell[some] = full[np.argmin((away**2).sum(2), 1)]
    return cell, trilinear(np.clip(places - cell, 0.0, 1.0))


def trilinear(place: np.ndarray) -> np.ndarray:
    """(V, 8) the weights of a cell's corners at places (V, 3) in it, 0 to 1 along each side."""
    sides = np.stack([1.0 - place, place])
    return np.stack([sides[a, :, 0] * sides[b, :, 1] * sides[c, :, 2] for a, b, c in CORNERS], 1)


def parts(filled: np.ndarray) -> list[int]:
    """The numbers of cells of the connected components (by shared corners), the largest first."""
    cells = hexahedra(corners(filled), filled)
    label = np.arange(cells.max() + 1)
    while True:
        least = label[cells].min(1)
        before = label.copy()
        np.minimum.at(label, cells, least[:, None])
        label = label[label]  # a label is a particle of the same part, whose own label may be lower by now
        if np.array_equal(before, label):
            return sorted(np.unique(label[cells[:, 0]], return_counts=True)[1].tolist(), reverse=True)


def split_edges(points: np.ndarray, triangles: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with every edge longer than `longest` [m] halved until none is left. Both triangles at an edge share the
    new point, so no gap opens when points move."""
    while True:
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        key, which = np.unique(edges[:, 0].astype(np.int64) * len(points) + edges[:, 1], return_inverse=True)
        ends = np.stack(np.divmod(key, len(points)), 1)
        long = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1) > longest
        if not long.any():
            return points, triangles
        middle = np.where(long, len(points) + np.cumsum(long) - 1, -1)[which].reshape(-1, 3)
        points = np.concatenate([points, points[ends[long]].mean(1)])
        triangles = np.concatenate(_cut(triangles, middle))


def _cut(triangles: np.ndarray, middle: np.ndarray) -> list[np.ndarray]:
    """Each triangle in one to four, by the midpoints of its edges 01, 12, 20; -1 where there is none."""
    count = (middle >= 0).sum(1)
    done = [triangles[count == 0]]
    for turn in range(3):  # the cut edge, or the uncut one, comes first
        (a, b, c), (ab, bc, ca) = np.roll(triangles, -turn, 1).T, np.roll(middle, -turn, 1).T
        one = (count == 1) & (ab >= 0)
        done += [np.stack([a, ab, c], 1)[one], np.stack([ab, b, c], 1)[one]]
        two = (count == 2) & (ab < 0)
        done += [np.stack([ca, bc, c], 1)[two], np.stack([a, b, bc], 1)[two], np.stack([a, bc, ca], 1)[two]]
    (a, b, c), (ab, bc, ca) = triangles[count == 3].T, middle[count == 3].T
    return done + [np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
