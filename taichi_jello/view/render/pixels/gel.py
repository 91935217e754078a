"""Shading of one translucent body over the picture of all that is behind it.

Light is bent where it enters and leaves, absorbed by the length of its way inside (Beer and Lambert), reflected as
Schlick says, and scattered a little. The way inside comes from the body's nearest and farthest surface in the picture,
as Wyman (2005) does it; fluids are drawn so by van der Laan, Green and Sainz (2009). `gel`, (3, 3) float32: absorption
[1/m]; the colour of scattered light; (size [m], thickness of a sheet [m], how far the surface may lie behind what hides
it [m]).
"""

import numpy as np
import taichi as ti

from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.rows import Array2, Colors, Counts, Depths, Index1, Index2, Keys, row, vec3
from taichi_jello.view.render.pixels.buffers import (
    EYE,
    FAR,
    UNIT,
    depth_of,
    mean_at,
    number_of,
    on_screen,
    ray,
    shares,
    smooth_normal,
)
from taichi_jello.view.render.pixels.studio import (
    AMBIENT,
    INDEX,
    MIDDLE,
    around,
    diffuse,
    floor_way,
    lamps,
    schlick,
)

CLEAR_AT = 0.55  # of a body's size: the way on which light takes on the body's colour
PALEST, DARKEST = 0.94, 0.02  # of a colour's channels
CLOUDY = 2.2  # 1/size: how fast scattered light reaches its full colour
GRAZING = 0.03  # the least cosine between a ray and a normal
CLOTH = 0.2  # what a sheet reflects, of what the smooth surface of a solid does
FAINTEST = 0.01  # the part of the light that a ray is followed for
GLOWING, FAINT = 0.46, 0.008  # scattered light, of the body's colour, and for any
ABSORPTION, GLOW, SIZES = 0, 1, 2  # rows of `gel`


def gel_of(rgb: np.ndarray, size: float, sheet: float, behind: float) -> np.ndarray:
    """(3, 3) float32 of a body with the display colour rgb (3,)."""
    linear = np.asarray(rgb, float) ** palette.GAMMA
    absorption = -np.log(linear.clip(DARKEST, PALEST)) / (CLEAR_AT * size)
    return np.array([absorption, GLOWING * linear + FAINT, [size, sheet, behind]], np.float32)


@ti.func
def tinted(gel: ti.template(), rgb):
    """`gel` with the linear colour rgb, as `gel_of` makes it."""
    sizes = row(gel, SIZES)
    absorption = -ti.log(ti.math.clamp(rgb, DARKEST, PALEST)) / (CLEAR_AT * sizes[0])
    return ti.Matrix.rows([absorption, GLOWING * rgb + FAINT, sizes])


@ti.func
def refracted(d, n, ratio):
    """(direction, 1) behind a surface whose normal n faces against d, or (mirrored direction, 0) where all light is
    reflected; ratio: of the indices, before to behind."""
    facing = -d.dot(n)
    rest = 1.0 - ratio * ratio * (1.0 - facing * facing)
    out = ratio * d + (ratio * facing - ti.sqrt(ti.max(rest, 0.0))) * n
    if rest < 0.0:
        out = d + 2.0 * facing * n
    return ti.Vector([out[0], out[1], out[2], ti.select(rest < 0.0, 0.0, 1.0)])


@ti.func
def pixel_at(place, depths: ti.template()):
    """(row, column, 1) of the pixel at a place on the screen, the nearest one and 0 beyond the picture's edges."""
    y, x = int(ti.floor(ti.math.clamp(place[1], -1.0, 1e6))), int(ti.floor(ti.math.clamp(place[0], -1.0, 1e6)))
    inside = y >= 0 and x >= 0 and y < depths.shape[0] and x < depths.shape[1]
    y, x = ti.math.clamp(y, 0, depths.shape[0] - 1), ti.math.clamp(x, 0, depths.shape[1] - 1)
    return ti.Vector([y, x, int(inside)])


