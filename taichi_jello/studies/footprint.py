"""What each scene compiles in and leaves out, what that costs to compile, to keep and to step, feature by feature."""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import ceil, floor, sqrt
from typing import Any

import taichi as ti

from taichi_jello import scenefiles
from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.physics.colliders.sphere import Sphere
from taichi_jello.physics.forces.field import UniformField
from taichi_jello.physics.forces.grab import Grab
from taichi_jello.run.clock import StepWarning
from taichi_jello.run.explain import facts
from taichi_jello.run.simulation import Simulation
from taichi_jello.scene.description import Contact, Pin, Scene, SceneError, Solver
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies._report import headline, in_turns, machine, summed_up, table, take
from taichi_jello.support import runtime

MANY = True  # scenes in one call
STEPS = 200  # of a frame
DT = 1e-6  # s: nothing moves far
LEAST, REPEATS = 0.02, 21  # s a timing, timings: short and many, most of which no interruption reaches
# How well what a feature adds is to be known, and how often timings are taken for that, at least and at most.
SURE, FEWEST, ROUNDS = 0.005, 3, 9
KINDS = ("absent", "unused", "used")  # what a feature is in a scene
CUBE = Box(damping=0.0)
BARE = Scene(gravity=(0.0, 0.0, 0.0), jello=[CUBE], solver=Solver(frame_dt=STEPS * DT))
ON_PLANE = replace(BARE, collider=[Plane(point=(0.0, -0.501, 0.0))], contact=Contact(friction=0.0))
TWO = replace(BARE, jello=[CUBE, Box(points=(4, 4, 4), position=(3.0, 0.0, 0.0), damping=0.0)])


@dataclass(frozen=True)
class Feature:
    """One thing a scene may have: a scene without it, the same that mentions it and does not use it, and with it."""

    name: str
    absent: Scene
    unused: Scene
    used: Scene
    ledger: bool = False


FEATURES = (
    Feature("dashpots", BARE, replace(BARE, jello=[replace(CUBE, damping=0.0)]), replace(BARE, jello=[Box()])),
    Feature("gravity", BARE, replace(BARE, gravity=(0.0, 0.0, 0.0)), replace(BARE, gravity=(0.0, -9.81, 0.0))),
    Feature("drag", BARE, replace(BARE, drag=0.0), replace(BARE, drag=0.5)),
    Feature("contact", BARE, replace(ON_PLANE, contact=Contact(stiffness=0.0)), ON_PLANE),
    Feature(
        "friction", ON_PLANE, replace(ON_PLANE, contact=Contact(friction=0.0)), replace(ON_PLANE, contact=Contact())
    ),
    Feature(
        "sphere",
        ON_PLANE,
        replace(ON_PLANE, collider=[*ON_PLANE.collider]),
        replace(ON_PLANE, collider=[*ON_PLANE.collider, Sphere(center=(0.0, -3.0, 0.0))]),
    ),
    Feature(
        "touching jellos", replace(TWO, contact=Contact(stiffness=0.0)), replace(TWO, contact=Contact(touch=False)), TWO
    ),
    Feature(
        "pins",
        BARE,
        replace(BARE, jello=[replace(CUBE, pin=[])]),
        replace(BARE, jello=[replace(CUBE, pin=[Pin(max=(0.0, 1.0, 1.0))])]),
    ),
    Feature(
        "uniform field",
        BARE,
        replace(BARE, force=[UniformField(force=(0.0, 0.0, 0.0))]),
        replace(BARE, force=[UniformField(force=(0.0, 0.1, 0.0))]),
    ),
    Feature("hand", BARE, BARE, replace(BARE, force=[Grab()])),
    Feature(
        "ledger", replace(BARE, jello=[Box()]), replace(BARE, jello=[Box()]), replace(BARE, jello=[Box()]), ledger=True
    ),
)


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """All figures; with --quick one demo and short timings."""
    scenes = chosen.scenes or (["family"] if chosen.quick else list(scenefiles.demos()))
    for name in scenes:
        scenefiles.load(name)  # a scene that cannot be is told before anything runs
    features: tuple[Feature, ...] = () if chosen.scenes else FEATURES[:4] if chosen.quick else FEATURES
    told: dict[str, Any] = machine() | {"scenes": [], "features": []}
    take(chosen, told, pieces(chosen, scenes, features, told), "footprint", len(scenes) + len(features))
    return told


