"""Animated GIF with Pillow, frame by frame, so memory does not grow with the film."""

import struct
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.film.writer import FilmProblem, Writer

MAX_RATE = 50  # frames/s; browsers slow down anything faster
FOREVER = b"!\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00"


class Gif(Writer):
    """Each frame holds only the box that changed, with its own 256 colours."""

    suffix = ".gif"
    fps = 25.0
    needs = ("PIL.Image", "Pillow")

    def __init__(self, folder: Path, name: str, size: tuple[int, int], rate: Fraction):
        super().__init__(folder, name, size, rate)
        self._before: Any = None
        self._file = open(self.path(), "wb")  # noqa: SIM115 - closed in close()
        self._file.write(b"GIF89a" + struct.pack("<HHBBB", *size, 0, 0, 0) + FOREVER)

    @classmethod
    def check(cls, size: tuple[int, int], rate: Fraction) -> None:
        super().check(size, rate)
        if rate > MAX_RATE:
            raise FilmProblem(f"fps: expected at most {MAX_RATE} for .gif, got {float(rate):g}")

    def add(self, number: int, frame: np.ndarray) -> None:
        from PIL import GifImagePlugin, Image, ImageChops

        picture = Image.fromarray(frame)
        box = (0, 0, *self.size)
        if self._before is not None:
            box = ImageChops.difference(self._before, picture).getbbox() or (0, 0, 1, 1)
        self._before = picture
        part = picture.crop(box).quantize(256, method=Image.Quantize.MEDIANCUT)
        # Delays are whole hundredths of a second; rounding start and end keeps the total exact.
        start, end = (round(100 * k / self.rate) for k in (number, number + 1))
        blocks = GifImagePlugin.getdata(part, box[:2], duration=10 * (end - start), include_color_table=True)
        self._file.write(b"".join(blocks))

    def close(self) -> None:
        with self._file:
            self._file.write(b";")
