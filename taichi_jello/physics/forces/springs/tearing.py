"""The cells and surfaces that remain of a body when some of its springs are torn (NumPy only)."""

from dataclasses import replace

import numpy as np

from taichi_jello.scene.body import Body

EDGES = np.array([(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit])  # of a cell's corners
# The faces of a cell, counter-clockwise from outside.
FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
BROKEN = 2  # torn edges that split a cell


def _torn(body: Body, whole: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(…) whether the structural spring between each of the pairs (…, 2) is torn."""
    lost = body.springs[~whole & (body.family == 0)].astype(np.int64)
    low, high = np.sort(pairs, axis=-1).astype(np.int64)[..., 0], pairs.max(-1)
    return np.isin(low * len(body) + high, lost[:, 0] * len(body) + lost[:, 1])


def still_there(body: Body, whole: np.ndarray, cells: np.ndarray, thin: np.ndarray) -> np.ndarray:
    """(C + E,) bool: which of the cells (C, 8), and of the triangles and segments `thin` (E, 3), a segment's second
    particle repeated, are left if only the springs `whole` (S,) hold."""
    hold = _torn(body, whole, cells[:, EDGES]).sum(1) < BROKEN
    return np.concatenate([hold, ~_torn(body, whole, thin[:, [[0, 1], [1, 2], [2, 0]]]).any(1)])


def parted(body: Body, whole: np.ndarray) -> Body:
    """The body with what is left of its surfaces if only the springs `whole` (S,) hold.

    A solid loses the cells with at least two torn edges and shows the faces of those left; an embedded skin loses the
    triangles in such cells, a sheet the triangles with a torn edge."""
    torn = np.unique(body.jello[body.springs[~whole, 0]])
    solid = np.unique(body.jello[body.cells[:, 0]])
    there = still_there(body, whole, body.cells, body.surface)
    kept, owner = body.cells[there[: len(body.cells)]], body.jello[body.surface[:, 0]]
    stays = ~np.isin(owner, np.intersect1d(torn, solid)) & there[len(body.cells) :]
    bare = kept[np.isin(body.jello[kept[:, 0]], torn)]
    inside = np.isin(body.skin_corners[:, 0], kept[:, 0])  # a cell is the only one with its first corner
    return replace(
        body,
        cells=kept,
        surface=np.concatenate([body.surface[stays], _open_faces(bare)]),
        skin=body.skin[inside[body.skin].all(1)],
    )


def _open_faces(cells: np.ndarray) -> np.ndarray:
    """(T, 3) triangles of the faces of cells (C, 8) that no other cell shares."""
    faces = cells[:, FACES].reshape(-1, 4)
    _, which, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    single = faces[count[which.ravel()] == 1]
    return single[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3).astype(np.int32)
