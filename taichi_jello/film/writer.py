"""What every format of a film has: a suffix, what it needs, and frames that go in one after the other."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

INSTALL = "pip install 'taichi_jello[video]'"


class FilmProblem(ValueError):
    """A film that cannot be written: one line for the person."""


@dataclass(frozen=True)
class Mesh:
    """One moment of a surface: x (V, 3) float32 [m], rgb (V, 3) uint8, index (T, 3), the same in every frame."""

    x: np.ndarray
    rgb: np.ndarray
    index: np.ndarray


class Writer(ABC):
    """Writes frames into a folder that is its own; whoever made it moves the files to their place.

    `folder` is there, `name` is the wanted file name: for a `sequence` a pattern such as skin-%04d.ply. A subclass may
    refuse a size [pixels] or a rate [frames/s] in `check`, which touches no file.
    """

    suffix: ClassVar[str]
    frame: ClassVar[type] = np.ndarray  # or Mesh
    sequence: ClassVar[bool] = False
    fps: ClassVar[float] = 60.0  # unless somebody asks for another
    needs: ClassVar[tuple[str, str]] = ("", "")  # what is imported, and what people call it

    def __init__(self, folder: Path, name: str, size: tuple[int, int], rate: Fraction):
        self.folder, self.name, self.size, self.rate = folder, name, size, rate

    @classmethod
    def check(cls, size: tuple[int, int], rate: Fraction) -> None:
        """Raise FilmProblem for what this format cannot be."""
        module, package = cls.needs
        if module:
            try:
                import_module(module)
            except ImportError:
                raise FilmProblem(f"{cls.suffix} needs {package}: {INSTALL}") from None

    @abstractmethod
    def add(self, number: int, frame: Any) -> None:
        """Write frame `number`, counted from 0."""

    def close(self) -> None:  # noqa: B027 - a sequence has nothing to finish
        """Finish the file."""

    def mend(self) -> bool:
        """Make what could be written before it failed a file that plays; False if it cannot be one."""
        return True

    def path(self, number: int = 0) -> Path:
        """The file that frame `number` goes into."""
        return self.folder / (self.name % number if self.sequence else self.name)
