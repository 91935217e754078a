"""H.264 in MP4 with PyAV: frame k is shown from k/fps to (k + 1)/fps."""

import os
import struct
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np

from taichi_jello.film.writer import FilmProblem, Writer

CODEC: Final = "libx264"
QUALITY = {"crf": "18", "preset": "veryfast"}
# Fragments of one second, so the file plays wherever writing stops; closing makes it an ordinary MP4.
SAFE = {"movflags": "hybrid_fragmented+delay_moov", "frag_duration": "1000000", "flush_packets": "1"}
BT709, LIMITED = 1, 1  # of H.273: the colours that players assume


class Mp4(Writer):
    suffix = ".mp4"
    needs = ("av", "PyAV")

    def __init__(self, folder: Path, name: str, size: tuple[int, int], rate: Fraction):
        super().__init__(folder, name, size, rate)
        import av

        self._av = av
        self._container: Any = av.open(str(self.path()), "w", format="mp4", options=SAFE)
        self._stream: Any = self._container.add_stream(CODEC, rate=rate, options=QUALITY)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        context = self._stream.codec_context
        context.time_base = 1 / rate
        context.colorspace = context.color_primaries = context.color_trc = BT709
        context.color_range = LIMITED

    @classmethod
    def check(cls, size: tuple[int, int], rate: Fraction) -> None:
        super().check(size, rate)
        import av

        if CODEC not in av.codecs_available:
            raise FilmProblem(f".mp4 needs a PyAV with {CODEC}, which this one was built without")
        if size[0] % 2 or size[1] % 2:
            raise FilmProblem(f"size: expected even numbers of pixels for .mp4, got {size[0]}x{size[1]}")

    def add(self, number: int, frame: np.ndarray) -> None:
        picture = self._av.VideoFrame.from_ndarray(frame, format="rgb24")
        picture = picture.reformat(format="yuv420p", dst_colorspace=BT709, dst_color_range=LIMITED)
        picture.pts, picture.time_base, picture.duration = number, 1 / self.rate, 1
        self._container.mux(self._stream.encode(picture))

    def close(self) -> None:
        try:
            self._container.mux(self._stream.encode())
        finally:
            self._container.close()

    def mend(self) -> bool:
        """Truncate the file after its last whole fragment: after a complete mdat box, which holds frames."""
        whole = start = 0
        data = self.path().read_bytes()
        while start + 8 <= len(data):
            length, kind = struct.unpack_from(">I4s", data, start)
            start += max(length, 8)
            if kind == b"mdat" and start <= len(data):
                whole = start
        os.truncate(self.path(), whole)
        return whole > 0
