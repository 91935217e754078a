"""Pairs of jellos thrown at each other in random poses, and what becomes of them."""

import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taichi_jello.run.checks.start_warnings import SceneWarning
from taichi_jello.run.clock import StepWarning
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.description import Jello, Scene
from taichi_jello.scenefiles import demos
from taichi_jello.shapes.ball import Ball
from taichi_jello.shapes.lattice import Box
from taichi_jello.shapes.mesh import Mesh
from taichi_jello.shapes.ring import Ring
from taichi_jello.shapes.rope import Rope
from taichi_jello.shapes.sheet import Sheet
from taichi_jello.studies._contact.through import watched

SEED = 9
SPEED = 20.0  # m/s
AFTER = 0.1  # s that a throw goes on beyond the way of four sizes
Array = np.ndarray[Any, Any]
Row = dict[str, Any]


def mesh(name: str, size: float) -> Mesh:
    return Mesh(file=str(demos()[name].parent / "meshes" / f"{name}.ply"), resolution=12, size=size)


SHAPES: dict[str, Callable[[float], Jello]] = {
    "box": lambda s: Box(points=(5, 5, 5), size=(s, s, s)),
    "slab": lambda s: Box(points=(6, 6, 2), size=(s, s, 0.2 * s)),
    "bar": lambda s: Box(points=(2, 2, 8), size=(0.2 * s, 0.2 * s, s)),
    "ball": lambda s: Ball(radius=0.5 * s, resolution=5),
    "ring": lambda s: Ring(radius=0.4 * s, thickness=0.2 * s),
    "sheet": lambda s: Sheet(points=(9, 9), size=(s, s)),
    "strip": lambda s: Sheet(points=(13, 3), size=(s, s / 6.0)),
    "rope": lambda s: Rope(points=12, length=s),
    "rabbit": lambda s: mesh("rabbit", s),
    "teapot": lambda s: mesh("teapot", s),
}


@dataclass(frozen=True)
class Pair:
    """Two weightless jellos of 1 kg and `size` [m]; a restored state says where they are."""

    one: str
    other: str
    size: float = 1.0
    stiffness: float = 200.0

    def simulation(self, method: str) -> Simulation:
        made = [replace(SHAPES[name](self.size), stiffness=self.stiffness) for name in (self.one, self.other)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StepWarning)
            return Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=made), method=method, check_start=False)


def posed(simulation: Simulation, pose: int) -> tuple[Array, Array, Array]:
    """Drawn at random, the same for each number: the particles (N, 3) of both about their middles, each turned, and a
    direction (3,)."""
    draw, found = np.random.default_rng([SEED, pose]), []
    for j in (0, 1):
        rest = simulation.body.rest[simulation.body.jello == j]
        turn = np.linalg.qr(draw.standard_normal((3, 3)))[0]
        found.append((rest - rest.mean(0)) @ turn.T * np.sign(np.linalg.det(turn)))
    way = draw.standard_normal(3)
    return found[0], found[1], way / np.linalg.norm(way)


def middles(simulation: Simulation) -> Array:
    return np.array([simulation.x[simulation.body.jello == j].mean(0) for j in (0, 1)])


def thrown(simulation: Simulation, size: float, poses: Iterable[int]) -> Iterator[Row]:
    """Throw the first at the second at 20 m/s, middle at middle, from 2 sizes away: whether it is beyond it in the end,
    and whether it went through it, not round it."""
    first = (simulation.body.jello == 0)[:, None]
    end = AFTER + 4.0 * size / SPEED
    for pose in poses:
        low, high, way = posed(simulation, pose)
        start = Snapshot(0.0, np.concatenate([low - 2.0 * size * way, high]), first * SPEED * way)
        simulation.restore(start)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SceneWarning)  # of their overlap
            simulation.advance(end)
        a, b = middles(simulation)
        beyond = bool((a - b) @ way > 0.0)
        yield {"pose": pose, "beyond": beyond, "through": beyond and went_through(simulation, start, way, end)}


def went_through(simulation: Simulation, start: Snapshot, way: Array, end: float) -> bool:
    """The same throw, looked at after each step."""
    simulation.restore(start)
    watch, before = watched(simulation.body), -1.0
    watch.look(simulation.x.astype(float), False)
    while simulation.time < end:
        simulation.step(1)
        a, b = middles(simulation)
        beyond = float((a - b) @ way)
        watch.look(simulation.x.astype(float), before < 0.0 <= beyond)
        before = beyond
    return watch.went
