"""Which cells of a grid a surface passes through and which it encloses, in Taichi kernels."""

import numpy as np
import taichi as ti

from taichi_jello import runtime

Points = ti.types.ndarray(dtype=ti.f32, ndim=2)
Triangles = ti.types.ndarray(dtype=ti.i32, ndim=2)
Grid = ti.types.ndarray(dtype=ti.i32, ndim=3)
Votes = ti.types.ndarray(dtype=ti.i8, ndim=3)

# Samples are taken this much beside the middles of cells' eighths, in cells: a ray through the very edge between two
# triangles, or along one, is then as rare as for any other mesh.
ASIDE = np.array([0.00137, 0.00171, 0.00113])
SLACK = 1e-3  # of a cell, by which cells are widened: a surface along their sides passes through both


vec3 = ti.types.vector(3, ti.f32)


@ti.func
def corner(points: ti.template(), triangles: ti.template(), t, k: ti.template()):
    i = triangles[t, k]
    return vec3(points[i, 0], points[i, 1], points[i, 2])


@ti.func
def side(ax, ay, bx, by, px, py):
    """Twice the signed area of a, b, p: the same number with the opposite sign, to the bit, for b, a, p."""
    swap = ax > bx or (ax == bx and ay > by)
    if swap:
        ax, ay, bx, by = bx, by, ax, ay
    area = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    return ti.select(swap, -area, area)


@ti.kernel
def cross(points: Points, triangles: Triangles, both: ti.i32, crossings: Grid):
    """Where the rays along z through all columns of samples leave (+1) or enter (-1) the surface: crossings[x, y, k]
    counts those between the samples k - 1 and k. `points` in samples; both: count 1 either way."""
    rows, columns, last = crossings.shape[0], crossings.shape[1], crossings.shape[2] - 1
    ti.loop_config(block_dim=2048)
    for t in range(triangles.shape[0]):
        ax, ay, az = points[triangles[t, 0], 0], points[triangles[t, 0], 1], points[triangles[t, 0], 2]
        bx, by, bz = points[triangles[t, 1], 0], points[triangles[t, 1], 1], points[triangles[t, 1], 2]
        cx, cy, cz = points[triangles[t, 2], 0], points[triangles[t, 2], 1], points[triangles[t, 2], 2]
        left, right = ti.ceil(ti.min(ax, bx, cx), int), ti.floor(ti.max(ax, bx, cx), int)
        low, high = ti.ceil(ti.min(ay, by, cy), int), ti.floor(ti.max(ay, by, cy), int)
        for i in range(ti.max(left, 0), ti.min(right + 1, rows)):
            for j in range(ti.max(low, 0), ti.min(high + 1, columns)):
                x, y = ti.cast(i, ti.f32), ti.cast(j, ti.f32)
                a, b, c = side(bx, by, cx, cy, x, y), side(cx, cy, ax, ay, x, y), side(ax, ay, bx, by, x, y)
                up, down = a > 0.0 and b > 0.0 and c > 0.0, a < 0.0 and b < 0.0 and c < 0.0
                if up or down:
                    z = (a * az + b * bz + c * cz) / (a + b + c)
                    k = ti.math.clamp(ti.ceil(z, int), 0, last)
                    ti.atomic_add(crossings[i, j, k], ti.select(up or both == 1, 1, -1))


@ti.kernel
def vote(crossings: Grid, both: ti.i32, votes: Votes):
    """+1 for samples inside, -1 for those outside; 0 along a ray that does not come out again: it found a hole."""
    ti.loop_config(block_dim=16)
    for i in range(votes.shape[0]):
        for j in range(votes.shape[1]):
            here = 0
            for k in range(votes.shape[2]):
                here += crossings[i, j, k]
                inside = here % 2 != 0 if both == 1 else here != 0
                votes[i, j, k] = ti.cast(ti.select(inside, 1, -1), ti.i8)
            here += crossings[i, j, votes.shape[2]]
            if here % 2 != 0 if both == 1 else here != 0:
                for k in range(votes.shape[2]):
                    votes[i, j, k] = ti.cast(0, ti.i8)


