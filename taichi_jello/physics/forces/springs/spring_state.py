"""The springs' numbers as keyframes, creep and tearing have made them at a moment (NumPy only)."""

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
class Law:
    """stiffness [N/m], rest_length [m] and damping [N·s/m] (S,) of all springs; whole (S,): not torn, None if none
    can be."""

    stiffness: np.ndarray
    rest_length: np.ndarray
    damping: np.ndarray
    whole: np.ndarray | None = None

    def energy(self, body: Body, x: np.ndarray) -> np.ndarray:
        """(S,) ½ k (|d| - R)² [J] with the particles at x (N, 3) [m]."""
        return 0.5 * self.stiffness * (lengths(body, x) - self.rest_length) ** 2


def lengths(body: Body, x: np.ndarray) -> np.ndarray:
    """(S,) of the springs [m], in float64."""
    i, j = body.springs.T
    d = x[j].astype(float) - x[i]
    return np.sqrt(np.einsum("ij,ij->i", d, d))


def law_at(scene: Scene, body: Body, time: float, memory: Memory) -> Law:
    """The law at `time` [s]. memory: "rest_length" (S,), where springs have taken on lengths of their own, and
    "whole" (S,), where springs may be torn."""
    rest, whole = memory.get("rest_length", body.rest_length), memory.get("whole")
    stiffness, damping = body.stiffness, body.damping
    if any(jello.keyframe for jello in scene.jello):
        stiffness = stiffness * by_jello(scene, body, [factor(j.keyframe, "stiffness", time) for j in scene.jello])
        damping = damping * by_jello(scene, body, [factor(j.keyframe, "damping", time) for j in scene.jello])
        rest = rest * by_jello(scene, body, [factor(j.keyframe, "rest_length", time) for j in scene.jello])
    if whole is not None:
        stiffness, damping = stiffness * whole, damping * whole
    return Law(stiffness, rest, damping, whole)


def loose(scene: Scene) -> np.ndarray:
    """(J,) bool: jellos that may tear or melt, whose springs may come to hold nothing together: particles inside them
    must not rely on the surface around them."""
    return np.array([j.tear_strain > 0.0 or least(j.keyframe, "stiffness") < LOOSE for j in scene.jello])


def by_jello(scene: Scene, body: Body, values: list[float]) -> np.ndarray:
    """(S,) for each spring the value of its jello."""
    return np.array(values, float)[body.jello[body.springs[:, 0]]]


def strongest(scene: Scene, body: Body) -> tuple[np.ndarray, np.ndarray, float]:
    """The largest stiffness and damping (S,) that each spring ever has, and the least ratio damping/stiffness [s] of
    any at any time: between two keyframes the ratio of two linear functions lies between those at its ends."""
    stiff = body.stiffness > 0.0
    ratio = np.divide(body.damping, body.stiffness, out=np.full(len(stiff), np.inf), where=stiff)
    if not any(jello.keyframe for jello in scene.jello):
        return body.stiffness, body.damping, float(ratio.min(initial=np.inf))
    stiffness = body.stiffness * by_jello(scene, body, [largest(j.keyframe, "stiffness") for j in scene.jello])
    damping = body.damping * by_jello(scene, body, [largest(j.keyframe, "damping") for j in scene.jello])
    least = []
    for jello in scene.jello:
        times = [k.time for k in jello.keyframe] + [k.time - 2.0 * SLACK for k in jello.keyframe if k.freeze]
        at = [(factor(jello.keyframe, "stiffness", t), factor(jello.keyframe, "damping", t)) for t in times]
        least.append(min((c / k for k, c in at or [(1.0, 1.0)] if k > 0.0), default=np.inf))
    with np.errstate(invalid="ignore"):  # an undamped spring that is never stiff: 0 · ∞
        ratio = np.nan_to_num(ratio * by_jello(scene, body, least), nan=np.inf, posinf=np.inf)
    return stiffness, damping, float(ratio.min(initial=np.inf))
