"""The cells of a grid that a surface passes through or encloses, in Taichi kernels."""

from math import prod

import numpy as np
import taichi as ti

from taichi_jello.support import runtime

Points = ti.types.ndarray(dtype=ti.f32, ndim=2)
Triangles = ti.types.ndarray(dtype=ti.i32, ndim=2)
Row = ti.types.ndarray(dtype=ti.i32, ndim=1)
Grid = ti.types.ndarray(dtype=ti.i32, ndim=3)

# Offset of the samples from the middles of cells' eighths, in cells: keeps rays off the edges of aligned meshes.
ASIDE = np.array([0.00137, 0.00171, 0.00113])
SLACK = 1e-3  # of a cell, by which cells are widened: a surface along a face meets both of its cells

vec3 = ti.types.vector(3, ti.f32)


@ti.func
def corner(points: ti.template(), triangles: ti.template(), t, k: ti.template()):
    i = triangles[t, k]
    return vec3(points[i, 0], points[i, 1], points[i, 2])


@ti.func
def side(ax, ay, bx, by, px, py):
    """Twice the signed area of a, b, p; exactly the negative of that of b, a, p."""
    swap = (ax > bx) | ((ax == bx) & (ay > by))  # select, since branches would be unpredictable
    lx, ly = ti.select(swap, bx, ax), ti.select(swap, by, ay)
    hx, hy = ti.select(swap, ax, bx), ti.select(swap, ay, by)
    area = (hx - lx) * (py - ly) - (hy - ly) * (px - lx)
    return ti.select(swap, -area, area)


@ti.kernel
def cross(points: Points, triangles: Triangles, nx: ti.i32, ny: ti.i32, nz: ti.i32, both: ti.i32, crossings: Row):
    """Where rays along the axes through nx by ny by nz samples leave (+1) or enter (-1) the surface, or the reverse.
    For each axis `crossings` has a table (k, i, j), i and j along the other two axes, of the crossings between the
    samples k - 1 and k. `points` in samples; both: count 1 either way."""
    samples = ti.Vector([nx, ny, nz])
    ti.loop_config(block_dim=2048)
    for t in range(triangles.shape[0]):
        p, q, r = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        start = 0
        for along in range(3):
            u, v = ti.select(along == 0, 1, 0), ti.select(along == 2, 1, 2)
            ax, ay, bx, by, cx, cy = points[p, u], points[p, v], points[q, u], points[q, v], points[r, u], points[r, v]
            left, right = ti.ceil(ti.min(ax, bx, cx), int), ti.floor(ti.max(ax, bx, cx), int)
            low, high = ti.ceil(ti.min(ay, by, cy), int), ti.floor(ti.max(ay, by, cy), int)
            for i in range(ti.max(left, 0), ti.min(right + 1, samples[u])):
                for j in range(ti.max(low, 0), ti.min(high + 1, samples[v])):
                    x, y = ti.cast(i, ti.f32), ti.cast(j, ti.f32)
                    a, b, c = side(bx, by, cx, cy, x, y), side(cx, cy, ax, ay, x, y), side(ax, ay, bx, by, x, y)
                    up, down = ti.min(a, b, c) > 0.0, ti.max(a, b, c) < 0.0
                    if up | down:
                        z = (a * points[p, along] + b * points[q, along] + c * points[r, along]) / (a + b + c)
                        k = ti.math.clamp(ti.ceil(z, int), 0, samples[along])
                        place = start + (k * samples[u] + i) * samples[v] + j
                        ti.atomic_add(crossings[place], ti.select(up or both == 1, 1, -1))
            start += (samples[along] + 1) * samples[u] * samples[v]


@ti.func
def parted(p, q, r):
    """Whether one of the axes edge × e_i separates the triangle from the cell around 0: along it p lies at
    (p × edge)_i, and the cell's half-width is |edge × e_i|₁ / 2."""
    edge = q - p
    at, across = p.cross(edge), r.cross(edge)
    reach = (0.5 + SLACK) * (ti.abs(edge).sum() - ti.abs(edge))
    beyond = ti.max(ti.min(at, across), -ti.max(at, across)) - reach
    return beyond.max() > 0.0


