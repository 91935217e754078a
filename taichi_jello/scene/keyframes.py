"""Values that change with time: linear between keyframes, constant before the first and after the last.

Stiffness, damping, rest lengths and gravity change at the beginning of a drawn frame; motion is straight within one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from taichi_jello.scene.validation import Checked, SceneError, Vector, field_of_view, number, truth, vector

SLACK = 1e-9  # s by which a frame may begin before a keyframe and still be meant by it: rounding of the clock
HELD = ("stiffness", "damping")  # factors that do not approach the value they have once frozen


@dataclass(frozen=True, kw_only=True)
class Timed(Checked):
    """A keyframe at `time` [s]; lists of them are in order of time."""

    time: float

    @classmethod
    def check_rows(cls, key: str, rows: Sequence[Any]) -> None:
        for index, (before, after) in enumerate(pairwise(rows), 1):
            if after.time <= before.time:
                raise SceneError(
                    f"{key}.{index}.time", f"expected more than {before.time:g}, the time before it, got {after.time:g}"
                )

    def check(self) -> dict[str, Any]:
        return {"time": number("time", self.time, low=0.0)}


@dataclass(frozen=True, kw_only=True)
class Keyframe(Timed):
    """Factors on a jello's stiffness, damping and rest lengths at `time` [s]. A factor that is left out is interpolated
    from the keyframes that give it; without any it is 1. freeze: from here on the springs' current lengths are their
    rest lengths, so the jello keeps its deformed shape. Freezing comes first: stiffness and damping that the same
    keyframe gives keep their values of the keyframe before until then and change at once, in the frozen shape."""

    stiffness: float | None = None
    damping: float | None = None
    rest_length: float | None = None
    freeze: bool = False

    def check(self) -> dict[str, Any]:
        given = [name for name in ("stiffness", "damping", "rest_length") if getattr(self, name) is not None]
        factors = {name: number(name, getattr(self, name), low=0.0) for name in given}
        return super().check() | factors | {"freeze": truth("freeze", self.freeze)}


@dataclass(frozen=True, kw_only=True)
class GravityKeyframe(Timed):
    """The scene's gravity [m/s²] at `time` [s]."""

    gravity: Vector

    def check(self) -> dict[str, Any]:
        return super().check() | {"gravity": vector("gravity", self.gravity)}


@dataclass(frozen=True, kw_only=True)
class Move(Timed):
    """At `time` [s] the object is displaced by `offset` [m]."""

    offset: Vector

    def check(self) -> dict[str, Any]:
        return super().check() | {"offset": vector("offset", self.offset)}


@dataclass(frozen=True, kw_only=True)
class CameraKeyframe(Timed):
    """The camera's eye and target [m] and field of view [degrees] at `time` [s], along a smooth way from keyframe to
    keyframe. One that is left out is interpolated from the keyframes that give it; without any it is the camera's
    own."""

    eye: Vector | None = None
    target: Vector | None = None
    fov: float | None = None

    def check(self) -> dict[str, Any]:
        given = {name: vector(name, value) for name in ("eye", "target") if (value := getattr(self, name)) is not None}
        if len(given) == 2 and given["eye"] == given["target"]:
            raise SceneError("eye", "expected a point away from the target")
        return super().check() | given | ({} if self.fov is None else {"fov": field_of_view(self.fov)})


def factor(rows: Sequence[Keyframe], name: str, time: float) -> float:
    """The factor `name` at `time` [s]."""
    given = [row for row in rows if getattr(row, name) is not None]
    if not given:
        return 1.0
    begun = sum(row.time <= time + SLACK for row in given)
    if 0 < begun < len(given) and given[begun].freeze and name in HELD:
        return float(getattr(given[begun - 1], name))
    return float(np.interp(time, [row.time for row in given], [getattr(row, name) for row in given]))


def largest(rows: Sequence[Keyframe], name: str) -> float:
    """The largest value of the factor `name` at any time."""
    return max((value for row in rows if (value := getattr(row, name)) is not None), default=1.0)


def least(rows: Sequence[Keyframe], name: str) -> float:
    """The smallest value of the factor `name` at any time."""
    return min((value for row in rows if (value := getattr(row, name)) is not None), default=1.0)


def offset(rows: Sequence[Move], time: float) -> np.ndarray:
    """(3,) [m] at `time` [s]; zero without keyframes."""
    return _interpolated([row.time for row in rows], [row.offset for row in rows], time) if rows else np.zeros(3)


def gravity(rows: Sequence[GravityKeyframe], time: float) -> np.ndarray:
    """(3,) [m/s²] at `time` [s]."""
    return _interpolated([row.time for row in rows], [row.gravity for row in rows], time)


def smooth(rows: Sequence[Timed], name: str, otherwise: Any, time: float) -> np.ndarray:
    """The value `name` at `time` [s] of the rows that give it: cubic between them, at rest at the first and the last,
    and never beyond its neighbours (Fritsch and Butland 1984); `otherwise` if no row gives it."""
    given = [row for row in rows if getattr(row, name) is not None]
    if len(given) < 2:
        return np.array(getattr(given[0], name) if given else otherwise, float)
    times = np.array([row.time for row in given])
    values = np.array([getattr(row, name) for row in given], float)
    slope = (np.diff(values.T) / np.diff(times)).T
    before, after = slope[:-1], slope[1:]
    together = before + after
    middle = np.where(before * after > 0.0, 2.0 * before * after / np.where(together == 0.0, 1.0, together), 0.0)
    rate = np.concatenate([np.zeros_like(values[:1]), middle, np.zeros_like(values[:1])])
    k = int(np.clip(np.searchsorted(times, time, "right") - 1, 0, len(times) - 2))
    span = times[k + 1] - times[k]
    t = float(np.clip((time - times[k]) / span, 0.0, 1.0))
    bow = t * (1.0 - t) * span * ((1.0 - t) * rate[k] - t * rate[k + 1])
    return values[k] + (values[k + 1] - values[k]) * t * t * (3.0 - 2.0 * t) + bow


def _interpolated(times: list[float], values: list[Vector], time: float) -> np.ndarray:
    return np.array([np.interp(time, times, axis) for axis in zip(*values, strict=True)])
