"""Error against run time: every method on a ladder of steps, in both precisions, against a reference to 12 digits."""

import argparse
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello import runtime
from taichi_jello.clock import StepWarning
from taichi_jello.physics.integrators import scheme, schemes
from taichi_jello.progress import bar
from taichi_jello.simulation import Diverged, Simulation
from taichi_jello.studies._cases import Case, built_in, case_of
from taichi_jello.studies._report import headline, machine, table
from taichi_jello.studies._truth import Truth, rms, roll_out, truth
from taichi_jello.studies._verdict import FRAME, conclude
from taichi_jello.words import plain

RUNGS, LEAST_RUNGS = 8, 4  # steps on a ladder, each half of the one before
TIMINGS, LEAST_TIMINGS = 7, 1
LONG = 0.2  # s that one timing lasts, if there is time for it
SECONDS = {False: 80.0, True: 4.0}  # for all timings together, by --quick
TOLERANCES = (1e-1, 1e-3)  # that implicit steps are solved to, where their own is smaller
SPRINGS = 1e8  # that are passed in a second, about: it turns seconds into work, so that a rerun has the same ladders


@dataclass
class Roll:
    """One point of the diagram: its figures, the simulation it was made with, and the seconds each timing took."""

    point: dict[str, Any]
    simulation: Simulation
    seconds: list[float]


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """All figures; with --quick the smooth case on a small lattice. Raises SceneError for an unknown method."""
    cases = asked_for(chosen)
    methods = chosen.method.split(",") if chosen.method else sorted(schemes())
    for method in methods:
        scheme(method)
    arch = runtime.choose_arch(chosen.arch)
    precisions = ["f32"] if arch in ("vulkan", "metal") else ["f64", "f32"]
    told: dict[str, Any] = machine() | {"arch": arch, "cases": [], "interrupted": False}
    budget = SECONDS[chosen.quick] / len(cases) / len(precisions)
    total = len(cases) * (1 + len(precisions) * (len(methods) + 1))
    try:
        for _ in bar(
            pieces(chosen, cases, precisions, methods, budget, told), "accuracy", quiet=chosen.quiet, total=total
        ):
            pass
    except KeyboardInterrupt:
        told["interrupted"] = True
    for case in told["cases"]:
        case.update(conclude(case))
    return told


def asked_for(chosen: argparse.Namespace) -> list[Case]:
    known = built_in(chosen.quick)
    if chosen.scene is None:
        return [known["smooth"]] if chosen.quick else list(known.values())
    return [known[chosen.scene]] if chosen.scene in known else [case_of(chosen.load(), chosen.seconds)]


def pieces(
    chosen: argparse.Namespace,
    cases: list[Case],
    precisions: list[str],
    methods: list[str],
    budget: float,
    told: dict[str, Any],
) -> Iterator[None]:
    """The work in pieces of some seconds, each of which leaves what it found in `told`."""
    for case in cases:
        exact = truth(case)
        points: list[dict[str, Any]] = []
        told["cases"].append(about(case, exact) | {"points": points})
        yield
        ladders: dict[str, list[int]] = {}
        for precision in precisions:
            told["threads"] = runtime.start(told["arch"], precision, chosen.threads).threads
            rolls: list[Roll] = []
            for method in methods:
                for roll in climb(case, exact, method, ladders, budget / len(methods), chosen):
                    rolls.append(roll)
                    points.append(roll.point)
                yield
            time_in_turns(case, rolls, budget)
            yield


def about(case: Case, exact: Truth) -> dict[str, Any]:
    return {
        "case": case.name,
        "shows": case.shows,
        "seconds": case.seconds,
        "edge": exact.edge,
        "particles": len(case.body),
        "springs": len(case.body.springs),
        "reference": exact.how,
        "disagreement": exact.disagreement,
        "floor": exact.floor,
        "growth": exact.growth,
        "chaotic": exact.chaotic,
        "energy_at_start": exact.energy_at_start,
        "energy": exact.energy,
    }


