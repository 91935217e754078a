"""What each scene compiles in and leaves out, and what each feature costs in bytes and in the time of a step."""

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import ceil, floor, sqrt
from pathlib import Path
from typing import Any

from taichi_jello import scenefiles
from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.physics.colliders.sphere import Sphere
from taichi_jello.physics.forces.field import UniformField
from taichi_jello.physics.forces.grab import Grab
from taichi_jello.run.explain import facts
from taichi_jello.run.simulation import Simulation
from taichi_jello.scene.description import Contact, Pin, Scene, SceneError, Solver
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies import _report as report
from taichi_jello.support import runtime

MANY = True  # scenes in one call
STEPS = 200  # a frame
DT = 1e-6  # s: so short that nothing moves far
SHORTEST, REPEATS = 0.02, 21  # s a timing, and timings: short and many, so that most are not interrupted
PRECISE, MIN_ROUNDS, MAX_ROUNDS = 0.005, 3, 9  # rounds of timings are added until the cost is known this well
MEASURED_SECONDS, MIN_FRAMES = 0.5, 3  # of a scene, after its first frame
KINDS = ("absent", "unused", "used")
CUBE, DAMPED = Box(damping=0.0), Box()
BARE = Scene(gravity=(0.0, 0.0, 0.0), jello=[CUBE], solver=Solver(frame_dt=STEPS * DT))
PLANE = Plane(point=(0.0, -0.501, 0.0))
GROUND = {"collider": [PLANE]}
NO_CONTACT, FRICTIONLESS = Contact(stiffness=0.0), Contact(friction=0.0)
ON_PLANE = replace(BARE, collider=[PLANE], contact=FRICTIONLESS)
OTHER = Box(points=(4, 4, 4), position=(3.0, 0.0, 0.0), damping=0.0)
TWO = replace(BARE, jello=[CUBE, OTHER], contact=NO_CONTACT)
HELD = replace(CUBE, pin=[Pin(max=(0.0, 1.0, 1.0))])
NO_FIELD, FIELD = UniformField(force=(0.0, 0.0, 0.0)), UniformField(force=(0.0, 0.1, 0.0))


@dataclass(frozen=True)
class Feature:
    """Something a scene may have, as changes of `absent`, a scene without it: one that mentions it, and one that uses
    it. ledger: whether the feature is the energy ledger."""

    name: str
    absent: Scene
    unused: dict[str, Any]
    used: dict[str, Any] = field(default_factory=dict)
    ledger: bool = False

    def simulation(self, kind: str, method: str) -> Simulation:
        changes = {"absent": {}, "unused": self.unused, "used": self.used}[kind]
        scene, ledger = replace(self.absent, **changes), self.ledger and kind == "used"
        return Simulation(scene, method=method, substeps=STEPS, ledger=ledger)


FEATURES = (
    Feature("dashpots", BARE, {"jello": [replace(CUBE, damping=0.0)]}, {"jello": [DAMPED]}),
    Feature("gravity", BARE, {"gravity": (0.0, 0.0, 0.0)}, {"gravity": (0.0, -9.81, 0.0)}),
    Feature("drag", BARE, {"drag": 0.0}, {"drag": 0.5}),
    Feature("contact", BARE, GROUND | {"contact": NO_CONTACT}, GROUND | {"contact": FRICTIONLESS}),
    Feature("friction", ON_PLANE, {"contact": Contact(friction=0.0)}, {"contact": Contact()}),
    Feature("sphere", ON_PLANE, GROUND, {"collider": [PLANE, Sphere(center=(0.0, -3.0, 0.0))]}),
    Feature("touching jellos", TWO, {"contact": Contact(touch=False)}, {"contact": Contact()}),
    Feature("pins", BARE, {"jello": [replace(CUBE, pin=[])]}, {"jello": [HELD]}),
    Feature("uniform field", BARE, {"force": [NO_FIELD]}, {"force": [FIELD]}),
    Feature("hand", BARE, {}, {"force": [Grab()]}),
    Feature("ledger", replace(BARE, jello=[DAMPED]), {}, ledger=True),
)


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """All figures; with --quick one demo and short timings. Raises SceneError for a wrong scene before it measures."""
    scenes: dict[str, Scene] = {}
    for name in chosen.scenes or (["family"] if chosen.quick else scenefiles.demos()):
        chosen.scene = name
        scenes[name] = chosen.load()
    features: tuple[Feature, ...] = () if chosen.scenes else FEATURES[:4] if chosen.quick else FEATURES
    results: dict[str, Any] = report.machine() | {"scenes": [], "features": []}
    report.take(chosen, results, pieces(chosen, scenes, features, results), "footprint", len(scenes) + len(features))
    return results


