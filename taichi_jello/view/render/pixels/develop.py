"""From linear radiances to the bytes of a picture: strokes over it, a curve for what is too bright, sRGB, and noise in
the last bit that leaves no bands."""

import numpy as np
import taichi as ti
from taichi.math import clamp, mix

from taichi_jello.view.drawing.rows import Array1, Array2, Colors, Depths, Image, Index2, Keys, row, vec3
from taichi_jello.view.render.pixels.buffers import FAR, depth_of, number_of
from taichi_jello.view.render.pixels.strokes import across_stroke, coverage

STEPS = 1024  # of the table of display levels
KNEE = 0.72  # radiances up to here stay as they are
RIM, PALE = 1.0, 0.7  # the outline of a stroke, in pixels at most, and its radiance
THICK = 4.0  # pixels of radius from which on a stroke needs none
TILE = (16, 64)  # columns and rows


def srgb_table() -> np.ndarray:
    """(STEPS + 2,) float32: display levels from 0 to 255 of linear colours (k / STEPS)²."""
    linear = (np.arange(STEPS + 2) / STEPS) ** 2
    levels = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    return (255.0 * levels.clip(0.0, 1.0)).astype(np.float32)


@ti.func
def toned(color):
    """Radiances as parts of the brightest white: above KNEE by Reinhard's curve."""
    left = color
    if color.max() > KNEE:
        over = ti.max(color - KNEE, 0.0) / (1.0 - KNEE)
        left = ti.min(color, KNEE) + (1.0 - KNEE) * over / (1.0 + over)
    return left


@ti.func
def level(table: ti.template(), linear):
    """The display level of a linear value from 0 to 1, between those of the table."""
    at = ti.sqrt(clamp(linear, 0.0, 1.0)) * STEPS
    k = ti.cast(at, ti.i32)
    return mix(table[k], table[k + 1], at - k)


@ti.func
def packed(levels):
    """A pixel of an Image, of three levels from 0 to 255."""
    color = ti.cast(ti.cast(levels, ti.i32), ti.u32)
    return color[0] | color[1] << 8 | color[2] << 16 | ti.u32(0xFF000000)


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
    """The linear colour of a round rod or bead, lit from the eye, at a distance of place[0] radii from its middle, in a
    pale outline, which sets it off from a body of its own colour."""
    square = ti.max(1.0 - place[0] * place[0], 0.0)  # of the height of its surface
    fourth = square * square
    rim = ti.min(RIM, 0.4 * place[1]) * clamp(2.0 - place[1] / THICK, 0.0, 1.0)
    inner = clamp((1.0 - place[0]) * place[1] / ti.max(rim, 1e-3), 0.0, 1.0)
    return mix(vec3(PALE), rgb * (0.3 + 0.8 * ti.sqrt(square)) + 0.06 * fourth * fourth * fourth * fourth, inner)


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
    table: Array1,
    last: ti.i32,
):
    """Lay the strokes over the scene and add `part` of the toned picture to `mean`, or begin it at a part below zero;
    with the last sample, write the image by the `srgb_table`. A stroke in the linear colour `rgb` is hidden behind
    `solid` and fades by `fade` [1/m] the deeper it lies below `tops`."""
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
                levels = vec3([level(table, color[k]) for k in ti.static(range(3))])
                image[y, x] = packed(ti.min(levels + noise(x, y), 255.0))


@ti.kernel
def columns_of(image: Image, columns: Image):
    """The picture as GGUI shows it: columns first, upwards. Tile by tile: one of the two is always walked across its
    memory, and a tile stays in the cache."""
    wide, high = (columns.shape[0] + TILE[0] - 1) // TILE[0], (columns.shape[1] + TILE[1] - 1) // TILE[1]
    ti.loop_config(block_dim=16)
    for tile in range(wide * high):
        left, top = tile % wide * TILE[0], tile // wide * TILE[1]
        for x in range(left, ti.min(left + TILE[0], columns.shape[0])):
            for y in range(top, ti.min(top + TILE[1], columns.shape[1])):
                columns[x, columns.shape[1] - 1 - y] = image[y, x]