@ti.kernel
def mark(points: Points, triangles: Triangles, cells: Grid):
    """Set 1 in the cells that a triangle meets, by separating axes (Akenine-Möller 2001); points in cells."""
    ti.loop_config(block_dim=2048)
    for t in range(triangles.shape[0]):
        a = corner(points, triangles, t, 0)
        b, c = corner(points, triangles, t, 1), corner(points, triangles, t, 2)
        first, last = ti.floor(ti.min(a, b, c) - SLACK, int), ti.floor(ti.max(a, b, c) + SLACK, int)
        both_ends = (last - first).sum() < 2  # in two adjacent cells, with a corner in each
        normal = (b - a).cross(c - a)
        for i in range(ti.max(first[0], 0), ti.min(last[0] + 1, cells.shape[0])):
            for j in range(ti.max(first[1], 0), ti.min(last[1] + 1, cells.shape[1])):
                for k in range(ti.max(first[2], 0), ti.min(last[2] + 1, cells.shape[2])):
                    if cells[i, j, k] == 0:  # written once, to avoid contention between threads
                        middle = vec3(i, j, k) + 0.5
                        p, q, r = a - middle, b - middle, c - middle
                        apart = ti.abs(normal.dot(p)) > (0.5 + SLACK) * ti.abs(normal).sum()
                        if both_ends or not (apart or parted(p, q, r) or parted(q, r, p) or parted(r, p, q)):
                            cells[i, j, k] = 1


def passed_through(points: np.ndarray, triangles: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """(n, m, l) bool: which cells of a grid the surface meets; points (V, 3) in cells."""
    runtime.current()
    cells = np.zeros(shape, np.int32)
    mark(points.astype(np.float32), triangles.astype(np.int32), cells)
    return cells > 0


def votes_along(crossings: np.ndarray, both: bool) -> np.ndarray:
    """+1 for samples inside, -1 for those outside, 0 along a ray that found a hole: it enters and does not leave. From
    a table (k + 1, i, j) of `cross`."""
    here, votes = np.zeros(crossings.shape[1:], np.int32), np.empty(crossings.shape, np.int8)
    for passed, inside in zip(crossings, votes, strict=True):
        here += passed
        np.not_equal(here & 1 if both else here, 0, out=inside, casting="unsafe")
    votes *= 2
    votes -= 1
    votes[:, votes[-1] > 0] = 0
    return votes[:-1]


def enclosed(points: np.ndarray, triangles: np.ndarray, shape: tuple[int, ...], signed: bool) -> np.ndarray:
    """(2n, 2m, 2l) bool: whether the middles of the eighths of a grid's cells are inside the surface.

    Rays along each axis count their crossings, with a sign if `signed`; that needs triangles of one orientation and
    allows overlapping parts. The majority of the rays decides, so one that passes through a hole does no harm.
    points (V, 3) in cells.
    """
    runtime.current()
    samples = tuple(2 * n for n in shape)
    places, faces = (2.0 * (points - ASIDE) - 0.5).astype(np.float32), triangles.astype(np.int32)
    axes = [(axis, *(k for k in range(3) if k != axis)) for axis in range(3)]
    tables = [(samples[axis] + 1, samples[u], samples[v]) for axis, u, v in axes]
    crossings = np.zeros(sum(map(prod, tables)), np.int32)
    cross(places, faces, *samples, int(not signed), crossings)
    total, parts = np.zeros(samples, np.int8), np.split(crossings, np.cumsum([prod(table) for table in tables]))
    for order, table, part in zip(axes, tables, parts, strict=False):
        total += votes_along(part.reshape(table), not signed).transpose(np.argsort(order))
    return total > 0


def voxelised(
    points: np.ndarray, triangles: np.ndarray, shape: tuple[int, ...], signed: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The cells (n, m, l) bool of a grid that the surface meets or encloses, the fraction of each that is inside, and
    the fraction inside around each corner (n+1, m+1, l+1); points (V, 3) in cells; signed: see `enclosed`."""
    inside = enclosed(points, triangles, shape, signed)
    fraction, within = (
        sum(eighths[a::2, b::2, c::2] for a, b, c in np.ndindex(2, 2, 2)) / np.float32(8.0)
        for eighths in (inside.view(np.int8), np.pad(inside, 1).view(np.int8))
    )
    return passed_through(points, triangles, shape) | (fraction > 0.5), fraction, within
