"""By which faces a point inside a solid can leave each of its cells (NumPy only)."""

import numpy as np

from taichi_jello.scene.body import Body

FACES = np.array([[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 4, 5], [2, 3, 6, 7], [0, 2, 4, 6], [1, 3, 5, 7]])  # of a cell


def ways_out(rest: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The six straight ways out of each of the (C, 8) cells, along its own axes: faces (F, 4), the open ones, corner
    2a + b at a, b steps along their axes; owner (F,), their cells; exits (C, 6), the face in which the way down and up
    the x, y and z axis ends; way (C, 6) [m], how long it is in the undeformed body, infinite if it has no end."""
    beside = _beside(cells)
    corners, is_open = cells[:, FACES], beside < 0
    middle = rest[cells].mean(1)
    exits = np.where(is_open, np.cumsum(is_open).reshape(-1, 6) - 1, -1)
    way = np.where(is_open, np.linalg.norm(rest[corners].mean(2) - middle[:, None], axis=2), np.inf)
    side, step = np.indices(exits.shape)[1], np.linalg.norm(middle[beside] - middle[:, None], axis=2)
    while True:
        found = (exits < 0) & (exits[beside, side] >= 0)
        if not found.any():
            break
        way = np.where(found, way[beside, side] + step, way)
        exits = np.where(found, exits[beside, side], exits)
    owner = np.repeat(np.arange(len(cells)), 6).reshape(-1, 6)[is_open]
    return corners[is_open], owner, np.maximum(exits, 0), way


def skin_exits(body: Body, owner: np.ndarray, exits: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, ...]:
    """For each cell the groups (C, 6) of skin triangles by which it is left and the way (C, 6) to them; and these
    groups: where each starts, and their triangles. The skin is left by its triangles in a cell and in those beside it;
    a cell that it does not pass through, as the cells are in which its straight ways out end; see ways_out."""
    cell_of = np.full(len(body), -1)
    cell_of[body.cells[:, 0]] = np.arange(len(body.cells))  # a cell is the only one with its first corner
    held = cell_of[body.skin_corners[:, 0]]
    members: list[set[int]] = [set() for _ in body.cells]
    for triangle, corners in enumerate(held[body.skin].tolist()):
        for cell in corners:
            members[cell].add(triangle)
    beside = [[b for b in row if b >= 0] for row in _beside(body.cells).tolist()]
    near = [members[c].union(*(members[b] for b in around)) for c, around in enumerate(beside)]
    crossed = body.embedded[body.cells[:, 0]] & ~body.inside[body.cells].all(1)
    crossed[held] = True
    passed = np.flatnonzero(crossed)
    groups = [sorted(near[c] or set().union(*(near[b] for b in beside[c]))) for c in passed]
    group_of = np.full(len(body.cells), -1)
    group_of[passed] = np.arange(len(passed))
    which = group_of[owner[exits]]
    length = np.where(which >= 0, way, np.inf)
    which[passed], length[passed] = group_of[passed, None], np.inf
    length[passed, 0] = 0.0
    start = np.cumsum([0] + [len(group) for group in groups])
    return which, length, start, np.array([triangle for group in groups for triangle in group])


def _beside(cells: np.ndarray) -> np.ndarray:
    """(C, 6): the cell across each of FACES, -1 where there is none."""
    _, which, count = np.unique(
        np.sort(cells[:, FACES].reshape(-1, 4), 1), axis=0, return_inverse=True, return_counts=True
    )
    order = np.argsort(which.ravel(), kind="stable")
    pair = order[count[which.ravel()[order]] == 2].reshape(-1, 2)
    across = np.full(6 * len(cells), -1)
    across[pair] = pair[:, ::-1] // 6
    return across.reshape(-1, 6)


def inner_neighbours(rest: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(N,) for each particle the one opposite to it in the cells around it, the way into the body; itself if there is
    none: the line between the two tells where out is, however the body is turned and bent."""
    around, total = np.zeros(len(rest)), np.zeros_like(rest)
    np.add.at(around, cells, 1.0)
    np.add.at(total, cells, rest[cells].mean(1)[:, None])
    inside = 2.0 * total / np.maximum(around, 1.0)[:, None] - rest
    of, other = np.repeat(cells, 8, axis=1).ravel(), np.tile(cells, 8).ravel()
    distance = np.linalg.norm(rest[other] - inside[of], axis=1)
    order = np.lexsort([other, np.round(distance, 9), of])
    first = order[np.unique(of[order], return_index=True)[1]]
    inner = np.arange(len(rest))
    inner[of[first]] = other[first]
    return inner.astype(np.int32)
