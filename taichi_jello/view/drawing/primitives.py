"""The three kinds of things a renderer draws. Plain NumPy memory, written in place by kernels every frame."""

from dataclasses import dataclass

import numpy as np

WIDTH = 1.25  # pixels of a picture 720 rows high; one width for all lines lets GGUI draw them at once


@dataclass
class Triangles:
    """x (V, 3) [m]; rgba (V, 4) between 0 and 1, interpolated and never lit again; index (T, 3) int32.

    Opaque unless drawn as a skin, which is blended over what lies behind it in the order of its triangles."""

    x: np.ndarray
    rgba: np.ndarray
    index: np.ndarray

    @classmethod
    def empty(cls, vertices: int, index: np.ndarray) -> "Triangles":
        rgba = np.ones((vertices, 4), np.float32)
        return cls(np.zeros((vertices, 3), np.float32), rgba, np.ascontiguousarray(index, np.int32))


@dataclass
class Lines:
    """x (2L, 3) [m]: both ends of each segment; rgb (2L, 3); width in pixels of a picture 720 rows high."""

    x: np.ndarray
    rgb: np.ndarray
    width: float

    @classmethod
    def empty(cls, count: int, width: float) -> "Lines":
        return cls(np.zeros((2 * count, 3), np.float32), np.zeros((2 * count, 3), np.float32), width)


@dataclass
class Dots:
    """x (n, 3) [m]: the middles of flat discs that face the eye; rgb (n, 3); radius [m]."""

    x: np.ndarray
    rgb: np.ndarray
    radius: float
