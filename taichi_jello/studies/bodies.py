"""What jellos that lie, collide, melt, come from a mesh or become finer are held to, each beside what it comes to."""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from taichi_jello import runtime
from taichi_jello.physics.choice import AUTO, check
from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.scene import Keyframe, Pin, Scene, Solver
from taichi_jello.sceneio import load
from taichi_jello.shapes.lattice import Box
from taichi_jello.shapes.ring import Ring
from taichi_jello.shapes.rope import Rope
from taichi_jello.simulation import Simulation, Snapshot
from taichi_jello.studies._reference import twisted
from taichi_jello.studies._report import headline, machine, table, take
from taichi_jello.studies._through import watched

COLUMN, ACROSS = 0.011, 0.55  # m: between the columns that surfaces are looked at over, and how far out
UPRIGHT = 0.7  # the least of a normal's upright part for a face to count as one that lies or bears
CUBE = Box(young=2000.0, density=500.0, pin=[Pin(min=(0.0, 1.0, 0.0))])  # it hangs by its top
POINTS = (8, 16)  # along an edge
HEIGHT, MASS = 0.3, 0.3  # m, kg
BARS = (  # see `across`: points of one in the planes of the other's sides; so turned; thin ones of few points
    (17, 0.1, 0.05, (0.0, 90.0, 0.0)),
    (17, 0.1, 0.05, (45.0, 90.0, 0.0)),
    (9, 0.1, 0.1, (0.0, 90.0, 0.0)),
    (9, 0.04, 0.1, (0.0, 90.0, 0.0)),
)
WEIGHT = -1.0  # m/s² on what hangs: it becomes longer by an eighth
Array = np.ndarray[Any, Any]