def pieces(chosen: argparse.Namespace, scenes: list[str], features: Any, told: dict[str, Any]) -> Iterator[None]:
    for feature in features:
        told["features"].append(feature_row(feature, chosen))
        yield
    for name in scenes:
        told["scenes"].append(scene_row(name, chosen))
        yield


def feature_row(feature: Feature, chosen: argparse.Namespace) -> dict[str, Any]:
    """Bytes and step time of a scene that has never had the feature, has it without use, and uses it. Each round makes
    them anew, another one first: where fields come to lie is worth some per cent, too."""
    turns: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for number in range(1 if chosen.quick else ROUNDS):
        runtime.start(chosen.arch, chosen.precision, 1)
        made = {kind: stepped(feature, kind, chosen) for kind in KINDS[number % 3 :] + KINDS[: number % 3]}
        times = in_turns(list(map(stepping, made.values())), *((0.01, 3) if chosen.quick else (LEAST, REPEATS)))
        for kind, more in zip(made, times, strict=True):
            turns[kind] += more
        unused, unused_within = added(turns["unused"], turns["absent"])
        use, use_within = added(turns["used"], turns["absent"])
        if number + 1 >= FEWEST and unused_within <= SURE:
            break
    seconds = {kind: summed_up(found) for kind, found in turns.items()}
    size = {kind: sum(size for *_, size in one.system.memory.fields) for kind, one in made.items()}
    return {
        "feature": feature.name,
        "us_a_step": {kind: {n: 1e6 * s / STEPS for n, s in found.items()} for kind, found in seconds.items()},
        "unused_costs": unused,
        "unused_costs_within": unused_within,
        "use_costs": use,
        "use_costs_within": use_within,
        "turns": len(turns["absent"]),
        "same_code": parts(made["unused"]) == parts(made["absent"]),
        "spread": seconds["absent"]["median"] / seconds["absent"]["min"] - 1.0,
        "bytes": size["absent"],
        "unused_bytes": size["unused"] - size["absent"],
        "use_bytes": size["used"] - size["absent"],
    }


def stepped(feature: Feature, kind: str, chosen: argparse.Namespace) -> Simulation:
    """A simulation of one of its scenes."""
    keeps = feature.ledger and kind == "used"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)
        method = chosen.method or "symplectic-euler"
        return Simulation(getattr(feature, kind), method=method, substeps=STEPS, ledger=keeps)


def stepping(simulation: Simulation) -> Any:
    def run() -> None:
        simulation.system.steps(0, STEPS, DT)
        ti.sync()

    return run


def added(having: list[float], without: list[float]) -> tuple[float, float]:
    """The part of its time by which a step is longer: the median over turns, in each of which both met the same
    machine; and how far from it the true one is at most, at 95 %, whatever the spread is like: that lies between the
    ratios of rank n/2 ± 0.98 √n (Conover, Practical Nonparametric Statistics, 3.2)."""
    ratios = sorted(a / b - 1.0 for a, b in zip(having, without, strict=True))
    n, middle = len(ratios), statistics.median(ratios)
    low, high = max(0, floor(n / 2 - 0.98 * sqrt(n))), min(n - 1, ceil(n / 2 + 0.98 * sqrt(n)))
    return middle, max(middle - ratios[low], ratios[high] - middle)


def parts(simulation: Simulation) -> list[str]:
    """What the step is compiled from."""
    told = facts(simulation)
    return [*told["compiled_in"], told["form"]]