@ti.func
def parted(p, q, r):
    """Whether one of the three axes square to the edge pq and to a side of the cell around 0 parts it from the
    triangle: along edge × e_i the point p lies at (p × edge)_i; the cell reaches as far as half of |edge × e_i|₁."""
    edge = q - p
    at, across = p.cross(edge), r.cross(edge)
    reach = (0.5 + SLACK) * (ti.abs(edge).sum() - ti.abs(edge))
    beyond = ti.max(ti.min(at, across), -ti.max(at, across)) - reach
    return beyond.max() > 0.0


@ti.kernel
def mark(points: Points, triangles: Triangles, cells: Grid):
    """Set 1 in the cells that a triangle meets, by separating axes (Akenine-Möller 2001). `points` in cells."""
    ti.loop_config(block_dim=2048)
    for t in range(triangles.shape[0]):
        a = corner(points, triangles, t, 0)
        b, c = corner(points, triangles, t, 1), corner(points, triangles, t, 2)
        first, last = ti.floor(ti.min(a, b, c) - SLACK, int), ti.floor(ti.max(a, b, c) + SLACK, int)
        normal = (b - a).cross(c - a)
        for i in range(ti.max(first[0], 0), ti.min(last[0] + 1, cells.shape[0])):
            for j in range(ti.max(first[1], 0), ti.min(last[1] + 1, cells.shape[1])):
                for k in range(ti.max(first[2], 0), ti.min(last[2] + 1, cells.shape[2])):
                    if cells[i, j, k] == 0:
                        middle = vec3(i, j, k) + 0.5
                        p, q, r = a - middle, b - middle, c - middle
                        apart = ti.abs(normal.dot(p)) > (0.5 + SLACK) * ti.abs(normal).sum()
                        if not (apart or parted(p, q, r) or parted(q, r, p) or parted(r, p, q)):
                            cells[i, j, k] = 1


def passed_through(points: np.ndarray, triangles: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """(n, m, l) bool: the cells of a grid of this shape that the surface meets; points (V, 3) in cells."""
    runtime.current()
    cells = np.zeros(shape, np.int32)
    mark(points.astype(np.float32), triangles.astype(np.int32), cells)
    return cells > 0


def enclosed(points: np.ndarray, triangles: np.ndarray, shape: tuple[int, ...], signed: bool) -> np.ndarray:
    """(2n, 2m, 2l) bool: whether the middles of the eighths of a grid's cells are inside the surface.

    Rays along each of the three axes count what they cross, one way up and the other way down if `signed`, which needs
    triangles that all face outwards (or all inwards) and allows parts that overlap. The majority of the rays decides,
    so that a hole which one of them finds does no harm. points (V, 3) in cells.
    """
    runtime.current()
    samples = tuple(2 * n for n in shape)
    places, faces = (2.0 * (points - ASIDE) - 0.5).astype(np.float32), triangles.astype(np.int32)
    total = np.zeros(samples, np.int8)
    for axis in range(3):
        order = [(axis + 1) % 3, (axis + 2) % 3, axis]
        columns = tuple(samples[k] for k in order)
        crossings, votes = np.zeros((*columns[:2], columns[2] + 1), np.int32), np.zeros(columns, np.int8)
        cross(np.ascontiguousarray(places[:, order]), faces, int(not signed), crossings)
        vote(crossings, int(not signed), votes)
        total += votes.transpose(np.argsort(order))
    return total > 0


def shares_around(inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From what `enclosed` found: how much of each cell (n, m, l) is inside, and how much around each corner of cells
    (n+1, m+1, l+1)."""
    own, around = inside.astype(np.float32), np.pad(inside, 1).astype(np.float32)
    for axis in range(3):
        own, around = (np.moveaxis(a, axis, 0) for a in (own, around))
        own, around = (np.moveaxis(0.5 * (a[::2] + a[1::2]), 0, axis) for a in (own, around))
    return own, around