def climb(
    case: Case, exact: Truth, method: str, ladders: dict[str, list[int]], budget: float, chosen: argparse.Namespace
) -> Iterator[Roll]:
    """The method's points from the longest stable step down: until errors drown in the reference's own, or the work
    outgrows the budget [s]. The second precision climbs the ladder that the first has made."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)
        simulation = Simulation(case.scene, method=method, substeps=1)
    given, rungs = ladders.get(method), ladders.setdefault(method, [])
    substeps = given[0] if given else coarsest(simulation, chosen)
    roll_out(simulation, case, substeps, case.start(simulation.body.x))  # compiles the kernels
    for rung in range(len(given) if given else 1 if chosen.substeps or chosen.dt else RUNGS):
        roll = one_point(case, exact, simulation, given[rung] if given else substeps)
        yield roll
        for tolerance in looser(simulation):
            yield one_point(case, exact, simulation, roll.point["steps"] // case.frames, tolerance)
        if given:
            continue
        rungs.append(substeps)
        work = roll.point["passes"] * len(simulation.body.springs) / SPRINGS
        enough = rung + 1 >= LEAST_RUNGS and 2.0 * work > 0.5 * budget / TIMINGS
        if enough or roll.point["error"] < exact.floor:
            return
        substeps *= 2


def looser(simulation: Simulation) -> list[float]:
    """The ladder of tolerances that the method's own leaves."""
    integrator = simulation.system.integrator
    return [one for one in TOLERANCES if one > 2.0 * integrator.solver.accuracy] if integrator.solves else []


@contextmanager
def solved_to(simulation: Simulation, tolerance: float | None) -> Iterator[None]:
    """Within, implicit steps are solved to this tolerance; to the method's own if it is None."""
    integrator = simulation.system.integrator
    if tolerance is None:
        yield
        return
    own, integrator.solver.accuracy = integrator.solver.accuracy, tolerance
    integrator.tuned()
    try:
        yield
    finally:
        integrator.solver.accuracy = own
        integrator.tuned()


def coarsest(simulation: Simulation, chosen: argparse.Namespace) -> int:
    """Substeps of a frame at the bottom of the ladder: the safe step, or a drawn frame where any is safe; for a method
    without a safe step here a tenth of the time in which the fastest motion swings by one radian."""
    if chosen.substeps:
        return int(chosen.substeps)
    frame, bound = simulation.frame_dt, simulation.system.bound
    safe = bound.dt or 0.1 / sqrt(bound.squared_frequency)
    if isinstance(chosen.dt, float):
        safe = chosen.dt
    return max(1, ceil(frame / min(safe, frame if chosen.dt else FRAME) * (1.0 - 1e-9)))


def one_point(case: Case, exact: Truth, simulation: Simulation, substeps: int, tolerance: float | None = None) -> Roll:
    """Roll the case out once and compare its end with the truth."""
    body, steps, integrator = simulation.body, case.frames * substeps, simulation.system.integrator
    point: dict[str, Any] = {
        "method": simulation.method,
        "precision": simulation.system.owner.precision,
        "dt": simulation.frame_dt / substeps,
        "steps": steps,
        "passes": 0 if integrator.solves else steps * integrator.passes,
        "tolerance": tolerance or (integrator.solver.accuracy if integrator.solves else None),
        "loosened": tolerance is not None,
    }
    before = integrator.solver.passes if integrator.solves else 0
    try:
        with solved_to(simulation, tolerance):
            get_ready(simulation, substeps)
            start = time.perf_counter()
            end = roll_out(simulation, case, substeps, case.start(body.x))
    except Diverged:
        nothing = dict.fromkeys(("error", "centre", "momentum", "angular_momentum", "energy"), np.inf)
        return Roll(point | nothing | {"diverged": True, "seconds": {"min": np.inf, "median": np.inf}}, simulation, [])
    seconds = time.perf_counter() - start
    if integrator.solves:
        point["passes"] = integrator.solver.passes - before
    energy = sum(simulation.energies().values())
    x, v = end.x.astype(float), end.v.astype(float)
    moved = [(body.mass @ (a - b)) / body.mass.sum() for a, b in ((x, exact.x), (v, exact.v))]
    spin = [body.mass @ np.cross(a - exact.x.mean(0), b) for a, b in ((x, v), (exact.x, exact.v))]
    point |= {
        "error": rms(x, exact.x, exact.edge),
        "centre": float(np.linalg.norm(moved[0])) / exact.edge,
        "momentum": float(np.linalg.norm(moved[1]) * body.mass.sum()),
        "angular_momentum": float(np.linalg.norm(spin[0] - spin[1])),
        "energy": abs(energy - exact.energy),
        "diverged": False,
        "seconds": {"min": seconds, "median": seconds},
    }
    return Roll(point, simulation, [seconds])


