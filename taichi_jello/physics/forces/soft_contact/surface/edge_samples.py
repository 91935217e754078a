"""Points between the particles of surfaces and ropes, where these are farther apart than solids are thick (NumPy only).

Of two bars that cross, the particles of either may all be beside the other one: without points between them nothing of
one would ever be in the other. So of a rope that lies across a bar.
"""

import numpy as np

MAX_PARTS = 8  # of an edge
EDGES = np.array([[0, 1], [0, 2], [1, 3], [2, 3]])  # of a face, by its corners in the order of exits.FACES


def edges(faces: np.ndarray) -> np.ndarray:
    """(E, 2) the edges of the faces (F, 4), each once."""
    found: np.ndarray = np.unique(np.sort(faces[:, EDGES].reshape(-1, 2), 1), axis=0)
    return found


def samples(rest: np.ndarray, ends: np.ndarray, longest: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the edges between particles `ends` (E, 2): the particles (S, 8) that each point is between, their weights
    (S, 8), and how much of a particle (S,) it stands for. An edge longer than `longest` (E,) [m] is cut into parts that
    are not, but no more than MAX_PARTS."""
    length = np.linalg.norm(rest[ends[:, 1]] - rest[ends[:, 0]], axis=1)
    parts = np.minimum(np.ceil(length / longest - 1e-6), MAX_PARTS).astype(int)
    edge = np.repeat(np.arange(len(ends)), np.maximum(parts - 1, 0))
    number = np.arange(len(edge)) - np.searchsorted(edge, edge) + 1  # 1 to parts - 1 along each
    along = number / parts[edge]
    corners = np.repeat(ends[edge], [1, 7], axis=1).astype(np.int32)
    weights = np.zeros((len(edge), 8))
    weights[:, 0], weights[:, 1] = 1.0 - along, along
    return corners, weights, 1.0 / parts[edge]
