"""Light, as Taichi functions that every drawing kernel bakes into its vertex colours.

`look` is the camera as a kernel sees it: a (5, 3) float32 array made by `look_from`.
"""

import numpy as np
import taichi as ti

from taichi_jello.view import palette
from taichi_jello.view.camera import NEAR, Viewpoint

Array1 = ti.types.ndarray(dtype=ti.f32, ndim=1)
Array2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
Index1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
Index2 = ti.types.ndarray(dtype=ti.i32, ndim=2)
vec3 = ti.types.vector(3, ti.f32)
vec4 = ti.types.vector(4, ti.f32)

KEY = vec3(*palette.KEY_LIGHT)
FLOOR, SOLID = vec3(*palette.GROUND), vec3(*palette.OBSTACLE)
SKY_TOP, SKY_LOW = vec3(*palette.SKY_TOP), vec3(*palette.SKY_LOW)
NEAREST = NEAR * 1.02  # a clipped end stays just in front of the plane, whatever the rounding
TOWARDS_EYE = 0.004  # lines are drawn this much nearer, so that the surface they lie on does not hide them


def look_from(viewpoint: Viewpoint) -> np.ndarray:
    """(5, 3) float32: eye, right, up, forward, and (focal length, 0, 0)."""
    right, up, back = viewpoint.axes()
    focal = 1.0 / np.tan(np.radians(viewpoint.fov) / 2.0)
    return np.array([viewpoint.eye, right, up, -back, [focal, 0.0, 0.0]], np.float32)


@ti.func
def row(a: ti.template(), i):
    return vec3(a[i, 0], a[i, 1], a[i, 2])


@ti.func
def put(a: ti.template(), i, value):
    for k in ti.static(range(3)):
        a[i, k] = value[k]


@ti.func
def smooth(low, high, value):
    t = ti.math.clamp((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


@ti.func
def backdrop(p, look: ti.template()):
    """The colour of the picture's background behind the point p."""
    d = p - row(look, 0)
    depth = ti.max(d.dot(row(look, 3)), NEAREST)
    height = 0.5 + 0.5 * look[4, 0] * d.dot(row(look, 2)) / depth
    return ti.math.mix(SKY_LOW, SKY_TOP, ti.math.clamp(height, 0.0, 1.0))


@ti.func
def ground(albedo, p, n, look: ti.template(), reach):
    """An even floor under a soft sky; fades into the background before it ends `reach` [m] from the
    origin."""
    light = 0.80 + 0.20 * ti.max(n.dot(KEY), 0.0) / KEY[1]
    fade = smooth(0.22 * reach, 0.96 * reach, ti.sqrt(p[0] * p[0] + p[2] * p[2]))
    return ti.math.mix(albedo * light, backdrop(p, look), fade)


@ti.func
def gloss(n, to_eye, sharpness):
    """The lamp's reflection (Blinn)."""
    half = (to_eye + KEY).normalized()
    return ti.pow(ti.max(n.dot(half), 0.0), sharpness)


@ti.func
def matte(albedo, p, n, look: ti.template()):
    """A satin solid: soft sky from above, lamp, a pale rim."""
    to_eye = (row(look, 0) - p).normalized()
    facing = ti.max(n.dot(to_eye), 0.0)
    sky = 0.62 + 0.18 * n[1]
    lamp = 0.36 * ti.max((n.dot(KEY) + 0.25) / 1.25, 0.0)
    rim = 0.16 * ti.pow(1.0 - facing, 3.0)
    return ti.min(albedo * (sky + lamp) + rim + 0.22 * gloss(n, to_eye, 40.0), 1.0)


@ti.func
def gel(albedo, p, n, look: ti.template()):
    """(rgb, alpha) of a translucent skin: clear where it is seen face on, dense and bright towards its edges.

    The inner side, seen through the body, is darker and more saturated, as light there crossed more of the
    gel.
    """
    to_eye = (row(look, 0) - p).normalized()
    facing = n.dot(to_eye)
    outside = facing > 0.0
    edge = ti.pow(1.0 - ti.min(ti.abs(facing), 1.0), 2.5)
    wrapped = ti.max((n.dot(KEY) + 0.55) / 1.55, 0.0)
    body = albedo * (0.66 + 0.42 * wrapped) + 0.10 * wrapped
    alpha = 0.30 + 0.45 * edge
    shine = 0.55 * gloss(n, to_eye, 36.0) + 0.20 * edge
    if not outside:
        deep = albedo * albedo * 0.35 + albedo * 0.55
        body = deep * (0.85 + 0.25 * ti.max(-n.dot(KEY), 0.0))
        alpha = 0.34 + 0.20 * edge
        shine = 0.10 * gloss(-n, to_eye, 20.0)
    # A reflection is added light: over the body it blends to the same as one layer of this colour and alpha.
    shine = ti.math.clamp(shine, 0.0, 1.0)
    total = 1.0 - (1.0 - alpha) * (1.0 - shine)
    color = (body * alpha * (1.0 - shine) + shine) / total
    return vec4(ti.min(color, 1.0), total)


@ti.kernel
def paint(
    points: Array2, normal: Array2, solid: Index1, tint: Array2, amount: Array1, look: Array2, reach: ti.f32,
    lift: ti.f32, x: Array2, rgba: Array2,
):  # fmt: skip
    """Shade points of colliders: floors where solid is 0, obstacles where it is 1, mixed with `amount` of a
    tint.

    They are drawn `lift` of their distance nearer to the eye: what lies on a floor must not vanish in it."""
    ti.loop_config(block_dim=256)
    for i in range(points.shape[0]):
        p, n = row(points, i), row(normal, i)
        put(x, i, p + (row(look, 0) - p) * lift)
        color = vec3(0.0)
        if solid[i] == 1:  # noqa: SIM108 - Taichi would evaluate both sides of a conditional expression
            color = matte(SOLID, p, n, look)
        else:
            color = ground(FLOOR, p, n, look, reach)
        put(rgba, i, color + (row(tint, 0) - color) * amount[i])


def clip(ends: np.ndarray, look: np.ndarray, lift: float) -> None:
    """Shorten segments, in place, to their part before the eye; one behind it becomes a point.

    ends (2L, 3) float32 are also moved `lift` of their distance nearer along the line of sight, which leaves
    their places in the picture unchanged."""
    eye, forward = look[0], look[3]
    ends += (eye - ends) * np.float32(lift)
    depth = ((ends - eye) @ forward).reshape(-1, 2)
    for near, far in ((0, 1), (1, 0)):
        cut = np.flatnonzero(depth[:, near] < NEAREST)
        if len(cut):
            p, q = ends[2 * cut + near], ends[2 * cut + far]
            reach = np.maximum(depth[cut, far] - depth[cut, near], 1e-9)
            t = np.clip((NEAREST - depth[cut, near]) / reach, 0.0, 1.0)
            ends[2 * cut + near] = p + (q - p) * t[:, None]
