"""The three primitives of the renderers: NumPy arrays that kernels fill every frame."""

from dataclasses import dataclass

import numpy as np

ROWS = 720  # height of the picture [pixels] that sizes of lines and text are given for
WIDTH = 1.25  # pixels at that height; GGUI draws lines of one width in one call


@dataclass
class Triangles:
    """x (V, 3) [m]; rgba (V, 4) between 0 and 1, interpolated, lighting included; index (T, 3) int32.
    Opaque, except a skin, whose triangles are blended in their order."""

    x: np.ndarray
    rgba: np.ndarray
    index: np.ndarray

    @classmethod
    def empty(cls, vertices: int, index: np.ndarray) -> "Triangles":
        rgba = np.ones((vertices, 4), np.float32)
        return cls(np.zeros((vertices, 3), np.float32), rgba, np.ascontiguousarray(index, np.int32))


@dataclass
class Lines:
    """x (2L, 3) [m]: both ends of each segment; rgb (2L, 3); width in pixels of a picture of ROWS."""

    x: np.ndarray
    rgb: np.ndarray
    width: float = WIDTH

    @classmethod
    def empty(cls, count: int) -> "Lines":
        return cls(np.zeros((2 * count, 3), np.float32), np.zeros((2 * count, 3), np.float32))


@dataclass
class Dots:
    """Discs that face the eye. x (n, 3): centres [m]; rgb (n, 3); radius [m]."""

    x: np.ndarray
    rgb: np.ndarray
    radius: float
