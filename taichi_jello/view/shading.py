"""Light, baked into the colours of vertices.

`look` is the camera: a (5, 3) float32 array made by `look_from`. Points p, normals n and colours are (n, 3)
float32.
"""

import numpy as np

from taichi_jello.view import palette
from taichi_jello.view.camera import NEAR, Viewpoint

KEY = palette.KEY_LIGHT.astype(np.float32)
FLOOR, SOLID = palette.GROUND.astype(np.float32), palette.OBSTACLE.astype(np.float32)
SKY_TOP, SKY_LOW = palette.SKY_TOP.astype(np.float32), palette.SKY_LOW.astype(np.float32)
NEAREST = NEAR * 1.02  # a clipped end stays just in front of the plane, whatever the rounding
TOWARDS_EYE = 0.004  # lines are drawn this much nearer, so that the surface they lie on does not hide them


def look_from(viewpoint: Viewpoint) -> np.ndarray:
    """(5, 3) float32: eye, right, up, forward, and (focal length, 0, 0)."""
    right, up, back = viewpoint.axes()
    focal = 1.0 / np.tan(np.radians(viewpoint.fov) / 2.0)
    return np.array([viewpoint.eye, right, up, -back, [focal, 0.0, 0.0]], np.float32)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n, 1): row by row."""
    return np.einsum("ij,ij->i", a, b)[:, None]


def unit(a: np.ndarray) -> np.ndarray:
    """Each row at length 1; zero stays zero."""
    return a / np.maximum(np.sqrt(dot(a, a)), np.float32(1e-20))


def mix(a: np.ndarray, b: np.ndarray, t: np.ndarray) -> np.ndarray:
    return a + (b - a) * t


def smooth(low: float, high: float, value: np.ndarray) -> np.ndarray:
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def backdrop(p: np.ndarray, look: np.ndarray) -> np.ndarray:
    """The colour of the picture's background behind the points p."""
    d = p - look[0]
    depth = np.maximum(d @ look[3], np.float32(NEAREST))
    height = 0.5 + 0.5 * look[4, 0] * (d @ look[2]) / depth
    return mix(SKY_LOW, SKY_TOP, np.clip(height, 0.0, 1.0)[:, None])


def ground(p: np.ndarray, n: np.ndarray, look: np.ndarray, reach: float) -> np.ndarray:
    """An even floor under a soft sky; fades into the background before it ends `reach` [m] from the
    origin."""
    light = 0.80 + (0.20 / KEY[1]) * np.maximum(n @ KEY, 0.0)
    fade = smooth(0.22 * reach, 0.96 * reach, np.hypot(p[:, 0], p[:, 2]))
    return mix(FLOOR * light[:, None], backdrop(p, look), fade[:, None])


def gloss(n: np.ndarray, to_eye: np.ndarray, sharpness: float) -> np.ndarray:
    """(n, 1): the lamp's reflection (Blinn)."""
    return np.maximum(dot(n, unit(to_eye + KEY)), 0.0) ** np.float32(sharpness)


def matte(p: np.ndarray, n: np.ndarray, look: np.ndarray) -> np.ndarray:
    """A satin solid: soft sky from above, lamp, a pale rim."""
    to_eye = unit(look[0] - p)
    sky = 0.62 + 0.18 * n[:, 1:2]
    lamp = 0.36 * np.maximum(((n @ KEY)[:, None] + 0.25) / 1.25, 0.0)
    rim = 0.16 * (1.0 - np.maximum(dot(n, to_eye), 0.0)) ** 3
    return np.minimum(SOLID * (sky + lamp) + rim + 0.22 * gloss(n, to_eye, 40.0), 1.0)


def gel(albedo: np.ndarray, p: np.ndarray, n: np.ndarray, look: np.ndarray) -> np.ndarray:
    """(n, 4) colours and alpha of a translucent skin: clear where it is seen face on, dense and bright towards
    its edges.

    The inner side, seen through the body, is darker and more saturated, as light there crossed more of the
    gel.
    """
    to_eye = unit(look[0] - p)
    facing, lit = dot(n, to_eye), (n @ KEY)[:, None]
    outside = facing > 0.0
    edge = (1.0 - np.minimum(np.abs(facing), 1.0)) ** np.float32(2.5)
    wrapped = np.maximum((lit + 0.55) / 1.55, 0.0)
    outer = albedo * (0.66 + 0.42 * wrapped) + 0.10 * wrapped
    inner = albedo * (0.35 * albedo + 0.55) * (0.85 + 0.25 * np.maximum(-lit, 0.0))
    alpha = np.where(outside, 0.30 + 0.45 * edge, 0.34 + 0.20 * edge)
    shine_out = 0.55 * gloss(n, to_eye, 36.0) + 0.20 * edge
    shine = np.clip(np.where(outside, shine_out, 0.10 * gloss(-n, to_eye, 20.0)), 0.0, 1.0)
    # A reflection is added light: over the body it blends to the same as one layer of this colour and alpha.
    total = 1.0 - (1.0 - alpha) * (1.0 - shine)
    color = (np.where(outside, outer, inner) * alpha * (1.0 - shine) + shine) / total
    return np.concatenate([np.minimum(color, 1.0), total], 1)


def nearer(points: np.ndarray, look: np.ndarray, lift: float) -> np.ndarray:
    """The points moved by `lift` of their distance towards the eye: what lies on a floor must not vanish in it."""
    return points + (look[0] - points) * np.float32(lift)


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
