"""What of a scene's bodies can touch: points, elements, and where a point inside a solid leaves it (NumPy only)."""

from dataclasses import dataclass

import numpy as np

from taichi_jello.body import Body

FACES = np.array([[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 4, 5], [2, 3, 6, 7], [0, 2, 4, 6], [1, 3, 5, 7]])
THICKNESS = {"sheet": 0.25, "rope": 0.5}  # the radius of a thin body, in lengths of its structural springs


@dataclass(frozen=True)
class Touching:
    """Q points, each a particle of a surface, and E elements: the cells of solid bodies, then the triangles of thin
    ones, then the segments of ropes.

    points (Q,): particles; nodes (E, 8): particles, the last repeated for triangles and segments; solid: how many
    elements are cells. faces (F, 4): points; exits and way (C, 6): see ways_out; inner (Q,): see inner_neighbours;
    radius (J,) [m] of each jello, zero for solid ones; spacing (J,) [m] between its points.
    """

    points: np.ndarray
    nodes: np.ndarray
    solid: int
    faces: np.ndarray
    exits: np.ndarray
    way: np.ndarray
    inner: np.ndarray
    radius: np.ndarray
    spacing: np.ndarray

    @classmethod
    def of(cls, body: Body) -> "Touching":
        jellos = int(body.jello.max()) + 1
        is_solid, is_sheet = np.zeros(jellos, bool), np.zeros(jellos, bool)
        is_solid[body.jello[body.cells[:, 0]]] = True
        is_sheet[body.jello[body.surface[:, 0]]] = True
        is_sheet &= ~is_solid
        thin = body.surface[is_sheet[body.jello[body.surface[:, 0]]]]
        thin = thin[np.unique(np.sort(thin, 1), axis=0, return_index=True)[1]] if len(thin) else thin  # one side
        structural = body.springs[body.family == 0]
        segments = structural[~(is_solid | is_sheet)[body.jello[structural[:, 0]]]]
        nodes = np.concatenate(
            [
                body.cells,
                np.concatenate([thin, np.repeat(thin[:, 2:], 5, 1)], 1),
                np.concatenate([segments, np.repeat(segments[:, 1:], 6, 1)], 1),
            ]
        )
        faces, leave, way = ways_out(body.rest, body.cells)
        points = np.unique(np.concatenate([faces.ravel(), np.flatnonzero(~is_solid[body.jello])]))
        point_of = np.full(len(body), -1, np.int32)
        point_of[points] = np.arange(len(points))
        spacing = _spacing(body, structural, jellos)
        share = np.select([is_solid, is_sheet], [0.0, THICKNESS["sheet"]], THICKNESS["rope"])
        return cls(
            points=points.astype(np.int32),
            nodes=nodes.astype(np.int32),
            solid=len(body.cells),
            faces=point_of[faces],
            exits=leave,
            way=way,
            inner=inner_neighbours(body.rest, body.cells)[points],
            radius=share * spacing,
            spacing=spacing,
        )


def _spacing(body: Body, structural: np.ndarray, jellos: int) -> np.ndarray:
    """(J,) the mean length of each jello's edges: of its structural springs, else of its cells, else its size."""
    spacing = np.zeros(jellos)
    for j in range(jellos):
        pairs = structural[body.jello[structural[:, 0]] == j]
        if not len(pairs):
            pairs = body.cells[body.jello[body.cells[:, 0]] == j][:, [0, 1]]
        if not len(pairs):
            pairs = body.springs[body.jello[body.springs[:, 0]] == j]
        if len(pairs):
            spacing[j] = np.linalg.norm(body.rest[pairs[:, 0]] - body.rest[pairs[:, 1]], axis=1).mean()
    return np.where(spacing > 0.0, spacing, spacing.max() or 1.0)


def ways_out(rest: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The six straight ways out of each of the (C, 8) cells, along its own axes: faces (F, 4), the open ones, corner
    2a + b at a, b steps along their axes; exits (C, 6), the face in which the way down and up the x, y and z axis
    ends; length (C, 6) [m] of that way through the undeformed body."""
    corners = cells[:, FACES].reshape(-1, 4)
    _, which, count = np.unique(np.sort(corners, 1), axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    is_open = count[which] == 1
    order = np.argsort(which, kind="stable")
    pair = order[~is_open[order]].reshape(-1, 2)
    across = np.full(6 * len(cells), -1)
    across[pair] = pair[:, ::-1] // 6
    beyond_face = across.reshape(-1, 6)
    middle = rest[cells].mean(1)
    exits = np.where(is_open, np.cumsum(is_open) - 1, -1).reshape(-1, 6).astype(np.int32)
    length = np.where(exits >= 0, np.linalg.norm(rest[cells[:, FACES]].mean(2) - middle[:, None], axis=2), np.inf)
    for _ in range(len(cells)):
        closed = exits < 0
        if not closed.any():
            break
        beyond = np.where(closed, beyond_face, 0)
        side = np.broadcast_to(np.arange(6), beyond.shape)
        step = np.linalg.norm(middle[beyond] - middle[:, None], axis=2)
        exits = np.where(closed, exits[beyond, side], exits)
        length = np.where(closed, length[beyond, side] + step, length)
    return corners[is_open], exits, length


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
