"""Round strokes: springs as rods and particles as beads, with smooth edges at one sample a pixel.

A stroke is a segment with a radius; a bead's ends are one point. `ends` rows are a stroke's two ends on the screen,
(column, row, depth) each, and its radius in pixels at either end.
"""

import taichi as ti

from taichi_jello.view.camera import NEAR
from taichi_jello.view.drawing.rows import Array2, Index2, Keys, row, vec3
from taichi_jello.view.render.pixels.buffers import EMPTY, EXTRA, key_of, on_screen

THINNEST = 0.5  # pixels of radius


@ti.func
def from_segment(a, run, column, line):
    """(distance [pixels], place along it, 0 to 1) of a point on the screen and the segment from a by `run`."""
    p = ti.Vector([column, line]) - a
    along = ti.math.clamp(p.dot(run) / ti.max(run.dot(run), 1e-9), 0.0, 1.0)
    return (p - along * run).norm(), along


@ti.func
def across(a, run, thick, column, line):
    """For a point on the screen and a segment from a by `run`: (distance from the middle line in radii, radius
    [pixels], place along it, 0 to 1). thick: the radius at either end."""
    distance, along = from_segment(a, run, column, line)
    radius = ti.math.mix(thick[0], thick[1], along)
    return vec3(distance / radius, radius, along)


@ti.func
def across_stroke(ends: ti.template(), s, column, line):
    """`across` for stroke s."""
    a, b = ti.Vector([ends[s, 0], ends[s, 1]]), ti.Vector([ends[s, 3], ends[s, 4]])
    return across(a, b - a, ti.Vector([ends[s, 6], ends[s, 7]]), column, line)


@ti.func
def coverage(place):
    """How much of a pixel a stroke covers, for what `across_stroke` gives."""
    return ti.math.clamp((1.0 - place[0]) * place[1] + 0.5, 0.0, 1.0) * ti.min(2.0 * place[1], 1.0)


@ti.kernel
def strokes(view: Array2, x: Array2, pairs: Index2, radius: Array2, ends: Array2, keys: Keys, box: Index2):
    """The nearest stroke of each pixel between points x, in `keys` that are made EMPTY first in the part of the picture
    from column box[0, 0] and row box[0, 1] to box[1, 0] and box[1, 1]. radius: rows of (metres, most pixels)."""
    ti.loop_config(block_dim=16)
    for y in range(box[0, 1], box[1, 1]):
        for c in range(box[0, 0], box[1, 0]):
            keys[y, c] = ti.i64(EMPTY)
    ti.loop_config(block_dim=32)
    for s in range(pairs.shape[0]):
        a, b = on_screen(view, row(x, pairs[s, 0])), on_screen(view, row(x, pairs[s, 1]))
        if ti.min(a[2], b[2]) > NEAR:
            for k in ti.static(range(3)):
                ends[s, k], ends[s, 3 + k] = a[k], b[k]
            wide = radius[s, 0] * view[EXTRA, 0]
            thick = ti.math.clamp(wide / ti.Vector([a[2], b[2]]), THINNEST, radius[s, 1])
            ends[s, 6], ends[s, 7] = thick[0], thick[1]
            reach = thick.max() + 0.5
            top = int(ti.math.clamp(ti.min(a[1], b[1]) - reach, 0.0, 1e6))
            bottom = int(ti.math.clamp(ti.max(a[1], b[1]) + reach, -1.0, keys.shape[0] - 1.0))
            run = ti.Vector([b[0] - a[0], b[1] - a[1]])
            start, near_eye, change = ti.Vector([a[0], a[1]]), 1.0 / a[2], 1.0 / b[2] - 1.0 / a[2]
            for y in range(top, bottom + 1):
                # The columns within reach of the part of the segment near this row.
                near, far = ti.f32(0.0), ti.f32(1.0)
                if ti.abs(run[1]) > 1e-6:
                    near = ti.math.clamp((y + 0.5 - reach - a[1]) / run[1], 0.0, 1.0)
                    far = ti.math.clamp((y + 0.5 + reach - a[1]) / run[1], 0.0, 1.0)
                low = ti.min(a[0] + near * run[0], a[0] + far * run[0]) - reach
                high = ti.max(a[0] + near * run[0], a[0] + far * run[0]) + reach
                first = int(ti.math.clamp(low, 0.0, 1e6))
                last = int(ti.math.clamp(high, -1.0, keys.shape[1] - 1.0))
                for c in range(first, last + 1):
                    place = across(start, run, thick, c + 0.5, y + 0.5)
                    if coverage(place) > 0.02:
                        key = key_of(1.0 / (near_eye + change * place[2]), s)
                        if key < keys[y, c]:
                            ti.atomic_min(keys[y, c], key)
