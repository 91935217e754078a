"""The studio around every scene, as formulas: a checkered floor that ends in haze, a sky, two soft lamps.

`studio`, (10, 3) float32, is made by `studio_of`. Colours are linear radiances; 1 is a white that the picture just
holds. p is a point [m], d a direction of length 1.
"""

import numpy as np
import taichi as ti
from taichi.math import clamp, mix, smoothstep

from taichi_jello.view.drawing.rows import row, vec3

LOW = 0.2  # the sine of the height at which the sky is about half of its lower colour and half of its upper one
NADIR = 0.73  # what comes from below where there is no floor, of what comes from the horizon
DARKER = np.array([0.786, 0.807, 0.833])  # every other tile of a checkered floor, of the others
AMBIENT = vec3(0.42, 0.45, 0.50)  # what the whole sky adds to a surface that faces up, of its albedo
LAMP = vec3(1.0, 0.985, 0.96)
GLARE = 10.0  # the radiance of the first lamp, seen in reflections
SECOND = 0.55  # the second lamp's, of the first one's
LIT = 1.2  # what the lamps add to the floor just below the first one, of its albedo
INDEX = 1.35  # of refraction: gelatine with much water
FACING = ((INDEX - 1.0) / (INDEX + 1.0)) ** 2  # reflected at a right angle
HAZE = (1.1, 4.2)  # of the studio's size, from its middle: where the floor begins and ends to fade

MIDDLE, SIZE, LAMPS, HALVES, TILES, ZENITH, HORIZON = 0, 1, 2, 4, 6, 8, 9  # rows of `studio`


def studio_of(middle: np.ndarray, size: float, floor: float | None, colors: np.ndarray) -> np.ndarray:
    """(10, 3) float32: the middle of the floor; (size, side of a tile, 1 if there is a floor) [m]; the middles of two
    lamps, that hang level, and halves of their sides; linear `colors` (4, 3): of two tiles, zenith and horizon."""
    tile = size / 12.0
    step = 10.0 ** np.floor(np.log10(tile))
    tile = step * min((1.0, 2.0, 2.5, 5.0, 10.0), key=lambda n: abs(n * step - tile))
    base = np.array([middle[0], middle[1] - 0.2 * size if floor is None else floor, middle[2]])
    lamps = base + size * np.array([[-0.22, 0.64, -0.55], [-0.55, 0.85, 0.45]])
    halves = size * np.array([[0.34, 0.0, 0.26], [0.17, 0.0, 0.21]])
    return np.array([base, [size, tile, float(floor is not None)], *lamps, *halves, *colors], np.float32)


@ti.func
def schlick(cosine):
    """The part of the light that a surface reflects (Schlick 1994)."""
    grazing = 1.0 - clamp(cosine, 0.0, 1.0)
    square = grazing * grazing
    return FACING + (1.0 - FACING) * square * square * grazing


@ti.func
def sky(studio: ti.template(), d):
    level = row(studio, HORIZON)
    high = ti.max(d[1], 0.0)
    up = mix(level, row(studio, ZENITH), high * (1.0 + LOW) / (high + LOW))
    return ti.select(d[1] >= 0.0, up, mix(level, NADIR * level, smoothstep(0.0, 0.6, -d[1])))


@ti.func
def lamps(studio: ti.template(), p, d, blur):
    """The radiance of the lamps that a ray from p meets; their edges are as soft as `blur`, of half their sides."""
    light = 0.0
    if d[1] > 1e-3:
        for k in ti.static(range(2)):
            middle, half = row(studio, LAMPS + k), row(studio, HALVES + k)
            at = ti.abs(p + d * ((middle[1] - p[1]) / d[1]) - middle)
            reach = (1.0 + blur) * half
            if at[0] < reach[0] and at[2] < reach[2]:
                edge = ti.max(at[0] / half[0], at[2] / half[2])
                light += (1.0 - smoothstep(1.0 - blur, 1.0 + blur, edge)) * ti.static((1.0, SECOND)[k])
    return GLARE * light * LAMP


@ti.func
def diffuse(studio: ti.template(), p, n, wrap):
    """What the lamps add to a surface at p with the normal n, of its albedo; wrap: how far the light reaches around."""
    light = 0.0
    for k in ti.static(range(2)):
        middle = row(studio, LAMPS + k)
        way, high = middle - p, middle[1] - row(studio, MIDDLE)[1]
        away = way.norm(1e-9)
        facing = ti.max(n.dot(way) / away + wrap, 0.0) / (1.0 + wrap)
        down = clamp(way[1] / away, 0.0, 1.0)
        light += facing * down * (high / away) ** 2 * ti.static((1.0, SECOND)[k])
    return LIT * light * LAMP


@ti.func
def floor_light(studio: ti.template(), q):
    """What the lamps add to the floor at q, of its albedo: `diffuse` for a normal that points up, without roots."""
    light = 0.0
    for k in ti.static(range(2)):
        way = row(studio, LAMPS + k) - q
        upright = way[1] * way[1] / way.norm_sqr()
        light += upright * upright * ti.static((1.0, SECOND)[k])
    return LIT * light * LAMP


@ti.func
def wave(at, sharp):
    """1 and -1 on the tiles in turn, smoothed over 1 / sharp tiles."""
    return clamp((4.0 * ti.abs(0.5 * at - ti.floor(0.5 * at) - 0.5) - 1.0) * sharp, -1.0, 1.0)


@ti.func
def tiles(studio: ti.template(), p, blur):
    """The floor's albedo at p; blur: the width [m] over which a ray there takes its mean."""
    side = row(studio, SIZE)[1]
    soft = blur / side
    sharp = 1.0 / ti.max(soft, 1e-4)
    check = wave(p[0] / side, sharp) * wave(p[2] / side, sharp) * (1.0 - smoothstep(0.4, 1.6, soft))
    return mix(row(studio, TILES + 1), row(studio, TILES), 0.5 + 0.5 * check)


@ti.func
def floor_way(studio: ti.template(), p, d):
    """How far [m] the floor is from p along d; below zero if the ray never meets it."""
    way, has = ti.f32(-1.0), row(studio, SIZE)[2]
    if has > 0.5 and d[1] < -1e-5 and p[1] > row(studio, MIDDLE)[1] - 1e-3:
        way = ti.max((row(studio, MIDDLE)[1] - p[1]) / d[1], 0.0)
    return way


@ti.func
def haze(studio: ti.template(), q):
    """How much of the floor at q is lost in the haze, 0 to 1."""
    size, away = row(studio, SIZE)[0], q - row(studio, MIDDLE)
    far = ti.sqrt(away[0] * away[0] + away[2] * away[2])
    lost = ti.f32(0.0)
    if far > HAZE[0] * size:
        lost = smoothstep(HAZE[0], HAZE[1], far / size)
    return lost


@ti.func
def around(studio: ti.template(), p, d, blur, shade):
    """The radiance that reaches p against the direction d, without lamps. blur: the angle of the ray's cone; shade:
    what shadows leave of the light on the floor."""
    color, way = row(studio, HORIZON), floor_way(studio, p, d)
    if way < 0.0:
        color = sky(studio, d)
    else:
        q = p + d * way
        lost = haze(studio, q)
        if lost < 1.0:
            wide = blur * way / ti.max(ti.sqrt(-d[1]), 0.05)
            lit = tiles(studio, q, wide) * (AMBIENT + floor_light(studio, q)) * shade
            color = mix(lit, row(studio, HORIZON), lost)
    return color
