"""Makes rabbit.ply and teapot.ply in this folder: `python demos/meshes/make.py [FOLDER]`. NumPy only.

The teapot is Martin Newell's of 1975, from its published Bézier patches. Additional patches close it between lid and
rim and at the ends of handle and spout. The rabbit is an implicit surface.
"""

import sys
from pathlib import Path

import numpy as np

# ---- the teapot: z up, about 6.4 long and 3.15 high

# Surfaces of revolution: a quarter of a circle, and the profiles, radius and height of the control points. A patch has
# four points along the profile and shares its last one with the next patch.
QUARTER = np.array([[1.0, 0.0], [1.0, -0.56], [0.56, -1.0], [0.0, -1.0]])
PROFILE = {
    "lid": [(0, 3.15), (0.8, 3.15), (0, 2.85), (0.2, 2.7), (0.4, 2.55), (1.3, 2.55), (1.3, 2.4)],
    "gap": [(1.3, 2.4), (1.3333, 2.4), (1.3667, 2.4), (1.4, 2.4)],
    "rim": [(1.4, 2.4), (1.3375, 2.53125), (1.4375, 2.53125), (1.5, 2.4)],
    "body": [(1.5, 2.4), (1.75, 1.875), (2, 1.35), (2, 0.9), (2, 0.45), (1.5, 0.225), (1.5, 0.15)],
    "bottom": [(1.5, 0.15), (1.5, 0.075), (1.425, 0), (0, 0)],
}
# Tubes: a row for each cross section, (x, z) of its two ends, and the y of the two control points between them.
Section = tuple[tuple[float, float], tuple[float, float], float]
HANDLE: list[Section] = [
    ((-1.6, 2.025), (-1.5, 2.25), 0.3),
    ((-2.3, 2.025), (-2.5, 2.25), 0.3),
    ((-2.7, 2.025), (-3.0, 2.25), 0.3),
    ((-2.7, 1.8), (-3.0, 1.8), 0.3),
    ((-2.7, 1.575), (-3.0, 1.35), 0.3),
    ((-2.5, 1.125), (-2.65, 0.9375), 0.3),
    ((-2.0, 0.9), (-1.9, 0.6), 0.3),
]
SPOUT: list[Section] = [
    ((1.7, 1.425), (1.7, 0.6), 0.66),
    ((2.6, 1.425), (3.1, 0.825), 0.66),
    ((2.3, 2.1), (2.4, 2.025), 0.25),
    ((2.7, 2.4), (3.3, 2.4), 0.25),
    ((2.8, 2.475), (3.525, 2.49375), 0.25),
    ((2.9, 2.475), (3.45, 2.5125), 0.15),
    ((2.8, 2.4), (3.2, 2.4), 0.15),
]


def revolved_patches() -> list[np.ndarray]:
    """(4, 4, 3) control points: along the profile, around the axis."""
    patches = []
    for profile in PROFILE.values():
        for start in range(0, len(profile) - 1, 3):
            radius, height = np.array(profile[start : start + 4]).T
            x, y = radius[:, None] * QUARTER[:, 0], radius[:, None] * QUARTER[:, 1]
            quarter = np.stack([x, y, np.repeat(height[:, None], 4, 1)], -1)
            patches += [quarter, mirrored(quarter, 0), mirrored(quarter, 1), mirrored(mirrored(quarter, 0), 1)]
    return patches


def mirrored(patch: np.ndarray, axis: int) -> np.ndarray:
    """The mirror image in x = 0 or y = 0, with its columns reversed to keep the orientation."""
    return patch[:, ::-1] * np.where(np.arange(3) == axis, -1, 1)


def tube_patches(sections: list[Section]) -> list[np.ndarray]:
    """Both halves of a tube and a cap at each end."""
    half = np.array([[(a[0], 0, a[1]), (a[0], -s, a[1]), (b[0], -s, b[1]), (b[0], 0, b[1])] for a, b, s in sections])
    middle = 0.5 * (half[:, :1] + half[:, 3:])
    share = np.linspace(0.0, 1.0, 4)[:, None, None]
    first, last = middle[0] + share * (half[0] - middle[0]), half[-1] + share * (middle[-1] - half[-1])
    patches = [first, half[0:4], half[3:7], last]
    return patches + [mirrored(patch, 1) for patch in patches]


