"""Where the faces of a surface are, straight up and down."""

import numpy as np


def heights(x, triangles, columns, side):
    """(C,) [m] the least, for side = -1, or greatest, for 1, height of what faces up or down of a surface over each of
    the columns (C, 2); NaN where there is nothing."""
    a, b, c = (x[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    a, b, c = (corner[abs(normal[:, 1]) > 0.7 * np.linalg.norm(normal, axis=1)] for corner in (a, b, c))
    u, w, p = (b - a)[:, [0, 2]], (c - a)[:, [0, 2]], columns[:, None] - a[:, [0, 2]]
    twice = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
    s = (p[..., 0] * w[:, 1] - p[..., 1] * w[:, 0]) / twice
    t = (u[:, 0] * p[..., 1] - u[:, 1] * p[..., 0]) / twice
    y = np.where((s >= 0.0) & (t >= 0.0) & (s + t <= 1.0), a[:, 1] + s * (b - a)[:, 1] + t * (c - a)[:, 1], np.nan)
    found = side * np.where(np.isnan(y), -np.inf, side * y).max(1)
    return np.where(np.isinf(found), np.nan, found)
