"""What changes with time: numbers given at a few moments, linear between them and still before and after.

A change acts at the beginning of a drawn frame; what moves goes straight within one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from taichi_jello.scene.validation import Checked, SceneError, Vector, number, vector


class Timed(Checked):
    """Something at a `time` [s]; a list of them is in the order of time."""

    time: float

    @classmethod
    def together(cls, key: str, rows: Sequence[Any]) -> None:
        for index, (before, after) in enumerate(pairwise(rows), 1):
            if after.time <= before.time:
                raise SceneError(
                    f"{key}.{index}.time", f"expected more than {before.time:g}, the time before it, got {after.time:g}"
                )


@dataclass(frozen=True, kw_only=True)
class Keyframe(Timed):
    """Of a jello at `time` [s]: factors on its stiffness, damping and rest lengths. A factor that is left out follows
    from the keyframes that give it; if none does, it is 1. freeze: the springs take on, from here on, the lengths that
    they have now as their rest lengths, so that the jello stays in the shape that it has melted to."""

    time: float
    stiffness: float | None = None
    damping: float | None = None
    rest_length: float | None = None
    freeze: bool = False

    def check(self) -> dict[str, Any]:
        given = [name for name in ("stiffness", "damping", "rest_length") if getattr(self, name) is not None]
        if not isinstance(self.freeze, bool):
            raise SceneError("freeze", f"expected true or false, got {self.freeze!r}")
        return {"time": number("time", self.time, low=0.0)} | {
            name: number(name, getattr(self, name), low=0.0) for name in given
        }


@dataclass(frozen=True, kw_only=True)
class GravityKeyframe(Timed):
    """Of the whole scene at `time` [s]: gravity [m/s²]."""

    time: float
    gravity: Vector

    def check(self) -> dict[str, Any]:
        return {"time": number("time", self.time, low=0.0), "gravity": vector("gravity", self.gravity)}


@dataclass(frozen=True, kw_only=True)
class Move(Timed):
    """At `time` [s] something is moved by `offset` [m] from where it would be."""

    time: float
    offset: Vector

    def check(self) -> dict[str, Any]:
        return {"time": number("time", self.time, low=0.0), "offset": vector("offset", self.offset)}


def factor(rows: Sequence[Keyframe], name: str, time: float) -> float:
    """The factor `name` at `time` [s]."""
    given = [row for row in rows if getattr(row, name) is not None]
    if not given:
        return 1.0
    return float(np.interp(time, [row.time for row in given], [getattr(row, name) for row in given]))


def largest(rows: Sequence[Keyframe], name: str) -> float:
    """The largest that the factor `name` ever is."""
    return max((value for row in rows if (value := getattr(row, name)) is not None), default=1.0)


def least(rows: Sequence[Keyframe], name: str) -> float:
    """The least that the factor `name` ever is."""
    return min((value for row in rows if (value := getattr(row, name)) is not None), default=1.0)


def offset(rows: Sequence[Move], time: float) -> np.ndarray:
    """(3,) [m] at `time` [s]."""
    if not rows:
        return np.zeros(3)
    return _vectors([row.time for row in rows], [row.offset for row in rows], time)


def gravity(rows: Sequence[GravityKeyframe], time: float) -> np.ndarray:
    """(3,) [m/s²] at `time` [s]."""
    return _vectors([row.time for row in rows], [row.gravity for row in rows], time)


def _vectors(times: list[float], values: list[Vector], time: float) -> np.ndarray:
    return np.array([np.interp(time, times, axis) for axis in zip(*values, strict=True)])
