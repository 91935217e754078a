"""Pairs of jellos put into each other, or thrown at each other, in poses drawn by chance; and what becomes of them."""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taichi_jello.advice import SceneWarning
from taichi_jello.clock import StepWarning
from taichi_jello.physics.cuts import goes_through, surface_edges
from taichi_jello.physics.touching import Touching
from taichi_jello.scene import Jello, Scene
from taichi_jello.sceneio import demos
from taichi_jello.shapes.ball import Ball
from taichi_jello.shapes.lattice import Box
from taichi_jello.shapes.mesh import Mesh
from taichi_jello.shapes.ring import Ring
from taichi_jello.shapes.rope import Rope
from taichi_jello.shapes.sheet import Sheet
from taichi_jello.simulation import Simulation, Snapshot

SEED = 9
LONG, PULL = 2.5, 2.0  # s that a pair has to come apart by itself, and pulled
SPEED = 20.0  # m/s
Array = np.ndarray[Any, Any]


def mesh(name: str, size: float) -> Mesh:
    return Mesh(file=str(demos()[name].parent / "meshes" / f"{name}.ply"), resolution=12, size=size)


MESHES = ("rabbit", "teapot")
SHAPES: dict[str, Callable[[float], Jello]] = {
    "box": lambda s: Box(points=(5, 5, 5), size=(s, s, s)),
    "slab": lambda s: Box(points=(6, 6, 2), size=(s, s, 0.2 * s)),
    "bar": lambda s: Box(points=(2, 2, 8), size=(0.2 * s, 0.2 * s, s)),
    "ball": lambda s: Ball(radius=0.5 * s, resolution=5),
    "ring": lambda s: Ring(radius=0.4 * s, thickness=0.2 * s),
    "sheet": lambda s: Sheet(points=(9, 9), size=(s, s)),
    "strip": lambda s: Sheet(points=(13, 3), size=(s, s / 6.0)),
    "rope": lambda s: Rope(points=12, length=s),
} | {name: (lambda s, name=name: mesh(name, s)) for name in MESHES}


@dataclass(frozen=True)
class Pair:
    """Two jellos of 1 kg and `size` [m], weightless."""

    one: str
    other: str
    size: float = 1.0
    stiffness: float = 200.0

    def simulation(self, method: str) -> Simulation:
        made = [replace(SHAPES[name](self.size), stiffness=self.stiffness) for name in (self.one, self.other)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StepWarning)
            return Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=made), method=method)


def turned(simulation: Simulation, draw: np.random.Generator) -> list[Array]:
    """The particles of both about their middles, each turned by chance."""
    found = []
    for j in (0, 1):
        rest = simulation.body.rest[simulation.body.jello == j]
        turn = np.linalg.qr(draw.standard_normal((3, 3)))[0]
        found.append((rest - rest.mean(0)) @ turn.T * np.sign(np.linalg.det(turn)))
    return found


def direction(draw: np.random.Generator) -> Array:
    way = draw.standard_normal(3)
    return way / np.linalg.norm(way)


def go_on(simulation: Simulation, seconds: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)  # of their overlap
        simulation.advance(seconds)


def apart(simulation: Simulation) -> bool:
    return simulation.energies()["contact"] == 0.0 and cut(simulation) == 0


def cut(simulation: Simulation) -> int:
    """How many edges of either go an odd number of times through a sheet of the other one."""
    body, x = simulation.body, simulation.x.astype(float)
    touching = Touching.of(body, np.zeros(2, bool))
    edges, thin = surface_edges(touching), touching.nodes[touching.solid :, :3]
    ends = np.concatenate([x[touching.points[: touching.bare]], body.skin_points(x)])[edges]
    whose, owner = body.jello[touching.points[edges[:, 0]]], body.jello[thin[:, 0]]
    pairs = [(ends[whose != j], x[thin[owner == j]]) for j in (0, 1) if touching.sheet[j]]
    return sum(int(np.count_nonzero(np.sum(goes_through(*pair), 1) % 2)) for pair in pairs)


def middles(simulation: Simulation) -> Array:
    return np.array([simulation.x[simulation.body.jello == j].mean(0) for j in (0, 1)])


def overlapped(simulation: Simulation, poses: int) -> Iterator[dict[str, Any]]:
    """Each pose with half of the lesser of both extents along a way by chance within the other: whether they come
    apart by themselves, or pulled at 1 m/s, and how much energy [J] is more in the end than it was."""
    draw, first = np.random.default_rng(SEED), (simulation.body.jello == 0)[:, None]
    for pose in range(poses):
        (low, high), way = turned(simulation, draw), direction(draw)
        overlap = 0.5 * min(np.ptp(low @ way), np.ptp(high @ way))
        high = high + way * ((low @ way).max() - (high @ way).min() - overlap)
        x = np.concatenate([low, high])
        simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
        before = sum(simulation.energies().values())
        go_on(simulation, LONG)
        told = {"pose": pose, "gained": sum(simulation.energies().values()) - before, "pulled": not apart(simulation)}
        if told["pulled"]:
            a, b = middles(simulation)
            pull = 0.5 * (a - b) / max(float(np.linalg.norm(a - b)), 1e-9)
            v = simulation.v + np.where(first, pull, -pull)
            simulation.restore(Snapshot(simulation.time, simulation.x, v))
            go_on(simulation, PULL)
        yield told | {"held": not apart(simulation)}


def thrown(simulation: Simulation, size: float, poses: int) -> Iterator[dict[str, Any]]:
    """The first thrown at the second at 20 m/s, middle at middle, from 2 sizes away: whether it is beyond it in the
    end, and how many edges went through at once if it is."""
    draw, first = np.random.default_rng(SEED), (simulation.body.jello == 0)[:, None]
    for pose in range(poses):
        (low, high), way = turned(simulation, draw), direction(draw)
        start = Snapshot(0.0, np.concatenate([low - 2.0 * size * way, high]), first * SPEED * way)
        simulation.restore(start)
        go_on(simulation, 0.1 + 4.0 * size / SPEED)
        a, b = middles(simulation)
        told = {"pose": pose, "beyond": bool((a - b) @ way > 0.0), "cut": 0}
        if told["beyond"]:
            told["cut"] = most_cut(simulation, start)
        yield told


def most_cut(simulation: Simulation, start: Snapshot) -> int:
    """Of all moments of a throw."""
    simulation.restore(start)
    most = 0
    while simulation.time < 0.1 + 4.0 * np.ptp(start.x) / SPEED:
        simulation.step(1)
        most = max(most, cut(simulation))
    return most
