"""The method `auto`: an explicit step where the motion is resolved anyway, an implicit one where it costs less."""

from dataclasses import dataclass
from math import ceil
from typing import Any

from taichi_jello.body import Body
from taichi_jello.physics.integrators import scheme
from taichi_jello.physics.system import System
from taichi_jello.scene import Scene

AUTO, EXPLICIT, IMPLICIT = "auto", "rk4", "backward-euler"
# What the solve of a stiff frame costs on an impact, in evaluations of the forces, on bodies of any size: about 40
# evaluations and products with H, each with what else the solve does for it.
SOLVE = 200


@dataclass(frozen=True)
class Choice:
    """The method, and why: what a frame costs either way, in evaluations of all forces."""

    method: str
    reason: str


def check(method: str) -> None:
    """Raises SceneError for a method that there is not."""
    if method != AUTO:
        scheme(method)


def choose(scene: Scene, body: Body, own_step: bool, **options: Any) -> tuple[System, Choice]:
    """The system for `auto`. own_step: whether dt or substeps are given; then the step is explicit and as given."""
    explicit = System(scene, body, method=EXPLICIT, **options)
    frame = scene.solver.frame_dt
    evaluations = explicit.integrator.stages * max(1, ceil(frame / explicit.bound.dt))
    solve = SOLVE
    told = f"a frame takes {EXPLICIT} {evaluations} evaluations of the forces, an implicit solve about {solve}"
    if own_step:
        return explicit, Choice(EXPLICIT, "the step is given")
    if evaluations <= solve:
        return explicit, Choice(EXPLICIT, told)
    return System(scene, body, method=IMPLICIT, **options), Choice(IMPLICIT, told)
