"""From linear radiances to the bytes of a picture: strokes over it, a curve for what is too bright, sRGB, and noise in
the last bit that leaves no bands."""

import taichi as ti
from taichi.math import clamp, mix

from taichi_jello.view.drawing.rows import Array2, Colors, Columns, Depths, Image, Index2, Keys, row, vec3
from taichi_jello.view.render.pixels.buffers import FAR, depth_of, number_of
from taichi_jello.view.render.pixels.strokes import across_stroke, coverage

KNEE = 0.72  # radiances up to here stay as they are
RIM, PALE = 1.0, 0.7  # the outline of a stroke, in pixels at most, and its radiance
THICK = 4.0  # pixels of radius from which on a stroke needs none
TILE = (16, 64)  # columns and rows


@ti.func
def toned(color):
    """Radiances as parts of the brightest white: above KNEE by Reinhard's curve."""
    over = ti.max(color - KNEE, 0.0) / (1.0 - KNEE)
    return ti.min(color, KNEE) + (1.0 - KNEE) * over / (1.0 + over)


@ti.func
def encoded(linear):
    """sRGB, from 0 to 1, to a thousandth."""
    color = clamp(linear, 0.0, 1.0)
    a = ti.sqrt(color)
    b = ti.sqrt(a)
    return ti.select(
        color < 0.0031308, 12.92 * color, 0.6620027 * a + 0.6841221 * b - 0.3235836 * ti.sqrt(b) - 0.0225411 * color
    )


@ti.func
def noise(x, y):
    """Three numbers, even from 0 to 1, the same for the same pixel."""
    bits = ti.cast(x, ti.u32) * ti.u32(0x9E3779B1) ^ ti.cast(y, ti.u32) * ti.u32(0x85EBCA77)
    bits = (bits ^ (bits >> 15)) * ti.u32(0x2C1B3C6D)
    bits = (bits ^ (bits >> 12)) * ti.u32(0x297A2D39)
    bits ^= bits >> 15
    return vec3(bits & 1023, (bits >> 10) & 1023, (bits >> 20) & 1023) / 1024.0


@ti.func
def rod(rgb, place):
    """The colour of a round rod or bead, lit from the eye, at a distance of place[0] radii from its middle, in a
    pale outline, which sets it off from a body of its own colour."""
    linear = rgb**2.2
    high = ti.sqrt(ti.max(1.0 - place[0] * place[0], 0.0))
    rim = ti.min(RIM, 0.4 * place[1]) * clamp(2.0 - place[1] / THICK, 0.0, 1.0)
    inner = clamp((1.0 - place[0]) * place[1] / ti.max(rim, 1e-3), 0.0, 1.0)
    return mix(vec3(PALE), linear * (0.3 + 0.8 * high) + 0.06 * high**16, inner)


@ti.kernel
def compose(
    keys: Keys,
    ends: Array2,
    rgb: Array2,
    fade: ti.f32,
    scene: Colors,
    solid: Depths,
    tops: Depths,
    box: Index2,
    mean: Colors,
    part: ti.f32,
    image: Image,
    last: ti.i32,
):
    """Lay the strokes over the scene and add `part` of the toned picture to `mean`, or begin it at a part below zero;
    with the last sample, write the image. A stroke is hidden behind `solid` and fades by `fade` [1/m] the deeper it
    lies below `tops`."""
    ti.loop_config(block_dim=8)
    for y in range(box[0, 1], box[1, 1]):
        for x in range(box[0, 0], box[1, 0]):
            color = toned(vec3(scene[y, x, 0], scene[y, x, 1], scene[y, x, 2]))
            key = keys[y, x]
            depth = depth_of(key)
            if depth < FAR and depth < solid[y, x]:
                s = number_of(key)
                place = across_stroke(ends, s, x + 0.5, y + 0.5)
                seen = coverage(place) * ti.exp(-fade * ti.max(depth - tops[y, x], 0.0))
                color = mix(color, rod(row(rgb, s), place), seen)
            color *= ti.abs(part)
            if part > 0.0:
                color += vec3(mean[y, x, 0], mean[y, x, 1], mean[y, x, 2])
            if last == 0:
                for k in ti.static(range(3)):
                    mean[y, x, k] = color[k]
            else:
                levels = ti.min(255.0 * encoded(color) + noise(x, y), 255.0)
                for k in ti.static(range(3)):
                    image[y, x, k] = ti.cast(ti.cast(levels[k], ti.i32), ti.u8)


@ti.kernel
def columns_of(image: Image, columns: Columns):
    """The picture as GGUI shows it: columns first, upwards, a pixel's four bytes in one word. Tile by tile: one of the
    two is always walked across its memory, and a tile stays in the cache."""
    wide, high = (columns.shape[0] + TILE[0] - 1) // TILE[0], (columns.shape[1] + TILE[1] - 1) // TILE[1]
    ti.loop_config(block_dim=16)
    for tile in range(wide * high):
        left, top = tile % wide * TILE[0], tile // wide * TILE[1]
        for x in range(left, ti.min(left + TILE[0], columns.shape[0])):
            for y in range(top, ti.min(top + TILE[1], columns.shape[1])):
                color = ti.Vector([ti.cast(image[y, x, k], ti.u32) for k in ti.static(range(3))])
                packed = color[0] | color[1] << 8 | color[2] << 16 | ti.u32(0xFF000000)
                columns[x, columns.shape[1] - 1 - y] = packed