@ti.func
def behind(view: ti.template(), studio: ti.template(), q, d, reach, scene: ti.template(), depths: ti.template()):
    """What is seen from q along d, a thing or a piece of floor, if the picture shows it; else -1 in all channels."""
    here, way, color = on_screen(view, q), floor_way(studio, q, d), vec3(-1.0)
    at = pixel_at(here, depths)
    gap = ti.math.clamp(depths[at[0], at[1]] - here[2], 0.0, reach)
    lowest = row(studio, MIDDLE)[1] + 0.01 * reach
    for attempt in range(2):  # first a thing about as far as what is just behind q, then the floor
        step = ti.select(attempt == 0, gap, way)
        if color[0] < 0.0 and step >= 0.0:
            at = pixel_at(on_screen(view, q + d * step), depths)
            depth = depths[at[0], at[1]]
            height = view[EYE, 1] + ray(view, float(at[1]), float(at[0]))[1] * depth
            thing = depth < FAR and depth > here[2] - 0.1 * reach and height > lowest
            if at[2] == 1 and ((attempt == 0 and thing) or (attempt == 1 and depth > here[2])):
                color = vec3(scene[at[0], at[1], 0], scene[at[0], at[1], 1], scene[at[0], at[1], 2])
    return color


@ti.func
def scattered(gel: ti.template(), studio: ti.template(), p, n, way):
    """Light that the body scatters towards the eye after a way inside: more where it is thick and where lamps shine
    into it, from before or through it from behind."""
    size = row(gel, SIZES)[0]
    lit = 0.6 * diffuse(studio, p, n, 0.9) + AMBIENT * (0.9 + 0.25 * n[1])
    return row(gel, GLOW) * lit * (1.0 - ti.exp(-CLOUDY / size * way))


@ti.func
def turned(n, d):
    """The normal n turned, where it has to be, to face against d: a smooth normal may turn away where its triangle does
    not."""
    facing = -d.dot(n)
    return ti.select(facing < GRAZING, (n + (GRAZING - facing) * -d).normalized(1e-20), n)


@ti.func
def way_inside(
    view: ti.template(), run: ti.template(), back: ti.template(), thick: ti.template(), y, c, toward, straight
):
    """(length [m], row, column): how far light that pixel (y, c) shows has come through the body, and the pixel in
    which it entered. straight: (length straight on, its length in a unit of depth, the body's size). toward: where a
    ray bent by the surface would be after a guess of its length."""
    at = pixel_at(on_screen(view, toward), thick)
    found = vec3(straight[0], float(y), float(c))
    if at[0] >= run[3] and at[0] < run[5] and at[1] >= run[2] and at[1] < run[4]:
        there = ti.max(thick[at[0], at[1]] * UNIT, 0.0) * straight[1]
        found[0] = 0.5 * (straight[0] + ti.min(there, straight[0] + 0.5 * straight[2]))
        if back[at[0], at[1]] >= 0:
            found[1], found[2] = float(at[0]), float(at[1])
    return found


@ti.func
def inner_normal(view: ti.template(), x: ti.template(), normal: ti.template(), faces: ti.template(), key, y, c, d):
    """The normal that faces against d at the far side of a body, of the triangle in `key` as pixel (y, c) sees it."""
    n = -d
    if key >= 0:
        t = number_of(key)
        n = -smooth_normal(normal, faces, t, shares(view, x, faces, t, ray(view, c, y)))
    return turned(n, d)


