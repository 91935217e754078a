"""A sheet of words, lines and rectangles drawn over a picture, with smooth edges, fast enough for every picture of a
window. Every row of pixels takes the strokes in their order, so that threads do not matter."""

import numpy as np
import taichi as ti

from taichi_jello.view.drawing.rows import Array2, Image, vec3
from taichi_jello.view.render.legend import Line, Sheet, Text


@ti.func
def blend(image: ti.template(), y, x, rgb, cover):
    for k in ti.static(range(3)):
        old = ti.cast(image[y, x, k], ti.f32)
        image[y, x, k] = ti.cast(ti.cast(old + (rgb[k] - old) * cover + 0.5, ti.i32), ti.u8)


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
                    left, right = vec3(quads[q, 4], quads[q, 5], quads[q, 6]), vec3(quads[q, 7], quads[q, 8], quads[q, 9])
                    blend(image, y, x, ti.math.mix(left, right, t), 1.0)
        for s in range(strokes.shape[0]):
            a, b = ti.Vector([strokes[s, 0], strokes[s, 1]]), ti.Vector([strokes[s, 2], strokes[s, 3]])
            reach = strokes[s, 4] + 0.5
            if middle > ti.min(a[1], b[1]) - reach and middle < ti.max(a[1], b[1]) + reach:
                first = int(ti.math.clamp(ti.min(a[0], b[0]) - reach, 0.0, float(image.shape[1])))
                last = int(ti.math.clamp(ti.max(a[0], b[0]) + reach + 1.0, 0.0, float(image.shape[1])))
                run = b - a
                for x in range(first, last):
                    p = ti.Vector([x + 0.5, middle]) - a
                    along = ti.math.clamp(p.dot(run) / ti.max(run.dot(run), 1e-9), 0.0, 1.0)
                    cover = ti.math.clamp(reach - (p - along * run).norm(), 0.0, 1.0)
                    if cover > 0.0:
                        blend(image, y, x, vec3(strokes[s, 5], strokes[s, 6], strokes[s, 7]), cover)


@ti.kernel
def enlarge(image: Image, large: Image):
    """Fill `large` with the picture, blended between the middles of its pixels."""
    ti.loop_config(block_dim=8)
    for y in range(large.shape[0]):
        v = ti.math.clamp((y + 0.5) * image.shape[0] / large.shape[0] - 0.5, 0.0, image.shape[0] - 1.0)
        i = int(v)
        k = ti.min(i + 1, image.shape[0] - 1)
        for x in range(large.shape[1]):
            u = ti.math.clamp((x + 0.5) * image.shape[1] / large.shape[1] - 0.5, 0.0, image.shape[1] - 1.0)
            j = int(u)
            m = ti.min(j + 1, image.shape[1] - 1)
            for c in ti.static(range(3)):
                upper = ti.math.mix(ti.cast(image[i, j, c], ti.f32), ti.cast(image[i, m, c], ti.f32), u - j)
                lower = ti.math.mix(ti.cast(image[k, j, c], ti.f32), ti.cast(image[k, m, c], ti.f32), u - j)
                large[y, x, c] = ti.cast(ti.cast(ti.math.mix(upper, lower, v - i) + 0.5, ti.i32), ti.u8)


def write(sheet: Sheet, image: np.ndarray) -> None:
    """Draw the sheet into image (height, width, 3) uint8."""
    quads = [(q.x, q.x + q.width, q.y, q.y + q.height, *(255.0 * q.left), *(255.0 * q.right)) for q in sheet.quads]
    drawn: list[Line | Text] = sorted([*sheet.lines, *sheet.texts], key=lambda stroke: -stroke.width)
    rows = [np.zeros((0, 8))]
    for stroke in drawn:
        ends = stroke.segments().reshape(-1, 4)
        rest = np.array([0.5 * stroke.width, *(255.0 * np.asarray(stroke.rgb))])
        rows.append(np.hstack([ends, np.broadcast_to(rest, (len(ends), 4))]))
    ink(np.array(quads, np.float32).reshape(-1, 10), np.concatenate(rows).astype(np.float32), image)
