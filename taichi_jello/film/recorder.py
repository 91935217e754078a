"""The recorder: frames go in, a thread encodes them beside the target, and the target appears when it is whole."""

import contextlib
import os
import re
import shutil
import tempfile
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

WAITING = 4  # frames between the one who draws and the one who encodes
PATTERN = re.compile(r"%(0\d+)?d")


@cache
def writers() -> dict[str, type[Writer]]:
    """The formats there are, by the suffix of a file."""
    from taichi_jello.film import formats

    return {found.suffix: found for found in classes(formats, Writer)}


def suffixes() -> list[str]:
    """The suffixes a film's name may end in."""
    return list(writers())


class Film:
    """A film being written: `with Film("fall.mp4", (1280, 720), 60) as film: film.add(image)`.

    path: its suffix chooses the format; a sequence of files has a number in its name, as in skin-%04d.ply. size:
    (width, height) [pixels]; fps: frames a second, by default the format's own. Frames are `takes`: pictures (height,
    width, 3) uint8, or Mesh; they are encoded later, so nobody may write into them after `add`.

    The target appears, or is replaced, when the block ends: normally or with one of the exceptions `keep`, by default
    Ctrl-C, and at least one frame. Any other exception leaves what was there. Until then the film is in a folder
    beside it whose name ends in .part; a process that is killed leaves it there. Raises FilmProblem for a film that
    cannot be; `add` and the block's end raise OSError if the file cannot be written, but with OSError among `keep` what
    was written before is placed all the same. `frames` counts what is encoded, `kept` tells whether it is in its place.
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
        if self.path.suffix not in known:
            raise FilmProblem(f"expected a name ending in {', '.join(known)}")
        self._format = known[self.path.suffix]
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
        self._problem: BaseException | None = None
        self._queue: Queue[Any] = Queue(WAITING)
        with self._told():
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
        """Take the next frame. Raises ValueError for one of another kind or size."""
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
                if isinstance(self._problem, self._keep) and self._writer.mend():
                    self._place()
                self._raise_problem()
                self._place()
        finally:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _encode(self) -> None:
        """The thread's work. Ctrl-C reaches only the main thread, so a frame is encoded wholly or not at all."""
        while (frame := self._queue.get()) is not None:
            if self._problem is None:
                try:
                    self._writer.add(self.frames, frame)
                    self.frames += 1
                except Exception as error:  # told where the frames come from
                    self._problem = error
        try:
            self._writer.close()
        except Exception as error:
            self._problem = self._problem or error

    def _raise_problem(self) -> None:
        if self._problem is not None:
            with self._told():
                raise self._problem

    @contextlib.contextmanager
    def _told(self) -> Any:
        """An OSError within names the film, not a file that nobody asked for."""
        try:
            yield
        except OSError as error:
            raise OSError(error.errno, error.strerror or str(error), str(self.path)) from None

    def _place(self) -> None:
        """Move what was written to its place."""
        if self.frames:
            with self._told():
                for written in sorted(self._folder.iterdir()):
                    os.replace(written, self.path.parent / written.name)
            self.kept = True
