"""One PNG a frame."""

import numpy as np

from taichi_jello.film.writer import Writer
from taichi_jello.support.png_file import encode_png


class Png(Writer):
    suffix = ".png"
    sequence = True

    def add(self, number: int, frame: np.ndarray) -> None:
        self.path(number).write_bytes(encode_png(frame))
