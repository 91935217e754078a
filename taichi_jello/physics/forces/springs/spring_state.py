"""The springs' numbers at a moment, as keyframes, creep and tearing have changed them (NumPy only)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.scene.keyframes import SLACK, factor, largest, least

Memory = Mapping[str, np.ndarray]
NOTHING: Memory = {}
LOOSE = 0.1  # of its stiffness, below which a jello that melts may come apart


@dataclass(frozen=True)
class SpringState:
    """stiffness [N/m], rest_length [m] and damping [N·s/m] (S,) of all springs; whole (S,): not torn, None if none
    can be."""

    stiffness: np.ndarray
    rest_length: np.ndarray
    damping: np.ndarray
    whole: np.ndarray | None = None

    def energy(self, body: Body, x: np.ndarray) -> np.ndarray:
        """(S,) ½ k (|d| - R)² [J] with the particles at x (N, 3) [m]."""
        return 0.5 * self.stiffness * (lengths(body, x) - self.rest_length) ** 2

    def equals(self, other: "SpringState") -> bool:
        """Whether all springs have the same numbers."""
        pairs = [(getattr(self, name), getattr(other, name)) for name in ("stiffness", "rest_length", "damping")]
        return all(p is q or np.array_equal(p, q) for p, q in pairs)


def lengths(body: Body, x: np.ndarray) -> np.ndarray:
    """(S,) of the springs [m], in float64."""
    i, j = body.springs.T
    d = x[j].astype(float) - x[i]
    return np.sqrt(np.einsum("ij,ij->i", d, d))


def springs_at(scene: Scene, body: Body, time: float, memory: Memory) -> SpringState:
    """The springs at `time` [s]. memory: "rest_length" (S,), where rest lengths have changed, and "whole" (S,), where
    springs can tear."""
    rest, whole = memory.get("rest_length", body.rest_length), memory.get("whole")
    stiffness, damping = body.stiffness, body.damping
    if any(jello.keyframe for jello in scene.jello):
        stiffness = stiffness * by_jello(scene, body, [factor(j.keyframe, "stiffness", time) for j in scene.jello])
        damping = damping * by_jello(scene, body, [factor(j.keyframe, "damping", time) for j in scene.jello])
        rest = rest * by_jello(scene, body, [factor(j.keyframe, "rest_length", time) for j in scene.jello])
    if whole is not None:
        stiffness, damping = stiffness * whole, damping * whole
    return SpringState(stiffness, rest, damping, whole)


def loose(scene: Scene) -> np.ndarray:
    """(J,) bool: jellos that may tear or melt, so that particles inside may leave the surface around them."""
    return np.array([j.tear_strain > 0.0 or least(j.keyframe, "stiffness") < LOOSE for j in scene.jello])


def by_jello(scene: Scene, body: Body, values: list[float]) -> np.ndarray:
    """(S,) for each spring the value of its jello."""
    return np.array(values, float)[body.jello[body.springs[:, 0]]]


def strongest(scene: Scene, body: Body) -> tuple[np.ndarray, np.ndarray, float]:
    """The largest stiffness and damping (S,) that each spring ever has, and the least ratio damping/stiffness [s] of
    any at any time: between two keyframes the ratio of two linear functions lies between those at its ends."""
    ratio = np.divide(body.damping, body.stiffness, out=np.full(len(body.springs), np.inf), where=body.stiffness > 0.0)
    if not any(jello.keyframe for jello in scene.jello):
        return body.stiffness, body.damping, float(ratio.min(initial=np.inf))
    stiffness = body.stiffness * by_jello(scene, body, [largest(j.keyframe, "stiffness") for j in scene.jello])
    damping = body.damping * by_jello(scene, body, [largest(j.keyframe, "damping") for j in scene.jello])
    smallest = []
    for jello in scene.jello:
        times = [k.time for k in jello.keyframe] + [k.time - 2.0 * SLACK for k in jello.keyframe if k.freeze]
        at = [(factor(jello.keyframe, "stiffness", t), factor(jello.keyframe, "damping", t)) for t in times]
        smallest.append(min((c / k for k, c in at or [(1.0, 1.0)] if k > 0.0), default=np.inf))
    with np.errstate(invalid="ignore"):  # an undamped spring that is never stiff: 0 · ∞
        ratio = np.nan_to_num(ratio * by_jello(scene, body, smallest), nan=np.inf, posinf=np.inf)
    return stiffness, damping, float(ratio.min(initial=np.inf))
