"""Points between the particles of a solid's surface, where these are farther apart than it is thick (NumPy only).

Of two bars that cross, the particles of either may all be beside the other one: without points between them nothing of
one would ever be in the other.
"""

import numpy as np

MOST = 8  # parts of an edge
EDGES = np.array([[0, 1], [0, 2], [1, 3], [2, 3]])  # of a face, by its corners in the order of touching.FACES


def samples(rest: np.ndarray, faces: np.ndarray, longest: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the edges of the open faces (F, 4): the particles (S, 8) that each point is between, their weights (S, 8), and
    how much of a particle of the surface (S,) it stands for. An edge longer than `longest` (F,) [m] is cut into parts
    that are not, but no more than MOST."""
    ends, first = np.unique(np.sort(faces[:, EDGES].reshape(-1, 2), 1), axis=0, return_index=True)
    length = np.linalg.norm(rest[ends[:, 1]] - rest[ends[:, 0]], axis=1)
    parts = np.minimum(np.ceil(length / np.repeat(longest, len(EDGES))[first] - 1e-6), MOST).astype(int)
    edge = np.repeat(np.arange(len(ends)), np.maximum(parts - 1, 0))
    number = np.arange(len(edge)) - np.searchsorted(edge, edge) + 1  # 1 to parts - 1 along each
    along = number / parts[edge]
    corners = np.repeat(ends[edge], [1, 7], axis=1).astype(np.int32)
    weights = np.zeros((len(edge), 8))
    weights[:, 0], weights[:, 1] = 1.0 - along, along
    return corners, weights, 1.0 / parts[edge]
