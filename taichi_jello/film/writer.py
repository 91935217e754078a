"""The interface of film formats: a suffix, requirements, and frames written one after another."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

INSTALL = "pip install 'taichi_jello[video]'"


class FilmProblem(ValueError):
    """A film that cannot be written, in one line."""


@dataclass(frozen=True)
class Mesh:
    """One frame of a surface: x (V, 3) float32 [m], rgb (V, 3) uint8, index (T, 3), the same in every frame."""

    x: np.ndarray
    rgb: np.ndarray
    index: np.ndarray


class Writer(ABC):
    """Writes frames into its own `folder`. `name` is the file's name, for a `sequence` a pattern such as
    skin-%04d.ply."""

    suffix: ClassVar[str]
    frame: ClassVar[type] = np.ndarray  # or Mesh
    sequence: ClassVar[bool] = False
    fps: ClassVar[float] = 60.0  # by default
    needs: ClassVar[tuple[str, str]] = ("", "")  # module and package

    def __init__(self, folder: Path, name: str, size: tuple[int, int], rate: Fraction):
        self.folder, self.name, self.size, self.rate = folder, name, size, rate

    @classmethod
    def check(cls, size: tuple[int, int], rate: Fraction) -> None:
        """Raise FilmProblem for a size [pixels] or rate [frames/s] that this format lacks."""
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
        """Repair the file after a failed write; False if nothing playable is left."""
        return True

    def path(self, number: int = 0) -> Path:
        """The file of frame `number`."""
        return self.folder / (self.name % number if self.sequence else self.name)