def teapot(cuts: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (V, 3), y up, and triangles (T, 3); each patch has `cuts` squares along its sides."""
    t = np.linspace(0.0, 1.0, cuts + 1)
    bernstein = np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], 1)
    patches = np.array(revolved_patches() + tube_patches(HANDLE) + tube_patches(SPOUT))
    points = np.einsum("ua,vb,pabk->puvk", bernstein, bernstein, patches)
    index = np.arange(len(patches) * (cuts + 1) ** 2).reshape(-1, cuts + 1, cuts + 1)
    a, b, c, d = index[:, :-1, :-1], index[:, 1:, :-1], index[:, 1:, 1:], index[:, :-1, 1:]
    triangles = np.concatenate([np.stack([a, c, b], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    return welded(points.reshape(-1, 3)[:, [0, 2, 1]] * (1, 1, -1), triangles)


# ---- the rabbit: y up, its nose towards z, 1.4 high


Point = tuple[float, float, float]


def ellipsoid(p: np.ndarray, centre: Point, radii: Point, tilt: float = 0.0) -> np.ndarray:
    """The approximate signed distance from an ellipsoid that is rotated by `tilt` [degrees] about z."""
    c, s = np.cos(np.radians(tilt)), np.sin(np.radians(tilt))
    q = (p - centre) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    far, steep = np.linalg.norm(q / radii, axis=-1), np.linalg.norm(q / np.square(radii), axis=-1)
    return far * (far - 1.0) / np.maximum(steep, 1e-9)


def blend(a: np.ndarray, b: np.ndarray, width: float) -> np.ndarray:
    """A smooth minimum of two distances, for differences up to `width`."""
    h = np.maximum(width - np.abs(a - b), 0.0) / width
    return np.minimum(a, b) - h * h * width / 4.0


def rabbit_distance(p: np.ndarray) -> np.ndarray:
    """The approximate signed distance of p (..., 3) from the rabbit."""
    q = np.abs(p) * (1, 0, 0) + p * (0, 1, 1)  # symmetric in x
    d = ellipsoid(q, (0, 0.33, -0.08), (0.28, 0.35, 0.34))  # belly
    d = blend(d, ellipsoid(q, (0, 0.50, 0.06), (0.20, 0.28, 0.20)), 0.10)  # chest
    d = blend(d, ellipsoid(q, (0.21, 0.20, -0.02), (0.13, 0.20, 0.23)), 0.05)  # haunches
    d = blend(d, ellipsoid(q, (0.20, 0.04, 0.22), (0.095, 0.08, 0.22)), 0.06)  # hind feet
    d = blend(d, ellipsoid(q, (0.095, 0.34, 0.24), (0.065, 0.16, 0.08)), 0.05)  # arms
    d = blend(d, ellipsoid(q, (0.08, 0.23, 0.30), (0.06, 0.06, 0.08)), 0.05)  # paws
    d = blend(d, ellipsoid(q, (0, 0.21, -0.44), (0.11, 0.11, 0.11)), 0.03)  # tail
    head = ellipsoid(q, (0, 0.87, 0.13), (0.205, 0.19, 0.215))
    head = blend(head, ellipsoid(q, (0.065, 0.81, 0.29), (0.10, 0.085, 0.10)), 0.05)  # cheeks
    head = blend(head, ellipsoid(q, (0, 0.875, 0.37), (0.045, 0.034, 0.045)), 0.02)  # nose
    head = blend(head, ellipsoid(q, (0.117, 0.93, 0.262), (0.045, 0.055, 0.045)), 0.015)  # eyes
    d = blend(d, head, 0.06)
    ear = ellipsoid(q, (0.145, 1.21, 0.06), (0.092, 0.29, 0.062), tilt=-13.0)
    hollow = ellipsoid(q, (0.150, 1.22, 0.118), (0.054, 0.22, 0.045), tilt=-13.0)
    ear = -blend(-ear, hollow, 0.03)
    d = blend(d, ear, 0.06)
    return np.maximum(d, -p[..., 1])  # flat feet


def rabbit(spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (V, 3) and triangles (T, 3) of the zero level set on a grid, by surface nets (Gibson 1998): every cell
    that the surface crosses gets a point, every edge that it crosses a quadrilateral of its four cells' points."""
    low, high = np.array([-0.45, -0.06, -0.65]), np.array([0.45, 1.6, 0.55])
    shape = np.ceil((high - low) / spacing).astype(int) + 1
    grid = low + spacing * np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1)
    inside = rabbit_distance(grid) < 0.0
    cells = np.full(shape - 1, -1)
    corners = np.zeros(shape - 1, int)
    for c in np.ndindex(2, 2, 2):
        corners += inside[tuple(slice(a, n - 1 + a) for a, n in zip(c, shape, strict=True))]
    crossed = (corners > 0) & (corners < 8)
    cells[crossed] = np.arange(crossed.sum())
    points = low + spacing * (np.stack(np.nonzero(crossed), 1) + 0.5)
    for _ in range(12):  # towards the surface, along the gradient
        points -= 0.7 * rabbit_distance(points)[:, None] * gradient(points)
    squares = []
    for axis in range(3):
        order = np.roll(np.arange(3), -axis)
        solid, k = inside.transpose(order), cells.transpose(order)
        i, j = solid[:-1, 1:-1, 1:-1], solid[1:, 1:-1, 1:-1]
        four = np.stack([k[:, :-1, :-1], k[:, 1:, :-1], k[:, 1:, 1:], k[:, :-1, 1:]], -1)
        squares += [four[i & ~j], four[~i & j][:, ::-1]]
    four = np.concatenate(squares)
    # Split each quadrilateral along its shorter diagonal.
    ac, bd = (np.linalg.norm(points[four[:, a]] - points[four[:, a + 2]], axis=1) for a in (0, 1))
    turned = np.where((ac < bd)[:, None], four, np.roll(four, -1, 1))
    return welded(points, np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]]))


def gradient(p: np.ndarray, step: float = 1e-4) -> np.ndarray:
    """The normalised gradient of the rabbit's distance."""
    g = np.stack([rabbit_distance(p + h) - rabbit_distance(p - h) for h in step * np.eye(3)], -1)
    return g / np.maximum(np.linalg.norm(g, axis=-1, keepdims=True), 1e-12)


# ---- both


def welded(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merges points at the same place and drops degenerate triangles."""
    _, first, which = np.unique(points.round(6), axis=0, return_index=True, return_inverse=True)
    triangles = which.ravel()[triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    used, triangles = np.unique(triangles, return_inverse=True)
    return points[first[used]], triangles.reshape(-1, 3)


def save(path: Path, points: np.ndarray, triangles: np.ndarray) -> None:
    """Binary PLY."""
    corner = np.zeros(len(triangles), [("count", "u1"), ("index", "<i4", 3)])
    corner["count"], corner["index"] = 3, triangles
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{axes}"
    header += f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_bytes(header.encode() + points.astype("<f4").tobytes() + corner.tobytes())


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    save(folder / "teapot.ply", *teapot(cuts=12))
    save(folder / "rabbit.ply", *rabbit(spacing=0.018))
