"""The rasteriser's kernels: triangles, lines and dots into a depth buffer, and a skin blended over it.

A pixel is one 64-bit integer, the bits of its depth above its colour. The smallest wins whichever thread comes last, so
that the same drawing gives the same picture to the bit. `to_pixels` is Viewpoint.to_pixels, (3, 4) float32.
"""

import numpy as np
import taichi as ti

from taichi_jello.view.camera import NEAR
from taichi_jello.view.drawing.rows import Array2, Columns, Image, Index2, Pixels, row, vec3

WIDENING = 1e-4  # pixels added to a triangle: rounding must leave no gap between neighbours
DEPTH_TOLERANCE = 1.0 + 2e-6  # a skin behind by less than this factor still counts as in front
TILE = (16, 64)  # columns and rows
BAND = 8  # rows of the picture that one thread blends
LEFT, RIGHT, TOP, BOTTOM = range(4)  # columns of a box: first and last column, first and last row of pixels


@ti.func
def place(m: ti.template(), x: ti.template(), i):
    """Point i of x: column, row and 1, times its depth."""
    p = row(x, i)
    return vec3(
        m[0, 0] * p[0] + m[0, 1] * p[1] + m[0, 2] * p[2] + m[0, 3],
        m[1, 0] * p[0] + m[1, 1] * p[1] + m[1, 2] * p[2] + m[1, 3],
        m[2, 0] * p[0] + m[2, 1] * p[1] + m[2, 2] * p[2] + m[2, 3],
    )


@ti.func
def pack(depth, color):
    bits = ti.cast(color * 255.0 + 0.5, ti.i32)
    high = ti.cast(ti.bit_cast(ti.cast(depth, ti.f32), ti.i32), ti.i64)
    return (high << 32) | ti.cast((bits[0] << 16) | (bits[1] << 8) | bits[2], ti.i64)


@ti.func
def unpack(packed):
    old = ti.cast(packed & 0xFFFFFF, ti.i32)
    return vec3(old >> 16, (old >> 8) & 255, old & 255) / 255.0


@ti.func
def offer(pixels: ti.template(), y, x, packed):
    if packed < pixels[y, x]:  # most fragments are hidden: reading first spares the atomic
        ti.atomic_min(pixels[y, x], packed)


@ti.kernel
def prepare(to_pixels: Array2, x: Array2, index: Index2, width: ti.i32, height: ti.i32, box: Index2, edge: Array2):
    """The box (F, 4) of each triangle [pixels] and its edge functions (F, 9), three rows of a matrix. Times (column,
    row, 1) from the box's corner, they give each corner's share of 1/depth, all positive inside (2-D homogeneous
    rasterisation, Olano and Greer 1997: a triangle that reaches behind the eye needs no clipping)."""
    ti.loop_config(block_dim=64)
    for t in range(index.shape[0]):
        corner = ti.Matrix.zero(ti.f32, 3, 3)
        low, high = ti.Vector([1e9, 1e9]), ti.Vector([-1e9, -1e9])
        nearest, farthest = ti.f32(1e9), ti.f32(-1e9)
        for k in range(3):
            p = place(to_pixels, x, index[t, k])
            corner[k, :] = p
            nearest, farthest = ti.min(nearest, p[2]), ti.max(farthest, p[2])
            at = ti.Vector([p[0], p[1]]) / p[2]
            low, high = ti.min(low, at), ti.max(high, at)
        if nearest < NEAR:
            low, high = ti.Vector([-1e9, -1e9]), ti.Vector([1e9, 1e9])
        if farthest < NEAR:
            high = low
        left, top = int(ti.math.clamp(low[0] - 0.5, 0.0, 1e6)), int(ti.math.clamp(low[1] - 0.5, 0.0, 1e6))
        box[t, LEFT], box[t, RIGHT] = left, int(ti.math.clamp(high[0] + 0.5, -1.0, width - 1.0))
        box[t, TOP], box[t, BOTTOM] = top, int(ti.math.clamp(high[1] + 0.5, -1.0, height - 1.0))
        for k in range(3):
            corner[k, 0] -= left * corner[k, 2]
            corner[k, 1] -= top * corner[k, 2]
        volume = corner[0, :].dot(corner[1, :].cross(corner[2, :]))
        for k in range(3):
            row_ = corner[(k + 1) % 3, :].cross(corner[(k + 2) % 3, :]) / volume
            for m in ti.static(range(3)):
                edge[t, 3 * k + m] = row_[m]
        if ti.abs(volume) < 1e-12:
            box[t, BOTTOM] = -1


