"""Filling the buffers that pictures are shaded from: which surfaces a pixel sees, and how much body lies between them.

A key is 64 bits, the depth [m] above the number of a triangle or stroke: the smallest is the nearest, whichever
thread comes first. Thickness is a sum of whole numbers, which has no order either. `view`, (9, 3) float32, is made by
`view_of`. `screen` rows are a vertex's column, row and depth.
"""

import numpy as np
import taichi as ti

from taichi_jello.view.camera import NEAR, Viewpoint
from taichi_jello.view.drawing.rows import Array2, Counts, Index1, Index2, Keys, put, row, vec3

Matrix3 = ti.types.matrix(3, 3, ti.f32)

FAR = 1e9  # m: the depth of a pixel that sees no surface
EMPTY = int(np.float32(1e30).view(np.int32)) << 32  # a key farther than all others
UNIT = 2.0**-18  # m of depth in one count of thickness
DEEPEST = 4000.0  # m: the largest depth that counts of thickness hold

EYE, CORNER, ACROSS, DOWN, PROJECT, SHIFT, EXTRA = 0, 1, 2, 3, 4, 7, 8  # rows of `view`


def view_of(viewpoint: Viewpoint, size: tuple[int, int], shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """(9, 3) float32: the eye; the ray of unit depth through the picture's upper left corner and its change per column
    and row; three rows and their constants that take a point to (column·depth, row·depth, depth); (pixels a metre
    covers at a depth of one metre, 0, 0). shift: of the whole picture, in pixels."""
    right, up, back = viewpoint.axes()
    width, height = size
    focal = viewpoint.pixels_per_meter(height)
    across, down = right / focal, -up / focal
    corner = -back - across * (0.5 * width + shift[0]) - down * (0.5 * height + shift[1])
    matrix = viewpoint.to_pixels(size)
    matrix[:2] += np.outer(shift, matrix[2])
    return np.array([viewpoint.eye, corner, across, down, *matrix[:, :3], matrix[:, 3], [focal, 0, 0]], np.float32)


@ti.func
def ray(view: ti.template(), column, line):
    """The way from the eye to depth 1 through the middle of a pixel."""
    return row(view, CORNER) + (column + 0.5) * row(view, ACROSS) + (line + 0.5) * row(view, DOWN)


@ti.func
def on_screen(view: ti.template(), p):
    """Column, row and depth of the point p."""
    shift = row(view, SHIFT)
    depth = ti.max(row(view, PROJECT + 2).dot(p) + shift[2], 1e-6)
    column, line = row(view, PROJECT).dot(p) + shift[0], row(view, PROJECT + 1).dot(p) + shift[1]
    return vec3(column / depth, line / depth, depth)


@ti.kernel
def project(view: Array2, x: Array2, screen: Array2):
    """Where the points x are on the screen; a point behind the eye has a depth below NEAR."""
    ti.loop_config(block_dim=512)
    for i in range(x.shape[0]):
        put(screen, i, on_screen(view, row(x, i)))


@ti.func
def key_of(depth, number):
    bits = ti.cast(ti.bit_cast(ti.cast(depth, ti.f32), ti.i32), ti.i64)
    return (bits << 32) | ti.cast(number, ti.i64)


@ti.func
def depth_of(key):
    return ti.bit_cast(ti.cast(key >> 32, ti.i32), ti.f32)


@ti.func
def number_of(key):
    return ti.cast(key, ti.i32)  # the lower half


@ti.func
def crossing(p, q, y):
    """The column at which the edge between two vertices crosses row y: the same bits for the triangles on both of its
    sides."""
    a, b = p, q
    if p[1] > q[1] or (p[1] == q[1] and p[0] > q[0]):
        a, b = q, p
    return a[0] + (b[0] - a[0]) * ((y - a[1]) / (b[1] - a[1]))


@ti.func
def span(corner: ti.template(), y, width):
    """(first, last) columns whose middles lie in a triangle at row y, first ≤ column < last. Neighbouring triangles
    share no pixel and leave none out."""
    low, high = ti.f32(1e9), ti.f32(-1e9)
    for k in ti.static(range(3)):
        p, q = corner[k, :], corner[(k + 1) % 3, :]
        if ti.min(p[1], q[1]) <= y and y < ti.max(p[1], q[1]):
            x = crossing(p, q, y)
            low, high = ti.min(low, x), ti.max(high, x)
    first = int(ti.ceil(ti.math.clamp(low - 0.5, 0.0, 1e6)))
    return ti.Vector([first, int(ti.ceil(ti.math.clamp(high - 0.5, -1.0, float(width))))])


@ti.func
def corners(screen: ti.template(), faces: ti.template(), t):
    """The triangle's vertices on the screen, one a row."""
    return ti.Matrix.rows([row(screen, faces[t, k]) for k in ti.static(range(3))])


@ti.func
def lines_of(corner: ti.template(), height):
    """(first, last) rows of a triangle, none if it reaches behind the eye."""
    low = ti.min(corner[0, 1], corner[1, 1], corner[2, 1])
    high = ti.max(corner[0, 1], corner[1, 1], corner[2, 1])
    first = int(ti.ceil(ti.math.clamp(low - 0.5, 0.0, 1e6)))
    last = int(ti.ceil(ti.math.clamp(high - 0.5, -1.0, float(height))))
    if not ti.min(corner[0, 2], corner[1, 2], corner[2, 2]) > NEAR:
        last = first
    return ti.Vector([first, last])


@ti.func
def depth_plane(corner: ti.template(), turn):
    """1/depth of a triangle, linear in the picture: (per column, per row, constant)."""
    near = vec3(1.0 / corner[0, 2], 1.0 / corner[1, 2], 1.0 / corner[2, 2])
    b, c = corner[1, :] - corner[0, :], corner[2, :] - corner[0, :]
    db, dc = near[1] - near[0], near[2] - near[0]
    across, down = (db * c[1] - dc * b[1]) / turn, (b[0] * dc - c[0] * db) / turn
    return vec3(across, down, near[0] - across * corner[0, 0] - down * corner[0, 1])


@ti.func
def doubled_area(corner: ti.template()):
    """Below zero for a triangle that faces the eye."""
    b, c = corner[1, :] - corner[0, :], corner[2, :] - corner[0, :]
    return b[0] * c[1] - b[1] * c[0]


@ti.kernel
def nearest(screen: Array2, faces: Index2, keys: Keys):
    """The nearest triangles of opaque bodies, in `keys` that were EMPTY."""
    ti.loop_config(block_dim=64)
    for t in range(faces.shape[0]):
        corner = corners(screen, faces, t)
        turn = doubled_area(corner)
        lines = lines_of(corner, keys.shape[0])
        if ti.abs(turn) > 1e-9:
            plane = depth_plane(corner, turn)
            for y in range(lines[0], lines[1]):
                columns = span(corner, y + 0.5, keys.shape[1])
                for x in range(columns[0], columns[1]):
                    depth = 1.0 / (plane[0] * (x + 0.5) + plane[1] * (y + 0.5) + plane[2])
                    key = key_of(depth, t)
                    if key < keys[y, x]:
                        ti.atomic_min(keys[y, x], key)


@ti.kernel
def layers(screen: Array2, faces: Index2, run: Index1, front: Keys, back: Keys, thick: Counts):
    """Of the triangles from run[0] to run[1], a closed body's: its nearest and its farthest surface, and the counts of
    depth between all its front and back sides. Fills the part of the picture from column run[2] and row run[3] to
    run[4] and run[5]."""
    ti.loop_config(block_dim=8)
    for y in range(run[3], run[5]):
        for x in range(run[2], run[4]):
            front[y, x], back[y, x], thick[y, x] = ti.i64(EMPTY), ti.i64(-1), 0
    ti.loop_config(block_dim=64)
    for t in range(run[0], run[1]):
        corner = corners(screen, faces, t)
        turn = doubled_area(corner)
        lines = lines_of(corner, front.shape[0])
        if ti.abs(turn) > 1e-9:
            plane = depth_plane(corner, turn)
            low = ti.min(corner[0, 2], corner[1, 2], corner[2, 2])
            high = ti.min(ti.max(corner[0, 2], corner[1, 2], corner[2, 2]), DEEPEST)
            for y in range(lines[0], lines[1]):
                columns = span(corner, y + 0.5, front.shape[1])
                for x in range(columns[0], columns[1]):
                    depth = 1.0 / (plane[0] * (x + 0.5) + plane[1] * (y + 0.5) + plane[2])
                    depth = ti.math.clamp(depth, low, high)  # a triangle on edge has a steep plane
                    key, count = key_of(depth, t), int(depth / UNIT)
                    if turn < 0.0:
                        ti.atomic_min(front[y, x], key)
                        ti.atomic_sub(thick[y, x], count)
                    else:
                        ti.atomic_max(back[y, x], key)
                        ti.atomic_add(thick[y, x], count)


@ti.func
def shares(view: ti.template(), x: ti.template(), faces: ti.template(), t, way):
    """The parts of a triangle's corners where the ray from the eye meets it (Möller and Trumbore 1997)."""
    a = row(x, faces[t, 0])
    b, c = row(x, faces[t, 1]) - a, row(x, faces[t, 2]) - a
    across, from_a = way.cross(c), row(view, EYE) - a
    scale = b.dot(across)
    scale = ti.select(ti.abs(scale) > 1e-20, 1.0 / scale, 0.0)
    u, v = from_a.dot(across) * scale, way.dot(from_a.cross(b)) * scale
    u, v = ti.math.clamp(u, 0.0, 1.0), ti.math.clamp(v, 0.0, 1.0)
    return vec3(1.0 - u - v, u, v)


@ti.func
def mean_at(values: ti.template(), faces: ti.template(), t, share):
    """The rows of a triangle's corners, each with its share."""
    total = vec3(0.0)
    for k in ti.static(range(3)):
        total += share[k] * row(values, faces[t, k])
    return total


@ti.func
def smooth_normal(normal: ti.template(), faces: ti.template(), t, share):
    return mean_at(normal, faces, t, share).normalized(1e-20)
