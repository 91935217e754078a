"""A sheet of words, lines and rectangles drawn over a picture, with smooth edges, fast enough for every picture of a
window. Every row of pixels takes the strokes in their order, so that threads do not matter."""

import numpy as np
import taichi as ti

from taichi_jello.view.drawing.rows import Array2, Image, vec3
from taichi_jello.view.render.legend import Line, Sheet, Text
from taichi_jello.view.render.pixels.develop import packed
from taichi_jello.view.render.pixels.strokes import from_segment


@ti.func
def blend(image: ti.template(), y, x, rgb, cover):
    word = image[y, x]
    old = vec3([ti.cast((word >> (8 * k)) & 255, ti.f32) for k in ti.static(range(3))])
    image[y, x] = packed(old + (rgb - old) * cover + 0.5)


@ti.kernel
def ink(quads: Array2, strokes: Array2, image: Image):
    """quads (Q, 10): first and last column, first and last row, colours at the left and right side; strokes (S, 8):
    two ends, half the width, colour. Colours from 0 to 255."""
    ti.loop_config(block_dim=8)
    for y in range(image.shape[0]):
        middle = y + 0.5
        for q in range(quads.shape[0]):
            if quads[q, 2] <= middle and middle < quads[q, 3]:
                first = int(ti.math.clamp(ti.round(quads[q, 0]), 0.0, float(image.shape[1])))
                last = int(ti.math.clamp(ti.round(quads[q, 1]), 0.0, float(image.shape[1])))
                for x in range(first, last):
                    t = ti.math.clamp((x + 0.5 - quads[q, 0]) / (quads[q, 1] - quads[q, 0]), 0.0, 1.0)
                    left, right = (
                        vec3(quads[q, 4], quads[q, 5], quads[q, 6]),
                        vec3(quads[q, 7], quads[q, 8], quads[q, 9]),
                    )
                    blend(image, y, x, ti.math.mix(left, right, t), 1.0)
        for s in range(strokes.shape[0]):
            a, b = ti.Vector([strokes[s, 0], strokes[s, 1]]), ti.Vector([strokes[s, 2], strokes[s, 3]])
            reach = strokes[s, 4] + 0.5
            if middle > ti.min(a[1], b[1]) - reach and middle < ti.max(a[1], b[1]) + reach:
                first = int(ti.math.clamp(ti.min(a[0], b[0]) - reach, 0.0, float(image.shape[1])))
                last = int(ti.math.clamp(ti.max(a[0], b[0]) + reach + 1.0, 0.0, float(image.shape[1])))
                run = b - a
                for x in range(first, last):
                    distance, _along = from_segment(a, run, x + 0.5, middle)
                    cover = ti.math.clamp(reach - distance, 0.0, 1.0)
                    if cover > 0.0:
                        blend(image, y, x, vec3(strokes[s, 5], strokes[s, 6], strokes[s, 7]), cover)


@ti.func
def near(image: ti.template(), i, k, x):
    """Four times the mean of the pixels at column x in rows i and k, three parts to one: (red and blue, green), with
    16 bits for a channel."""
    a, b, mask = image[i, x], image[k, x], ti.u32(0x00FF00FF)
    return ti.Vector([3 * (a & mask) + (b & mask), 3 * ((a >> 8) & mask) + ((b >> 8) & mask)])


@ti.func
def halfway(a, b):
    """The pixel of what `near` gives for two columns, three parts to one."""
    mean = ((3 * a + b + ti.u32(0x00080008)) >> 4) & ti.u32(0x00FF00FF)
    return mean[0] | mean[1] << 8


@ti.kernel
def double(image: Image, large: Image):
    """Fill `large` with a picture half as high and wide, blended between the middles of its pixels."""
    ti.loop_config(block_dim=8)
    for y in range(large.shape[0]):
        i = y // 2
        k = ti.math.clamp(i + 2 * (y % 2) - 1, 0, image.shape[0] - 1)
        here = near(image, i, k, 0)
        before = here
        for x in range(image.shape[1]):
            after = near(image, i, k, ti.min(x + 1, image.shape[1] - 1))
            large[y, 2 * x] = halfway(here, before)
            if 2 * x + 1 < large.shape[1]:
                large[y, 2 * x + 1] = halfway(here, after)
            before, here = here, after


def write(sheet: Sheet, image: np.ndarray) -> None:
    """Draw the sheet into image (height, width) uint32."""
    quads = [(q.x, q.x + q.width, q.y, q.y + q.height, *(255.0 * q.left), *(255.0 * q.right)) for q in sheet.quads]
    drawn: list[Line | Text] = sorted([*sheet.lines, *sheet.texts], key=lambda stroke: -stroke.width)
    rows = [np.zeros((0, 8))]
    for stroke in drawn:
        ends = stroke.segments().reshape(-1, 4)
        rest = np.array([0.5 * stroke.width, *(255.0 * np.asarray(stroke.rgb))])
        rows.append(np.hstack([ends, np.broadcast_to(rest, (len(ends), 4))]))
    ink(np.array(quads, np.float32).reshape(-1, 10), np.concatenate(rows).astype(np.float32), image)
