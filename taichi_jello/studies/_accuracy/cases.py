"""The built-in cases of the accuracy study: smooth, stiff, in contact, and several jellos."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.run.assembly import assembled
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Contact, Pin, Scene, Solver
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies._reference import twisted


@dataclass(frozen=True)
class Case:
    """A scene that starts with its points x (N, 3) moved to `start(x)` and lasts `seconds`, a whole number of frames.

    shows: what the case teaches."""

    name: str
    shows: str
    scene: Scene
    seconds: float
    start: Callable[[np.ndarray], np.ndarray] = np.copy

    @property
    def body(self) -> Body:
        return assembled(self.scene)

    @property
    def frames(self) -> int:
        return max(1, round(self.seconds / self.scene.solver.frame_dt))

    @property
    def edge(self) -> float:
        """[m] The longest side of the first jello at rest; errors are fractions of it."""
        body = self.body
        return float(np.ptp(body.rest[body.jello == 0], axis=0).max()) or 1.0


def built_in(quick: bool) -> dict[str, Case]:
    """The cases by name; `quick`: on smaller lattices. Each is a single frame, so that a step may have any length."""
    points = (4, 4, 4) if quick else (8, 8, 8)
    fewer = (4, 4, 4) if quick else (6, 6, 6)
    floating = (0.0, 0.0, 0.0)  # gravity

    def scene(seconds: float, *jello: Box, **more: Any) -> Scene:
        return Scene(jello=list(jello), solver=Solver(frame_dt=seconds), **more)

    def cube(points: tuple[int, int, int], damping: float) -> Scene:
        return scene(0.1, Box(points=points, stiffness=2000.0, damping=damping), gravity=floating)

    stiff = Box(
        points=(8, 3, 3),
        size=(1.0, 0.25, 0.25),
        stiffness={"structural": 1e5, "shear": 200.0, "bend": 200.0},
        damping={"structural": 5.0, "shear": 0.2, "bend": 0.2},
        pin=[Pin(max=(0.0, 1.0, 1.0))],
    )
    landing = Box(points=fewer, position=(0.0, 0.51, 0.0), velocity=(0.5, -2.0, 0.0))
    one = Box(points=fewer, stiffness=500.0, rotation=(10.0, 20.0, 0.0), spin=(0.0, 0.0, 3.0))
    other = Box(points=(4, 4, 4), position=(1.6, 0.0, 0.0), stiffness=100.0, spin=(0.0, 5.0, 0.0))
    pair = scene(0.2, one, other, gravity=floating, contact=Contact(touch=False))
    cases = [
        Case("smooth", "a damped cube, twisted by 36° and stretched by 10 %, swings", cube(points, 0.25), 0.1, twisted),
        Case("undamped", "the same without damping", cube(fewer, 0.0), 0.1, twisted),
        Case("stiff", "a held bar, 500 times as stiff along its axes, bends", scene(0.2, stiff), 0.2),
        Case("contact", "a cube lands", scene(0.1, landing, collider=[Plane()]), 0.1),
        Case("pair", "two jellos of different stiffness, apart", pair, 0.2, twisted),
    ]
    return {case.name: case for case in cases}


def default(quick: bool) -> list[Case]:
    """All built-in cases; `quick`: the smooth one."""
    cases = list(built_in(quick).values())
    return cases[:1] if quick else cases


def case_of(scene: Scene, seconds: float | None) -> Case:
    """A scene as a case, for so many seconds, by default its first one."""
    frame = scene.solver.frame_dt
    frames = max(1, round((min(scene.seconds, 1.0) if seconds is None else seconds) / frame))
    return Case(scene.title or "scene", "", scene, frames * frame)