@ti.func
def span(edge: ti.template(), t, y, width):
    """(first, last) column where all three edge functions of triangle t are positive in row y of its box."""
    first, last = -WIDENING - 0.5, width - 0.5 + WIDENING
    for k in range(3):
        slope, rest = edge[t, 3 * k], edge[t, 3 * k + 1] * (y + 0.5) + edge[t, 3 * k + 2]
        if slope > 0.0:
            first = ti.max(first, -rest / slope - 0.5 - WIDENING)
        elif slope < 0.0:
            last = ti.min(last, -rest / slope - 0.5 + WIDENING)
        elif rest <= 0.0:
            last = -1.0
    return ti.Vector([int(ti.ceil(ti.min(first, 1e6))), int(ti.floor(ti.max(last, -1.0)))])


@ti.func
def edge_matrix(edge: ti.template(), t):
    return ti.Matrix([[edge[t, 3 * k + m] for m in range(3)] for k in range(3)])


@ti.func
def corner_colors(rgba: ti.template(), index: ti.template(), t):
    return ti.Matrix.cols([row(rgba, index[t, 0]), row(rgba, index[t, 1]), row(rgba, index[t, 2])])


def backdrop(pixels: np.ndarray, top: np.ndarray, low: np.ndarray) -> None:
    """Clear the picture to the background's two colours, at infinity."""
    down = (np.arange(len(pixels)) + 0.5) / len(pixels)
    color = (255.0 * (top + down[:, None] * (low - top)) + 0.5).astype(np.int64)
    far = int(np.float32(1e30).view(np.int32)) << 32
    pixels[:] = (far | color[:, 0] << 16 | color[:, 1] << 8 | color[:, 2])[:, None]


@ti.kernel
def triangles(pixels: Pixels, rgba: Array2, index: Index2, box: Index2, edge: Array2):
    """Opaque triangles with the box and edge of `prepare`."""
    ti.loop_config(block_dim=32)
    for t in range(index.shape[0]):
        e = edge_matrix(edge, t)
        tint = corner_colors(rgba, index, t)
        for y in range(box[t, BOTTOM] + 1 - box[t, TOP]):
            s = span(edge, t, y, box[t, RIGHT] + 1 - box[t, LEFT])
            for column in range(s[0], s[1] + 1):
                part = e @ vec3(column + 0.5, y + 0.5, 1.0)
                near = part.sum()
                if near > 0.0 and near * NEAR < 1.0:
                    offer(pixels, box[t, TOP] + y, box[t, LEFT] + column, pack(1.0 / near, tint @ part / near))