def pieces(
    chosen: argparse.Namespace, scenes: dict[str, Scene], features: tuple[Feature, ...], results: dict[str, Any]
) -> Iterator[None]:
    for feature in features:
        results["features"].append(feature_row(feature, chosen))
        yield
    for name, scene in scenes.items():
        results["scenes"].append(scene_row(name, scene, chosen))
        yield


def feature_row(feature: Feature, chosen: argparse.Namespace) -> dict[str, Any]:
    """Bytes and step time of the three scenes of a feature. Each round makes them anew, in another order, since the
    addresses of the fields cost some per cent, too."""
    turns: dict[str, list[float]] = {kind: [] for kind in KINDS}
    method = chosen.method or "symplectic-euler"
    for number in range(1 if chosen.quick else MAX_ROUNDS):
        runtime.start(chosen.arch, chosen.precision, 1)
        order = KINDS[number % 3 :] + KINDS[: number % 3]
        made = {kind: feature.simulation(kind, method) for kind in order}
        runs = [report.stepping(simulation, STEPS, DT) for simulation in made.values()]
        times = report.interleaved(runs, *((0.01, 3) if chosen.quick else (SHORTEST, REPEATS)))
        for kind, more in zip(made, times, strict=True):
            turns[kind] += more
        if number + 1 >= MIN_ROUNDS and added(turns["unused"], turns["absent"])[1] <= PRECISE:
            break
    seconds = {kind: report.min_and_median(found) for kind, found in turns.items()}
    size = {kind: sum(size for *_, size in one.system.memory.fields) for kind, one in made.items()}
    return {
        "feature": feature.name,
        "us_a_step": {kind: {n: 1e6 * s / STEPS for n, s in found.items()} for kind, found in seconds.items()},
        **dict(zip(("unused_costs", "unused_costs_within"), added(turns["unused"], turns["absent"]), strict=True)),
        **dict(zip(("use_costs", "use_costs_within"), added(turns["used"], turns["absent"]), strict=True)),
        "turns": len(turns["absent"]),
        "same_code": compiled_parts(made["unused"]) == compiled_parts(made["absent"]),
        "spread": seconds["absent"]["median"] / seconds["absent"]["min"] - 1.0,
        "bytes": size["absent"],
        "unused_bytes": size["unused"] - size["absent"],
        "use_bytes": size["used"] - size["absent"],
    }


def added(having: list[float], without: list[float]) -> tuple[float, float]:
    """The fraction by which a step is longer, and its error at 95 % confidence. The fraction is the median over turns,
    in each of which the machine was the same for both; whatever the distribution, the true one lies between the ratios
    of rank n/2 ± 0.98 √n (Conover, Practical Nonparametric Statistics, 3.2)."""
    ratios = sorted(a / b - 1.0 for a, b in zip(having, without, strict=True))
    n, middle = len(ratios), statistics.median(ratios)
    low, high = max(0, floor(n / 2 - 0.98 * sqrt(n))), min(n - 1, ceil(n / 2 + 0.98 * sqrt(n)))
    return middle, max(middle - ratios[low], ratios[high] - middle)


def compiled_parts(simulation: Simulation) -> list[str]:
    """What the step is compiled from."""
    found = facts(simulation)
    return [*found["compiled_in"], found["form"]]


def scene_row(name: str, scene: Scene, chosen: argparse.Namespace) -> dict[str, Any]:
    """What a scene compiles, its bytes, and its times with an empty and with a full kernel cache.
    Raises SceneError if it cannot be simulated."""
    first: list[float] = []
    later: list[float] = []
    with tempfile.TemporaryDirectory() as cache:
        for _ in ("cold", "warm"):
            with kernel_cache(cache):
                runtime.start(chosen.arch, chosen.precision, chosen.threads)
            start = time.perf_counter()
            try:
                simulation = Simulation(scene, method=chosen.method)
            except SceneError as error:
                raise scenefiles.located(name, error) from None
            simulation.frame()
            first.append(time.perf_counter() - start)
            later.append(frame_seconds(simulation))
        found = facts(simulation)
        runtime.start()  # only now Taichi writes what was compiled
        kernels = len(list(Path(cache).rglob("*.tic")))  # one file each
    return {
        "scene": name,
        **{key: found[key] for key in ("particles", "compiled_in", "left_out", "bytes")},
        "springs": sum(found["springs"].values()),
        "kernels": kernels,
        "cold_seconds": first[0],
        "warm_seconds": first[1],
        "ms_a_frame": 1e3 * min(later),
    }