def scene_row(name: str, chosen: argparse.Namespace) -> dict[str, Any]:
    """What a fresh process says of a scene, with an empty kernel cache and again with what that has left."""
    given = {
        "--arch": chosen.arch,
        "--precision": chosen.precision,
        "--threads": chosen.threads,
        "--method": chosen.method,
    }
    arguments = [word for option, value in given.items() if value for word in (option, str(value))]
    arguments += [f"--set={key}={json.dumps(value)}" for key, value in chosen.settings]
    found = []
    with tempfile.TemporaryDirectory() as cache:
        for _ in ("cold", "warm"):
            command = [sys.executable, "-m", "taichi_jello.studies._probe", name, *arguments]
            environment = {**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": cache}
            done = subprocess.run(command, capture_output=True, text=True, env=environment)
            if done.returncode:
                raise SceneError(name, done.stderr.strip().rpartition("\n")[2] or "could not be made")
            found.append(json.loads(done.stdout))
    cold, warm = found
    told = cold["facts"]
    return {
        "scene": name,
        **{key: told[key] for key in ("particles", "compiled_in", "left_out", "bytes")},
        "springs": sum(told["springs"].values()),
        "kernels": len(cold["kernels"]),
        "cold_seconds": cold["seconds"],
        "warm_seconds": warm["seconds"],
        "ms_a_frame": 1e3 * min(cold["frame_seconds"], warm["frame_seconds"]),
    }


def rows(told: dict[str, Any]) -> list[dict[str, Any]]:
    """The features, as flat lines."""
    return [dict(row) for row in told["features"]]


def text(told: dict[str, Any]) -> str:
    """The figures as tables."""
    lines = [headline(told)]
    if told["features"]:
        heads = ["feature", "us a step without", "unused adds", "bytes", "code", "use adds", "bytes", "spread"]
        cells = [
            [
                row["feature"],
                f"{row['us_a_step']['absent']['min']:.2f}",
                f"{100 * row['unused_costs']:+.1f} ± {100 * row['unused_costs_within']:.1f} %",
                f"{row['unused_bytes']:+d}",
                "the same" if row["same_code"] else "more",
                f"{100 * row['use_costs']:+.1f} ± {100 * row['use_costs_within']:.1f} %",
                f"{row['use_bytes']:+d}",
                f"{100 * row['spread']:.1f} %",
            ]
            for row in told["features"]
        ]
        lines += ["a step of the 8x8x8 cube, minimum; spread: median over minimum"]
        lines += ["what is added: median over turns ± within what it lies at 95 %"]
        lines += [table(heads, cells), ""]
    if told["scenes"]:
        heads = ["scene", "particles", "springs", "bytes", "kernels", "cold [s]", "warm [s]", "ms a frame"]
        keys = ("scene", "particles", "springs", "bytes", "kernels")
        times = ("cold_seconds", "warm_seconds", "ms_a_frame")
        cells = [[*(str(row[key]) for key in keys), *(f"{row[key]:.2f}" for key in times)] for row in told["scenes"]]
        lines += ["from the scene to its first frame, in a fresh process with an empty and with a warm kernel cache;"]
        lines += ["then physics of one frame of the jellos' first seconds, median"]
        lines += [table(heads, cells)]
        for row in told["scenes"]:
            lines += [f"{row['scene']}: {', '.join(row['compiled_in'])}", f"  without {', '.join(row['left_out'])}"]
    if told["interrupted"]:
        lines.append("interrupted: the tables hold what was measured until then")
    return "\n".join(lines)


def plot(told: dict[str, Any], path: Any) -> None:
    """What every feature adds to a step, unused and used. Raises Lacking."""
    from taichi_jello.studies._report import new_figure, save_figure

    figure = new_figure(7.0, 1.0 + 0.35 * max(1, len(told["features"])))
    axes = figure.subplots()
    names = [row["feature"] for row in told["features"]]
    for k, (key, label) in enumerate((("unused_costs", "mentioned, unused"), ("use_costs", "used"))):
        places = [n + 0.4 * k for n in range(len(names))]
        axes.barh(places, [100 * row[key] for row in told["features"]], 0.38, label=label)
    axes.set_yticks([n + 0.2 for n in range(len(names))], names)
    axes.axvline(2.0, color="0.5", lw=1, ls=":")
    axes.invert_yaxis()
    axes.set_xlabel("added to the time of a step [%] (dotted: 2 %)")
    axes.legend(fontsize=8)
    save_figure(figure, path)