@ti.kernel
def lines(pixels: Pixels, to_pixels: Array2, x: Array2, rgb: Array2, thick: ti.f32):
    """Segments `thick` pixels wide, traversed along their longer side."""
    ti.loop_config(block_dim=32)
    for s in range(x.shape[0] // 2):
        a, b = place(to_pixels, x, 2 * s), place(to_pixels, x, 2 * s + 1)
        if a[2] > NEAR and b[2] > NEAR:
            p, q = vec3(a[0], a[1], 1.0) / a[2], vec3(b[0], b[1], 1.0) / b[2]
            ca, cb = row(rgb, 2 * s), row(rgb, 2 * s + 1)
            flat = ti.abs(q[0] - p[0]) >= ti.abs(q[1] - p[1])
            if not flat:
                p, q = vec3(p[1], p[0], p[2]), vec3(q[1], q[0], q[2])
            if p[0] > q[0]:
                p, q = q, p
                ca, cb = cb, ca
            run = q[0] - p[0]
            if run > 1e-6:
                slope = (q[1] - p[1]) / run
                half = 0.5 * thick * ti.sqrt(1.0 + slope * slope)
                across, along = pixels.shape[0], pixels.shape[1]
                if not flat:
                    across, along = along, across
                for i in range(ti.max(int(ti.ceil(p[0] - 0.5)), 0), ti.min(int(ti.ceil(q[0] - 0.5)), along)):
                    t = (i + 0.5 - p[0]) / run
                    middle = p[1] + slope * (i + 0.5 - p[0])
                    color = ti.math.mix(ca, cb, t)
                    depth = 1.0 / ti.math.mix(p[2], q[2], t)
                    packed = pack(depth, color)
                    low, high = int(ti.ceil(middle - half - 0.5)), int(ti.ceil(middle + half - 0.5))
                    for j in range(ti.max(low, 0), ti.min(high, across)):
                        row_, column = j, i
                        if not flat:
                            row_, column = i, j
                        offer(pixels, row_, column, packed)


@ti.kernel
def dots(pixels: Pixels, to_pixels: Array2, x: Array2, rgb: Array2, eye: vec3, scale: ti.f32, bulge: ti.f32):
    """Discs of the radius `scale` [pixels] at one metre; their centre is `bulge` [m] closer to the eye."""
    ti.loop_config(block_dim=32)
    for d in range(x.shape[0]):
        p = row(x, d)
        a = place(to_pixels, x, d)
        if a[2] - bulge > NEAR:
            u, v = a[0] / a[2], a[1] / a[2]
            radius = scale / (p - eye).norm()
            color = row(rgb, d)
            for y in range(ti.max(int(v - radius), 0), ti.min(int(v + radius) + 1, pixels.shape[0])):
                for column in range(ti.max(int(u - radius), 0), ti.min(int(u + radius) + 1, pixels.shape[1])):
                    dx, dy = (column + 0.5 - u) / radius, (y + 0.5 - v) / radius
                    inside = 1.0 - dx * dx - dy * dy
                    if inside > 0.0:
                        offer(pixels, y, column, pack(a[2] - bulge * ti.sqrt(inside), color))


@ti.kernel
def skin(pixels: Pixels, rgba: Array2, index: Index2, box: Index2, edge: Array2):
    """Blend prepared triangles in their order. Each thread visits all, but fills only its own rows of the picture."""
    ti.loop_config(block_dim=1)
    for band in range((pixels.shape[0] + BAND - 1) // BAND):
        start, end = band * BAND, ti.min(band * BAND + BAND, pixels.shape[0])
        for t in range(index.shape[0]):
            if box[t, TOP] < end and box[t, BOTTOM] >= start:
                e = edge_matrix(edge, t)
                tint = corner_colors(rgba, index, t)
                alpha = vec3(rgba[index[t, 0], 3], rgba[index[t, 1], 3], rgba[index[t, 2], 3])
                for y in range(ti.max(box[t, TOP], start), ti.min(box[t, BOTTOM] + 1, end)):
                    s = span(edge, t, y - box[t, TOP], box[t, RIGHT] + 1 - box[t, LEFT])
                    for column in range(box[t, LEFT] + s[0], box[t, LEFT] + s[1] + 1):
                        part = e @ vec3(column - box[t, LEFT] + 0.5, y - box[t, TOP] + 0.5, 1.0)
                        near = part.sum()
                        under = pixels[y, column]
                        behind = ti.bit_cast(ti.cast(under >> 32, ti.i32), ti.f32)
                        if near * NEAR < 1.0 and near * behind * DEPTH_TOLERANCE >= 1.0:
                            part /= near
                            old = unpack(under)
                            pixels[y, column] = pack(1.0 / near, old + (tint @ part - old) * alpha.dot(part))


@ti.func
def mean_color(pixels: ti.template(), y, x, samples: ti.template()):
    """The mean colour, 0 to 255, of a samples × samples block; red and blue are summed together, 16 bits apart."""
    outer, green = samples * samples // 2 * 0x10001, samples * samples // 2
    for j, i in ti.static(ti.ndrange(samples, samples)):
        color = ti.cast(pixels[y * samples + j, x * samples + i], ti.i32)
        outer += color & 0xFF00FF
        green += (color >> 8) & 0xFF
    return ti.Vector([outer >> 16, green, outer & 0xFFFF]) // (samples * samples)


@ti.kernel
def resolve(pixels: Pixels, image: Image, samples: ti.template()):
    """The mean colours of samples × samples blocks, rows downwards."""
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            color = mean_color(pixels, y, x, samples)
            for k in ti.static(range(3)):
                image[y, x, k] = ti.cast(color[k], ti.u8)


@ti.kernel
def resolve_columns(pixels: Pixels, columns: Columns, samples: ti.template()):
    """The same in GGUI's layout: columns first, upwards, four bytes a pixel. By tiles, which stay in the cache."""
    wide, high = (columns.shape[0] + TILE[0] - 1) // TILE[0], (columns.shape[1] + TILE[1] - 1) // TILE[1]
    ti.loop_config(block_dim=16)
    for tile in range(wide * high):
        left, top = tile % wide * TILE[0], tile // wide * TILE[1]
        for x in range(left, ti.min(left + TILE[0], columns.shape[0])):
            for y in range(top, ti.min(top + TILE[1], columns.shape[1])):
                color = ti.cast(mean_color(pixels, y, x, samples), ti.u32)
                columns[x, columns.shape[1] - 1 - y] = color[0] | color[1] << 8 | color[2] << 16 | ti.u32(0xFF000000)
