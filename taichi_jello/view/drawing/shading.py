"""Light, baked into the colours of vertices.

`look` is the camera: a (5, 3) float32 array made by `look_from`. p is a point, n a unit normal.
"""

import numpy as np
import taichi as ti
from taichi.math import clamp, mix, smoothstep

from taichi_jello.view.camera import NEAR, Viewpoint
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.rows import row, vec3

KEY, FLOOR, SOLID, SKY_TOP, SKY_LOW = (
    vec3(*color) for color in (palette.KEY_LIGHT, palette.GROUND, palette.OBSTACLE, palette.SKY_TOP, palette.SKY_LOW)
)
REACH = 11.0  # m; an endless plane is drawn this far from the origin
NEAREST = NEAR * 1.02  # a clipped end stays just in front of the plane, whatever the rounding
TOWARDS_EYE = 0.004  # lines are drawn this much nearer, so that the surface they lie on does not hide them


def look_from(viewpoint: Viewpoint) -> np.ndarray:
    """(5, 3) float32: eye, right, up, forward, and (focal length, 0, 0)."""
    right, up, back = viewpoint.axes()
    focal = 1.0 / np.tan(np.radians(viewpoint.fov) / 2.0)
    return np.array([viewpoint.eye, right, up, -back, [focal, 0.0, 0.0]], np.float32)


@ti.func
def backdrop(p, look: ti.template()):
    """The colour of the picture's background behind the point p."""
    d = p - row(look, 0)
    depth = ti.max(d.dot(row(look, 3)), NEAREST)
    height = 0.5 + 0.5 * look[4, 0] * d.dot(row(look, 2)) / depth
    return mix(SKY_LOW, SKY_TOP, clamp(height, 0.0, 1.0))


@ti.func
def ground(p, n, look: ti.template()):
    """An even floor under a soft sky; fades into the background before it ends REACH [m] from the origin."""
    light = 0.80 + 0.20 / KEY[1] * ti.max(n.dot(KEY), 0.0)
    fade = smoothstep(0.22 * REACH, 0.96 * REACH, ti.sqrt(p[0] * p[0] + p[2] * p[2]))
    return mix(FLOOR * light, backdrop(p, look), fade)


@ti.func
def gloss(n, to_eye, sharpness):
    """The lamp's reflection (Blinn)."""
    return ti.max(n.dot((to_eye + KEY).normalized(1e-20)), 0.0) ** sharpness


@ti.func
def matte(p, n, look: ti.template()):
    """A satin solid: soft sky from above, lamp, a pale rim."""
    to_eye = (row(look, 0) - p).normalized(1e-20)
    sky = 0.62 + 0.18 * n[1]
    lamp = 0.36 * ti.max((n.dot(KEY) + 0.25) / 1.25, 0.0)
    rim = 0.16 * (1.0 - ti.max(n.dot(to_eye), 0.0)) ** 3
    return ti.min(SOLID * (sky + lamp) + rim + 0.22 * gloss(n, to_eye, 40.0), 1.0)


@ti.func
def gel(albedo, p, n, look: ti.template()):
    """Colour and alpha of a translucent skin: clear where it is seen face on, dense and bright towards its edges.

    The inner side, seen through the body, is darker and more saturated, as light there crossed more of the
    gel.
    """
    to_eye = (row(look, 0) - p).normalized(1e-20)
    facing, lit = n.dot(to_eye), n.dot(KEY)
    edge = (1.0 - ti.min(ti.abs(facing), 1.0)) ** 2.5
    wrapped = ti.max((lit + 0.55) / 1.55, 0.0)
    color = albedo * (0.66 + 0.42 * wrapped) + 0.10 * wrapped
    alpha, shine = 0.30 + 0.45 * edge, 0.55 * gloss(n, to_eye, 36.0) + 0.20 * edge
    if facing <= 0.0:
        color = albedo * (0.35 * albedo + 0.55) * (0.85 + 0.25 * ti.max(-lit, 0.0))
        alpha, shine = 0.34 + 0.20 * edge, 0.10 * gloss(-n, to_eye, 20.0)
    shine = clamp(shine, 0.0, 1.0)
    # A reflection is added light: over the body it blends to the same as one layer of this colour and alpha.
    total = 1.0 - (1.0 - alpha) * (1.0 - shine)
    color = ti.min((color * alpha * (1.0 - shine) + shine) / total, 1.0)
    return ti.Vector([color[0], color[1], color[2], total])


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