@contextmanager
def kernel_cache(folder: str) -> Iterator[None]:
    """Within, Taichi starts with its kernel cache in this folder."""
    name = "TI_OFFLINE_CACHE_FILE_PATH"
    before = os.environ.get(name)
    os.environ[name] = folder
    try:
        yield
    finally:
        os.environ.pop(name)
        if before is not None:
            os.environ[name] = before


def frame_seconds(simulation: Simulation) -> float:
    """The median time of the next frames, of half a second of them or as many as the scene has."""
    times: list[float] = []
    while sum(times) < MEASURED_SECONDS and (len(times) < MIN_FRAMES or simulation.time < simulation.scene.seconds):
        times.append(report.seconds_of(simulation.frame))
    return statistics.median(times)


def rows(results: dict[str, Any]) -> list[dict[str, Any]]:
    """The features, as flat lines."""
    return list(results["features"])


def text(results: dict[str, Any]) -> str:
    lines = [report.headline(results)]
    if results["features"]:
        heads = ["feature", "us a step without", "unused adds", "bytes", "code", "use adds", "bytes", "spread"]
        cells = [
            [
                row["feature"],
                f"{row['us_a_step']['absent']['min']:.2f}",
                *costs(row, "unused"),
                "the same" if row["same_code"] else "more",
                *costs(row, "use"),
                f"{100 * row['spread']:.1f} %",
            ]
            for row in results["features"]
        ]
        lines += ["a step of the 8x8x8 cube, minimum; spread: median over minimum"]
        lines += ["what is added: median over turns ± its error at 95 % confidence"]
        lines += [report.table(heads, cells), ""]
    if results["scenes"]:
        heads = ["scene", "particles", "springs", "bytes", "kernels", "cold [s]", "warm [s]", "ms a frame"]
        times = ("cold_seconds", "warm_seconds", "ms_a_frame")
        cells = [
            [*(str(row[key]) for key in heads[:5]), *(f"{row[key]:.2f}" for key in times)] for row in results["scenes"]
        ]
        lines += ["from the scene to its first frame, with an empty and with a warm kernel cache;"]
        lines += ["then physics of one frame of the jellos' first seconds, median"]
        lines += [report.table(heads, cells)]
        for row in results["scenes"]:
            lines += [f"{row['scene']}: {', '.join(row['compiled_in'])}", f"  without {', '.join(row['left_out'])}"]
    return "\n".join(lines + [report.INTERRUPTED] * results["interrupted"])


def costs(row: dict[str, Any], kind: str) -> tuple[str, str]:
    """The time and the bytes that a feature adds."""
    return (
        f"{100 * row[f'{kind}_costs']:+.1f} ± {100 * row[f'{kind}_costs_within']:.1f} %",
        f"{row[f'{kind}_bytes']:+d}",
    )


def plot(results: dict[str, Any], path: Path) -> None:
    """What every feature adds to a step, unused and used. Raises Lacking."""
    figure = report.new_figure(7.0, 1.0 + 0.35 * max(1, len(results["features"])))
    axes = figure.subplots()
    names = [row["feature"] for row in results["features"]]
    for k, (key, label) in enumerate((("unused_costs", "mentioned, unused"), ("use_costs", "used"))):
        places = [n + 0.4 * k for n in range(len(names))]
        axes.barh(places, [100 * row[key] for row in results["features"]], 0.38, label=label)
    axes.set_yticks([n + 0.2 for n in range(len(names))], names)
    axes.axvline(2.0, color="0.5", lw=1, ls=":")
    axes.invert_yaxis()
    axes.set_xlabel("added to the time of a step [%] (dotted: 2 %)")
    axes.legend(fontsize=8)
    report.save_figure(figure, path)
