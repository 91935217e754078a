"""The recorder: a thread encodes frames beside the target, which appears when it is complete."""

import contextlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from pathlib import Path
from queue import Queue
from threading import Thread
from types import TracebackType
from typing import Any

import numpy as np

from taichi_jello.film.writer import FilmProblem, Writer
from taichi_jello.support.plugins import classes

MAX_QUEUED = 4  # frames
PATTERN = re.compile(r"%(0\d+)?d")


@cache
def writers() -> dict[str, type[Writer]]:
    """The formats by file suffix."""
    from taichi_jello.film import formats

    return {found.suffix: found for found in classes(formats, Writer)}


class Film:
    """A film being written: `with Film("fall.mp4", (1280, 720), 60) as film: film.add(image)`.

    path: its suffix chooses the format; a sequence has a number in its name, as in skin-%04d.ply. size: (width, height)
    [pixels]; fps: frames a second, by default the format's own. Frames are of the type `takes`: pictures (height,
    width, 3) uint8, or Mesh. They are encoded later, so they must not be modified after `add`.

    The target appears, or is replaced, when the block ends normally or with one of the exceptions in `keep` and has at
    least one frame; other exceptions leave it as it was. Until then the film is in a folder beside it whose name ends
    in .part; a killed process leaves that behind. Raises FilmProblem for invalid arguments; `add` and the block's end
    raise OSError if the file cannot be written. With OSError in `keep`, what was written before is kept. `frames`
    counts encoded frames; `kept`: whether the target is in its place.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        size: tuple[int, int] = (1280, 720),
        fps: float | Fraction | None = None,
        *,
        keep: tuple[type[BaseException], ...] = (KeyboardInterrupt,),
    ):
        self.path, self.size, self._keep = Path(path), size, keep
        known = writers()
        suffix = self.path.suffix.lower()
        if suffix not in known:
            raise FilmProblem(f"expected a name ending in {', '.join(known)}")
        self._format = known[suffix]
        self.takes = self._format.frame
        if self._format.sequence and (self.path.name.count("%") != 1 or not PATTERN.search(self.path.name)):
            raise FilmProblem(f"expected a number in the name of each frame, as in name-%04d{self.path.suffix}")
        fps = self._format.fps if fps is None else fps
        if not 0.001 <= fps <= 1000:
            raise FilmProblem(f"fps: expected 0.001 to 1000 frames a second, got {float(fps):g}")
        self.rate = Fraction(fps).limit_denominator(1001)
        self._format.check(size, self.rate)
        self.frames, self.kept = 0, False

    @property
    def stem(self) -> str:
        """The name without its suffix and number."""
        return PATTERN.sub("", self.path.stem).rstrip("-_. ") or "film"

    def __enter__(self) -> "Film":
        self.frames, self.kept = 0, False
        self._problem: Exception | None = None
        self._queue: Queue[Any] = Queue(MAX_QUEUED)
        with self._naming_target():
            self._folder = Path(tempfile.mkdtemp(prefix=f"{self.stem}.", suffix=".part", dir=self.path.parent))
            try:
                self._writer = self._format(self._folder, self.path.name, self.size, self.rate)
            except BaseException:
                shutil.rmtree(self._folder, ignore_errors=True)
                raise
        self._thread = Thread(target=self._encode, name="film", daemon=True)
        self._thread.start()
        return self

    def add(self, frame: Any) -> None:
        """Take the next frame. Raises ValueError for another type or size."""
        if not isinstance(frame, self.takes):
            raise ValueError(f"expected a {self.takes.__name__}, got {type(frame).__name__}")
        shape = (self.size[1], self.size[0], 3)
        if isinstance(frame, np.ndarray) and (frame.shape != shape or frame.dtype != np.uint8):
            raise ValueError(f"expected a picture {shape} uint8, got {frame.shape} {frame.dtype}")
        self._queue.put(frame)
        self._raise_problem()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._queue.put(None)
            self._thread.join()
            if kind is None or issubclass(kind, self._keep):
                if self._problem is None or (isinstance(self._problem, self._keep) and self._writer.mend()):
                    self._place()
                self._raise_problem()
        finally:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _encode(self) -> None:
        """Run in the thread. Ctrl-C reaches only the main thread, so no frame is cut short."""
        while (frame := self._queue.get()) is not None:
            if self._problem is None:
                try:
                    self._writer.add(self.frames, frame)
                    self.frames += 1
                except Exception as error:  # raised by the next `add`
                    self._problem = error
        try:
            self._writer.close()
        except Exception as error:
            self._problem = self._problem or error

    def _raise_problem(self) -> None:
        if self._problem is not None:
            with self._naming_target():
                raise self._problem

    @contextlib.contextmanager
    def _naming_target(self) -> Iterator[None]:
        """Make an OSError name the target, not a temporary file."""
        try:
            yield
        except OSError as error:
            raise OSError(error.errno, error.strerror or str(error), str(self.path)) from None

    def _place(self) -> None:
        """Move the files to their place."""
        if self.frames:
            with self._naming_target():
                for written in sorted(self._folder.iterdir()):
                    os.replace(written, self.path.parent / written.name)
            self.kept = True
