"""The picture without any jello: colliders and the studio around them, and the shadows laid on it."""

import taichi as ti

from taichi_jello.view.drawing.rows import Array2, Colors, Depths, Index2, Keys, row, vec3
from taichi_jello.view.render.pixels.buffers import (
    EMPTY,
    EXTRA,
    EYE,
    FAR,
    depth_of,
    number_of,
    ray,
    shares,
    smooth_normal,
)
from taichi_jello.view.render.pixels.soft_shadow import light_at
from taichi_jello.view.render.pixels.studio import AMBIENT, around, diffuse, floor_way, haze, lamps, schlick

LEVEL = 1e-5  # of its distance: a solid's face that lies in the floor by less than that is a part of it


@ti.kernel
def clear(keys: Keys):
    ti.loop_config(block_dim=4)
    for y in range(keys.shape[0]):
        for x in range(keys.shape[1]):
            keys[y, x] = ti.i64(EMPTY)


@ti.kernel
def stage(
    view: Array2,
    studio: Array2,
    grid: Array2,
    light: Colors,
    x: Array2,
    normal: Array2,
    faces: Index2,
    rgb: Array2,
    keys: Keys,
    scene: Colors,
    depths: Depths,
):
    """The nearest triangles in `keys` as solids with the albedo rgb of their corners, and the studio elsewhere with the
    solids' shadows: linear colours and depths [m]."""
    ti.loop_config(block_dim=4)
    for y in range(keys.shape[0]):
        for c in range(keys.shape[1]):
            way = ray(view, float(c), float(y))
            d, eye, blur = way.normalized(), row(view, EYE), 1.0 / view[EXTRA, 0]
            depth = ti.min(depth_of(keys[y, c]), FAR)
            reach, shade = floor_way(studio, eye, d), vec3(1.0)
            level = ti.select(reach >= 0.0, reach / way.norm(), FAR)
            start, toward, matte, glossy = eye, d, vec3(0.0), 1.0
            thing = depth < level * (1.0 - LEVEL)
            if thing:  # a glazed solid
                t = number_of(keys[y, c])
                n = smooth_normal(normal, faces, t, shares(view, x, faces, t, way))
                start, toward = eye + way * depth, d - 2.0 * d.dot(n) * n
                matte = row(rgb, faces[t, 0]) * (AMBIENT * (0.65 + 0.35 * n[1]) + 0.75 * diffuse(studio, start, n, 0.2))
                glossy = 0.03 + schlick(-d.dot(n))
            else:
                depth = ti.min(level, FAR)
                if reach >= 0.0:
                    shade = light_at(grid, light, eye + d * reach)
            color = around(studio, start, toward, ti.select(thing, 0.05, blur), shade)
            if thing:
                color = matte + glossy * (color + lamps(studio, start, toward, 0.12))
            depths[y, c] = depth
            for k in ti.static(range(3)):
                scene[y, c, k] = color[k]


@ti.kernel
def begin(
    view: Array2,
    studio: Array2,
    grid: Array2,
    light: Colors,
    stage_colors: Colors,
    stage_depths: Depths,
    box: Index2,
    scene: Colors,
    depths: Depths,
):
    """Start a picture in the part from column box[0, 0] and row box[0, 1] to box[1, 0] and box[1, 1]: the stage under
    the bodies' shadows."""
    ti.loop_config(block_dim=8)
    for y in range(box[0, 1], box[1, 1]):
        for c in range(box[0, 0], box[1, 0]):
            depth, shade = stage_depths[y, c], vec3(1.0)
            if depth < FAR:
                p = row(view, EYE) + ray(view, float(c), float(y)) * depth
                shade = light_at(grid, light, p)
                if shade.min() < 1.0:
                    shade = ti.math.mix(shade, vec3(1.0), haze(studio, p))
            depths[y, c] = depth
            for k in ti.static(range(3)):
                scene[y, c, k] = stage_colors[y, c, k] * shade[k]