def time_in_turns(case: Case, rolls: list[Roll], budget: float) -> None:
    """Time every roll-out several times, in turns, so that a machine which slows down for a while slows all of them.
    A timing lasts LONG if the budget [s] allows, by repeating the roll-out."""
    rolls = [roll for roll in rolls if not roll.point["diverged"]]
    share = budget / max(1, len(rolls))
    for turn in range(TIMINGS):
        for roll in rolls:
            once = roll.point["seconds"]["min"]
            if turn >= LEAST_TIMINGS and (turn + 1) * once > share:
                continue
            times = max(1, round(min(LONG, share / TIMINGS) / once))
            substeps, x = roll.point["steps"] // case.frames, case.start(roll.simulation.body.x)
            with solved_to(roll.simulation, roll.point["tolerance"] if roll.point["loosened"] else None):
                get_ready(roll.simulation, substeps)
                ti.sync()
                start = time.perf_counter()
                for _ in range(times):
                    roll_out(roll.simulation, case, substeps, x)
                ti.sync()
            roll.seconds.append((time.perf_counter() - start) / times)
            roll.point["seconds"] = {"min": min(roll.seconds), "median": float(np.median(roll.seconds))}


def get_ready(simulation: Simulation, substeps: int) -> None:
    """What is done once for a step of that length is not timed with the steps."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)
        simulation.change_step(substeps=substeps)
    if simulation.system.integrator.solves:
        simulation.system.integrator.prepare(simulation.system, simulation.dt)


def rows(told: dict[str, Any]) -> list[dict[str, Any]]:
    """Every point as one flat line."""
    return [{"case": case["case"]} | point for case in told["cases"] for point in case["points"]]


def text(told: dict[str, Any]) -> str:
    """The figures as tables, and what follows from them."""
    lines = [f"{headline(told)}; {told['arch']}, {told.get('threads', 1)} threads"]
    for case in told["cases"]:
        lines += ["", *page(case)]
    if told["interrupted"]:
        lines.append("interrupted: the tables hold what was measured until then")
    return "\n".join(lines)


def page(case: dict[str, Any]) -> list[str]:
    per_frame = 1e3 * FRAME / case["seconds"]
    cells = [
        [
            point["method"],
            point["precision"],
            f"{point['dt']:.3g}",
            str(point["passes"]),
            f"{point['tolerance']:g}" if point["tolerance"] else "-",
            "diverged" if point["diverged"] else "-" if case["chaotic"] else f"{point['error']:.2e}",
            *(f"{point[name]:.1e}" for name in ("centre", "momentum", "angular_momentum", "energy")),
            *(plain(per_frame * point["seconds"][one], 3) for one in ("min", "median")),
        ]
        for point in case["points"]
    ]
    heads = ["method", "number", "dt [s]", "passes", "solved to", "error", "centre", "dP", "dL", "dE [J]"]
    heads += ["ms a frame", "median"]
    return [
        f"{case['case']}: {case['shows'] or case['particles']}, {case['seconds']:.4g} s, "
        f"{case['particles']} particles, {case['springs']} springs",
        f"reference: {case['reference']}; they differ by {case['disagreement']:.1e} of the edge",
        f"a push of 1e-9 grows {case['growth']:.3g}-fold"
        + (": too chaotic for errors point by point; centre of mass and energy instead" if case["chaotic"] else ""),
        table(heads, cells),
        *case["told"],
        case["sentence"],
    ]


def plot(told: dict[str, Any], path: Path) -> None:
    """Error over run time and over the step, a row of axes for each case. Raises Lacking."""
    from taichi_jello.studies._work_precision import draw

    draw(told, path)