def heights(x: Array, triangles: Array, columns: Array, side: float) -> Array:
    """(C,) [m] the least, for side = -1, or greatest, for 1, height of what faces up or down of a surface with points
    x (N, 3) and triangles (T, 3), over each of the columns (C, 2); NaN where there is nothing."""
    a, b, c = (x[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    a, b, c = (corner[abs(normal[:, 1]) > UPRIGHT * np.linalg.norm(normal, axis=1)] for corner in (a, b, c))
    u, w, p = (b - a)[:, [0, 2]], (c - a)[:, [0, 2]], columns[:, None] - a[:, [0, 2]]
    twice = u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]
    s = (p[..., 0] * w[:, 1] - p[..., 1] * w[:, 0]) / twice
    t = (u[:, 0] * p[..., 1] - u[:, 1] * p[..., 0]) / twice
    y = np.where((s >= 0.0) & (t >= 0.0) & (s + t <= 1.0), a[:, 1] + s * (b - a)[:, 1] + t * (c - a)[:, 1], np.nan)
    found = side * np.where(np.isnan(y), -np.inf, side * y).max(1)
    return np.where(np.isinf(found), np.nan, found)


def stack(method: str) -> list[float]:
    """Of the demo's stack at rest, over all columns: the deepest overlap, and the widest gap where a face lies on a
    face, as parts of the spacing of the finer one of two neighbours."""
    simulation = Simulation(load("stack"), method=method)
    simulation.advance(1.5)
    body, x = simulation.body, simulation.x.astype(float)
    surfaces = [(x, body.bare_surface[body.jello[body.bare_surface[:, 0]] == j]) for j in range(3)]
    surfaces.append((body.skin_points(x), body.skin))
    columns = np.stack(np.meshgrid(*(np.arange(-ACROSS, ACROSS, COLUMN),) * 2), -1).reshape(-1, 2)
    overlap, gap = 0.0, 0.0
    for low, high, spacing in ((0, 2, 0.1), (1, 2, 0.1), (2, 3, 0.5 / 6)):
        apart = heights(*surfaces[high], columns, -1.0) - heights(*surfaces[low], columns, 1.0)
        overlap = max(overlap, -float(np.nanmin(apart)) / spacing)
        gap = max(gap, float(np.nanmax(apart)) / spacing) if high < 3 else gap
    return [overlap, gap]


def drift(method: str) -> list[float]:
    """Of two cubes that hit each other askew in free space: how far their momentum strays, as a part of m |v|."""
    cube = Box(points=(4, 4, 4), velocity=(1.5, 0.0, 0.0))
    other = replace(cube, position=(1.2, 0.2, 0.3), rotation=(10.0, 20.0, 30.0), velocity=(-1.5, 0.0, 0.0))
    simulation = Simulation(
        Scene(gravity=(0.0, 0.0, 0.0), jello=[cube, replace(other, spin=(0.0, 1.0, 0.0))]), method=method
    )
    mass = simulation.body.mass[:, None]
    before, size = mass * simulation.v.astype(float), float(np.sum(mass * np.abs(simulation.v)))
    strayed = 0.0
    for _ in range(60):
        simulation.frame()
        strayed = max(strayed, float(np.abs((mass * simulation.v.astype(float) - before).sum(0)).max()))
    return [strayed / size]


def foot(method: str) -> list[float]:
    """Of the demo's rabbit when it has come to rest: how far its lowest point is from the ground, as a part of its
    height."""
    scene = load("rabbit")
    simulation = Simulation(replace(scene, drag=2.0), method=method)
    simulation.advance(2.5)
    points = simulation.body.skin_points(simulation.x.astype(float))
    return [abs(float(points[:, 1].min())) / float(np.ptp(simulation.body.skin_points(simulation.body.rest)[:, 1]))]


def fall(method: str) -> list[float]:
    """Of a cube, twisted at first, whose springs melt to nothing: how far from free fall its middle comes, as a part
    of how far it has fallen."""
    melt = [Keyframe(time=0.1), Keyframe(time=0.2, stiffness=1.0), Keyframe(time=0.4, stiffness=0.0)]
    simulation = Simulation(Scene(jello=[Box(points=(4, 4, 4), keyframe=melt)]), method=method)
    simulation.restore(Snapshot(0.0, twisted(simulation.body.x), simulation.v))
    start, strayed = simulation.x.astype(float).mean(0), 0.0
    for _ in range(60):
        simulation.frame()
        fallen = [0.0, 0.5 * simulation.scene.gravity[1] * simulation.time**2, 0.0]
        strayed = max(strayed, float(np.abs(simulation.x.astype(float).mean(0) - start - fallen).max()))
    return [strayed / abs(fallen[1])]


def fed(method: str) -> list[float]:
    """Of a ring and a rope dropped from 2 m, until they lie on each other: the most energy that comes from nowhere, as
    a part of all that there is at first. (Where a rope leaves a solid its contacts have no potential.)"""
    ring = Ring(radius=0.3, thickness=0.15, points=(20, 3), rotation=(90.0, 0.0, 0.0), position=(0.0, 2.0, 0.0))
    rope = Rope(points=25, length=1.6, rotation=(0.0, 30.0, 0.0), position=(0.0, 2.4, 0.02))
    soft = [replace(jello, mass=mass, stiffness=150.0, damping=0.1) for jello, mass in ((ring, 0.5), (rope, 0.3))]
    simulation = Simulation(Scene(jello=soft, collider=[Plane()]), method=method, ledger=True)
    energy, most = sum(simulation.energies().values()), 0.0
    for _ in range(240):
        simulation.frame()
        most = max(most, simulation.energy_residual)
    return [most / energy]


def across(points: int, thick: float, aside: float, rotation: tuple[float, float, float]) -> Scene:
    """A bar of 1.6 m and `points` along it, held at its ends, and a softer one, of MASS, that falls HEIGHT across it,
    `aside` [m] from its middle."""
    bar = Box(points=(points, 2, 2), size=(1.6, thick, thick), stiffness=2000.0, damping=1.0)
    falls = replace(bar, position=(aside, HEIGHT, aside), rotation=rotation, mass=MASS, stiffness=500.0, damping=0.2)
    ends = [Pin(max=(0.001, 1.0, 1.0)), Pin(min=(0.999, 0.0, 0.0))]
    return Scene(jello=[replace(bar, pin=ends), falls])


def crossing(scene: Scene, method: str) -> tuple[bool, float]:
    """Whether the second bar goes through the first one, and the most energy [J] that comes from nowhere."""
    simulation, most = Simulation(scene, method=method, ledger=True), 0.0
    watch = watched(simulation.body)
    for _ in range(90):
        watch.look(simulation.x.astype(float), False)
        simulation.frame()
        most = max(most, simulation.energy_residual)
    watch.look(simulation.x.astype(float), False)
    return watch.went, most


def bars(method: str) -> list[float]:
    """Of each of BARS: how many of the falling ones go through, and the most energy that comes from nowhere, as a part
    of what the fall gives."""
    found = [crossing(across(*bar), method) for bar in BARS]
    return [sum(went for went, _ in found), max(most for _, most in found) / (MASS * 9.81 * HEIGHT)]


def hung(points: int, method: str, gravity: float, drag: float) -> Simulation:
    box = replace(CUBE, points=(points,) * 3, damping_ratio=1.0 if drag else 0.0)
    scene = Scene(gravity=(0.0, gravity, 0.0), jello=[box], drag=drag, solver=Solver(frame_dt=1 / 60))
    return Simulation(scene, method=method)


def sag(points: int, method: str) -> float:
    """By how much [m] the lower end of a cube of 1 m hangs lower, with so many points along an edge."""
    simulation = hung(points, method, WEIGHT, 3.0)
    low = simulation.body.rest[:, 1] < simulation.body.rest[:, 1].min() + 1e-9
    before = float(simulation.x[low, 1].mean())
    simulation.advance(5.0)
    return before - float(simulation.x[low, 1].mean())


def swing(points: int, method: str) -> float:
    """How often a second its lower end swings to the side, without weight: from when it first comes back."""
    simulation = hung(points, method, 0.0, 0.0)
    rest, x = simulation.body.rest, simulation.x
    low = rest[:, 1] < rest[:, 1].min() + 1e-9
    v = np.zeros_like(x)
    v[:, 0] = 0.02 * (rest[:, 1].max() - rest[:, 1])
    simulation.restore(Snapshot(0.0, x, v))
    there = float(x[low, 0].mean())
    time, before = 0.0, 0.0
    while True:
        simulation.frame()
        now = float(simulation.x[low, 0].mean()) - there
        if now <= 0.0 < before:
            return 0.5 / (time + (simulation.time - time) * before / (before - now))
        time, before = simulation.time, now


def finer(method: str) -> list[float]:
    """By how much sag and swing of few points an edge and of many differ, as parts of those of many."""
    found = [[measured(points, method) for points in POINTS] for measured in (sag, swing)]
    return [abs(few - many) / many for few, many in found]


# What is measured, and of each of its figures what it is, and what it may come to.
HELD: tuple[tuple[Callable[[str], list[float]], tuple[tuple[str, float], ...]], ...] = (
    (stack, (("stack at rest: overlap, of the spacing", 0.05), ("stack at rest: gap, of the spacing", 0.05))),
    (drift, (("two cubes collide in free space: drift of momentum", 1e-6),)),
    (foot, (("rabbit at rest: lowest point from the ground, of its height", 0.01),)),
    (fed, (("rope and ring dropped from 2 m: energy from nowhere, of all", 0.05),)),
    (
        bars,
        (
            ("a bar falls across a held one, in four ways: how often it goes through", 0.0),
            ("a bar falls across a held one: energy from nowhere, of the fall's", 0.05),
        ),
    ),
    (fall, (("cube melts as it falls: its middle from free fall, of the way", 1e-6),)),
    (
        finer,
        (
            ("a hung cube, 8 points an edge or 16: difference of sag", 0.05),
            ("a hung cube, 8 points an edge or 16: difference of swing", 0.05),
        ),
    ),
)


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """A row for each figure; with --quick none of the rabbit, of ropes, of bars and of 16 points an edge. --method:
    another than auto. Raises SceneError for an unknown one."""
    method = chosen.method or AUTO
    check(method)
    work = [held for held in HELD if not chosen.quick or held[0] not in (foot, fed, bars, finer)]
    told: dict[str, Any] = machine() | {"method": method, "precision": chosen.precision, "rows": []}
    take(chosen, told, pieces(chosen, work, method, told), "bodies", len(work))
    return told


def pieces(chosen: argparse.Namespace, work: list[Any], method: str, told: dict[str, Any]) -> Iterator[None]:
    for measured, named in work:
        runtime.start(chosen.arch, chosen.precision, chosen.threads)
        for (what, most), value in zip(named, measured(method), strict=True):
            told["rows"].append({"what": what, "value": value, "most": most, "held": value <= most})
        yield


def text(told: dict[str, Any]) -> str:
    lines = [
        (row["what"], f"{row['value']:.2g}", f"{row['most']:g}", "" if row["held"] else "NOT HELD")
        for row in told["rows"]
    ]
    return "\n".join(
        [headline(told), table(("figure", "is", "held to", ""), lines), *["interrupted"] * told["interrupted"]]
    )


def rows(told: dict[str, Any]) -> list[dict[str, Any]]:
    return list(told["rows"])