@ti.func
def lit(
    view: ti.template(),
    studio: ti.template(),
    gel: ti.template(),
    scene: ti.template(),
    depths: ti.template(),
    d,
    p,
    n,
    inner,
    q,
    m,
):
    """The colour of a body seen along d: light enters or is reflected at p, where its normal is n, goes along `inner`
    inside, and leaves at q or is reflected there, where the normal is m."""
    glossy = schlick(-d.dot(n)) * ti.select(gel[SIZES, 1] > 0.0, CLOTH, 1.0)
    length = (q - p).norm()
    passed = ti.exp(-row(gel, ABSORPTION) * length)
    leaving = refracted(inner, m, INDEX)
    out = vec3(leaving[0], leaving[1], leaving[2])
    kept = ti.select(leaving[3] > 0.5, schlick(-out.dot(m)), 1.0)  # reflected inside
    color = (1.0 - glossy) * scattered(gel, studio, p, n, length)
    for k in range(3):  # what is reflected outside, passes straight through, and is reflected inside
        start, toward, weight = p, d - 2.0 * d.dot(n) * n, vec3(glossy)
        if k == 1:
            start, toward, weight = q, out, (1.0 - glossy) * (1.0 - kept) * passed
        elif k == 2:
            start, toward, weight = q, inner - 2.0 * inner.dot(m) * m, (1.0 - glossy) * kept * passed * passed
        if weight.max() > FAINTEST:
            light = vec3(-1.0)
            if k == 1:
                reach = ti.max(1.5 * gel[SIZES, 0], 12.0 * gel[SIZES, 2])
                light = behind(view, studio, start, toward, reach, scene, depths)
            if light[0] < 0.0:
                soft = ti.select(k == 0, 0.12, 0.3)
                light = around(studio, start, toward, 0.03, vec3(1.0)) + lamps(studio, start, toward, soft)
            color += weight * light
    return color


@ti.kernel
def shade(
    view: Array2,
    studio: Array2,
    gel: Array2,
    varied: ti.i32,
    x: Array2,
    normal: Array2,
    tint: Array2,
    faces: Index2,
    run: Index1,
    front: Keys,
    back: Keys,
    thick: Counts,
    scene: Colors,
    depths: Depths,
    shaded: Colors,
):
    """The colours `shaded` of the pixels of `run` (see `layers`) in which a body is nearest; `scene` and `depths` show
    what is behind it. The first channel is -1 where the body is not seen. A body that is `varied` has the mean of the
    linear colours `tint` of its points where light enters and leaves."""
    ti.loop_config(block_dim=4)
    for y in range(run[3], run[5]):
        for c in range(run[2], run[4]):
            depth, sizes = depth_of(front[y, c]), row(gel, SIZES)
            shaded[y, c, 0] = -1.0
            if depth < FAR and depth < depths[y, c] + sizes[2]:
                way, t = ray(view, float(c), float(y)), number_of(front[y, c])
                long = way.norm()
                d, p = way / long, row(view, EYE) + way * depth
                share = shares(view, x, faces, t, way)
                n = turned(smooth_normal(normal, faces, t, share), d)
                bent = refracted(d, n, 1.0 / INDEX)
                inner = vec3(bent[0], bent[1], bent[2])
                straight = ti.math.clamp(thick[y, c] * UNIT, 0.0, ti.max(depths[y, c] - depth, 0.0)) * long
                guess = p + inner * (straight + 0.25 * sizes[0] * (1.0 + d.dot(n)))
                inside = way_inside(view, run, back, thick, y, c, guess, vec3(straight, long, sizes[0]))
                q = p + inner * ti.max(inside[0], sizes[1] / ti.max(-inner.dot(n), 0.3))
                leave = back[int(inside[1]), int(inside[2])]
                m = inner_normal(view, x, normal, faces, leave, inside[1], inside[2], inner)
                own = ti.Matrix.rows([row(gel, k) for k in ti.static(range(3))])
                if varied:
                    rgb = mean_at(tint, faces, t, share)
                    if leave >= 0:
                        far = number_of(leave)
                        there = shares(view, x, faces, far, ray(view, inside[2], inside[1]))
                        rgb = 0.5 * (rgb + mean_at(tint, faces, far, there))
                    own = tinted(own, rgb)
                color = lit(view, studio, own, scene, depths, d, p, n, inner, q, m)
                for k in ti.static(range(3)):
                    shaded[y, c, k] = color[k]


@ti.kernel
def settle(run: Index1, front: Keys, shaded: Colors, scene: Colors, depths: Depths):
    """Make the body that was shaded a part of the picture."""
    ti.loop_config(block_dim=16)
    for y in range(run[3], run[5]):
        for x in range(run[2], run[4]):
            if shaded[y, x, 0] >= 0.0:
                depths[y, x] = ti.min(depths[y, x], depth_of(front[y, x]))
                for k in ti.static(range(3)):
                    scene[y, x, k] = shaded[y, x, k]
