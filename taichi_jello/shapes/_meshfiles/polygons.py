"""Triangles from the polygons of a mesh file."""

import numpy as np

MAX_TRIANGLES = 2_000_000  # of a mesh
MAX_CONCAVE_CORNERS = 2000  # of one polygon: ear clipping takes the square of their number
MIN_SINE = 1e-12  # sines of angles below this count as zero


class MeshProblem(ValueError):
    """A mesh file that cannot be used: where, and what was expected."""


def triangulated(points: np.ndarray, corners: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """(T, 3) triangles of polygons, in their order. points (V, 3); corners: the vertices of all polygons, one polygon
    after another; counts: how many each has, at least 3. Convex polygons become fans, the others are cut by ear
    clipping (Meisters 1975)."""
    starts = np.cumsum(counts) - counts
    at = np.concatenate([[0], np.cumsum(counts - 2)])  # of each polygon's first triangle
    found = np.empty((at[-1], 3), np.int64)
    for count in np.unique(counts):
        rows = np.flatnonzero(counts == count)
        polygons = corners[starts[rows, None] + np.arange(count)]
        fan = np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], axis=1)
        triangles = polygons[:, fan]
        if count > 3:
            a, b, c = (points[triangles[..., k]] for k in range(3))
            normals = np.cross(b - a, c - a)
            for row in np.flatnonzero((np.einsum("pti,pi->pt", normals, normals.sum(1)) < 0.0).any(1)):
                triangles[row] = polygons[row][_ears(points[polygons[row]])]
        found[at[rows, None] + np.arange(count - 2)] = triangles
    return found


def _ears(corners: np.ndarray) -> np.ndarray:
    """(N - 2, 3) indices of the triangles of a simple polygon with corners (N, 3)."""
    if len(corners) > MAX_CONCAVE_CORNERS:
        problem = f"expected concave polygons of at most {MAX_CONCAVE_CORNERS} corners, got {len(corners)}"
        raise MeshProblem(f"{problem}; triangulate it")
    x, y = _flattened(corners).T
    left, triangles, k, failed = list(range(len(corners))), [], 0, 0
    while len(left) > 3:
        size = len(left)
        k %= size
        a, b, c = left[k - 1], left[k], left[(k + 1) % size]
        # After a whole turn without an ear, flat corners may go; after two, any: the polygon crosses itself.
        if failed >= 2 * size or _is_ear(x, y, np.array(left), (a, b, c), flat=failed >= size):
            triangles.append((a, b, c))
            del left[k]
            failed, k = 0, k + (size - k > 2)  # not the next corner, which would make a fan of thin triangles
        else:
            failed, k = failed + 1, k + 1
    return np.array([*triangles, left])


def _flattened(corners: np.ndarray) -> np.ndarray:
    """(N, 2) the corners in the plane of the polygon, counterclockwise and scaled to 1."""
    corners = corners - corners.mean(0)
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(0)  # Newell's, twice the area
    axis = np.eye(3)[np.argmin(np.abs(normal))]
    across = np.cross(axis, normal)
    across /= max(float(np.linalg.norm(across)), 1e-300)
    along = np.cross(normal, across)
    along /= max(float(np.linalg.norm(along)), 1e-300)
    return np.stack([corners @ across, corners @ along], axis=1) / max(float(np.abs(corners).max()), 1e-300)


def _is_ear(x: np.ndarray, y: np.ndarray, left: np.ndarray, ear: tuple[int, int, int], flat: bool) -> bool:
    """Whether the triangle bulges outwards, or is flat if that is allowed, and no other corner is in it or on it."""
    a, b, c = ear

    def turn(i: int, j: int, points: np.ndarray) -> np.ndarray:
        """Twice the area of i, j and each point, positive if counterclockwise."""
        area: np.ndarray = (x[j] - x[i]) * (y[points] - y[i]) - (y[j] - y[i]) * (x[points] - x[i])
        return area

    area = float(turn(a, b, np.array([c]))[0])
    if area < -MIN_SINE or (area <= MIN_SINE and not flat):
        return False
    others = left[(left != a) & (left != b) & (left != c)]
    for corner in ear:  # a polygon with a bridge to its hole has corners twice
        others = others[(x[others] != x[corner]) | (y[others] != y[corner])]
    inside = (turn(a, b, others) >= 0.0) & (turn(b, c, others) >= 0.0) & (turn(c, a, others) >= 0.0)
    return not (area > MIN_SINE and inside.any())
