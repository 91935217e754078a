"""Lighting of vertices. `camera` is the array of `camera_rows`, p a point, n a unit normal."""

import numpy as np
import taichi as ti
from taichi.math import clamp, mix, smoothstep

from taichi_jello.scene.description import Scene
from taichi_jello.view.camera import NEAR, Viewpoint
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.rows import row, vec3

KEY = vec3(*palette.KEY_LIGHT)
EYE, RIGHT, UP, FORWARD, LENS, FLOOR, SKY_TOP, SKY_LOW = range(8)  # rows of a camera
FOCAL = 0  # column of LENS
REACH = 11.0  # m; an infinite plane is drawn this far from the origin
MIN_DEPTH = NEAR * 1.02  # m; a clipped end stays in front of the near plane despite rounding
LINE_LIFT = 0.004  # of their distance; lines are drawn nearer, or the surface they lie on would hide them


def camera_rows(viewpoint: Viewpoint, scene: Scene) -> np.ndarray:
    """(8, 3) float32: EYE [m], RIGHT, UP, FORWARD; LENS, which holds the focal length; colours of FLOOR and sky."""
    right, up, back = viewpoint.axes()
    focal = 1.0 / np.tan(np.radians(viewpoint.fov) / 2.0)
    colors = palette.ground(scene), scene.background.top, scene.background.bottom
    return np.array([viewpoint.eye, right, up, -back, [focal, 0.0, 0.0], *colors], np.float32)


@ti.func
def backdrop(p, camera: ti.template()):
    """The colour of the picture's background behind the point p."""
    d = p - row(camera, EYE)
    depth = ti.max(d.dot(row(camera, FORWARD)), MIN_DEPTH)
    height = 0.5 + 0.5 * camera[LENS, FOCAL] * d.dot(row(camera, UP)) / depth
    return mix(row(camera, SKY_LOW), row(camera, SKY_TOP), clamp(height, 0.0, 1.0))


@ti.func
def ground(p, n, camera: ti.template()):
    """A floor under a soft sky; it fades into the background before it ends REACH [m] from the origin."""
    light = 0.80 + 0.20 / KEY[1] * ti.max(n.dot(KEY), 0.0)
    fade = smoothstep(0.22 * REACH, 0.96 * REACH, ti.sqrt(p[0] * p[0] + p[2] * p[2]))
    return mix(row(camera, FLOOR) * light, backdrop(p, camera), fade)


@ti.func
def gloss(n, to_eye, sharpness):
    """Blinn's specular reflection of the lamp."""
    return ti.max(n.dot((to_eye + KEY).normalized(1e-20)), 0.0) ** sharpness


@ti.func
def matte(albedo, p, n, camera: ti.template()):
    """A satin solid under a soft sky, with the lamp and a pale rim."""
    to_eye = (row(camera, EYE) - p).normalized(1e-20)
    sky = 0.62 + 0.18 * n[1]
    lamp = 0.36 * ti.max((n.dot(KEY) + 0.25) / 1.25, 0.0)
    rim = 0.16 * (1.0 - ti.max(n.dot(to_eye), 0.0)) ** 3
    return ti.min(albedo * (sky + lamp) + rim + 0.22 * gloss(n, to_eye, 40.0), 1.0)


@ti.func
def gel(albedo, p, n, camera: ti.template()):
    """Colour and alpha of a translucent skin: clear where it faces the eye, dense and bright at its silhouette. The
    inner side is darker and more saturated: its light has crossed more gel."""
    to_eye = (row(camera, EYE) - p).normalized(1e-20)
    facing, lit = n.dot(to_eye), n.dot(KEY)
    edge = (1.0 - ti.min(ti.abs(facing), 1.0)) ** 2.5
    wrapped = ti.max((lit + 0.55) / 1.55, 0.0)
    color = albedo * (0.66 + 0.42 * wrapped) + 0.10 * wrapped
    alpha, shine = 0.30 + 0.45 * edge, 0.55 * gloss(n, to_eye, 36.0) + 0.20 * edge
    if facing <= 0.0:
        color = albedo * (0.35 * albedo + 0.55) * (0.85 + 0.25 * ti.max(-lit, 0.0))
        alpha, shine = 0.34 + 0.20 * edge, 0.10 * gloss(-n, to_eye, 20.0)
    shine = clamp(shine, 0.0, 1.0)
    # Blending the gel and then adding the reflection equals one layer of this colour and alpha.
    total = 1.0 - (1.0 - alpha) * (1.0 - shine)
    color = ti.min((color * alpha * (1.0 - shine) + shine) / total, 1.0)
    return ti.Vector([color[0], color[1], color[2], total])


def clip(ends: np.ndarray, camera: np.ndarray) -> None:
    """Clip segments, in place, at the near plane; one behind it shrinks to a point.
    ends (2L, 3) float32 also move LINE_LIFT of their distance towards the eye, which leaves their pixels unchanged."""
    eye, forward = camera[EYE], camera[FORWARD]
    ends += (eye - ends) * np.float32(LINE_LIFT)
    depth = ((ends - eye) @ forward).reshape(-1, 2)
    for near, far in ((0, 1), (1, 0)):
        cut = np.flatnonzero(depth[:, near] < MIN_DEPTH)
        if len(cut):
            p, q = ends[2 * cut + near], ends[2 * cut + far]
            span = np.maximum(depth[cut, far] - depth[cut, near], 1e-9)
            t = np.clip((MIN_DEPTH - depth[cut, near]) / span, 0.0, 1.0)
            ends[2 * cut + near] = p + (q - p) * t[:, None]
