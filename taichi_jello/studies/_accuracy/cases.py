"""The built-in cases of the accuracy study: smooth, stiff, contact and several jellos. Data; one more is one more
entry."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.run.assembly import assembled
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Contact, Pin, Scene, Solver
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies._reference import twisted

STILL = (0.0, 0.0, 0.0)


def as_it_is(x: np.ndarray) -> np.ndarray:
    return x


@dataclass(frozen=True)
class Case:
    """A scene from its beginning, its points x (N, 3) moved to `start(x)`, to `seconds`, a whole number of its frames;
    `shows`: what it teaches."""

    name: str
    shows: str
    scene: Scene
    seconds: float
    start: Callable[[np.ndarray], np.ndarray] = as_it_is

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
    """The cases by name; with `quick` smaller lattices, which move alike."""
    n = (4, 4, 4) if quick else (8, 8, 8)
    few = (4, 4, 4) if quick else (6, 6, 6)

    def whole(seconds: float) -> Solver:
        """One frame for it all, so that a step may be as long as a method likes."""
        return Solver(frame_dt=seconds)

    def cube(points: tuple[int, int, int], damping: float) -> Scene:
        jello = Box(points=points, stiffness=2000.0, damping=damping)
        return Scene(gravity=STILL, jello=[jello], solver=whole(0.1))

    stiff = Box(
        points=(8, 3, 3),
        size=(1.0, 0.25, 0.25),
        stiffness={"structural": 1e5, "shear": 200.0, "bend": 200.0},
        damping={"structural": 5.0, "shear": 0.2, "bend": 0.2},
        pin=[Pin(max=(0.0, 1.0, 1.0))],
    )
    fallen = Box(points=few, position=(0.0, 0.51, 0.0), velocity=(0.5, -2.0, 0.0))
    pair = [
        Box(points=few, stiffness=500.0, rotation=(10.0, 20.0, 0.0), spin=(0.0, 0.0, 3.0)),
        Box(points=(4, 4, 4), position=(1.6, 0.0, 0.0), stiffness=100.0, spin=(0.0, 5.0, 0.0)),
    ]
    cases = [
        Case("smooth", "a damped cube, twisted by 36° and stretched by 10 %, swings", cube(n, 0.25), 0.1, twisted),
        Case("undamped", "the same without damping", cube(few, 0.0), 0.1, twisted),
        Case(
            "stiff",
            "a held bar, 500 times as stiff along its axes, bends",
            Scene(jello=[stiff], solver=whole(0.2)),
            0.2,
        ),
        Case("contact", "a cube lands", Scene(jello=[fallen], collider=[Plane()], solver=whole(0.1)), 0.1),
        Case(
            "pair",
            "two jellos of different stiffness, apart",
            Scene(gravity=STILL, jello=pair, contact=Contact(touch=False), solver=whole(0.2)),
            0.2,
            twisted,
        ),
    ]
    return {case.name: case for case in cases}


def default(quick: bool) -> list[Case]:
    """The cases of a study that is given none: all, or the smooth one."""
    known = built_in(quick)
    return [known["smooth"]] if quick else list(known.values())


def case_of(scene: Scene, seconds: float | None) -> Case:
    """A scene as a case, for so many seconds, by default its first one."""
    frame = scene.solver.frame_dt
    frames = max(1, round((min(scene.seconds, 1.0) if seconds is None else seconds) / frame))
    return Case(scene.title or "scene", "", scene, frames * frame)
