"""Error against run time: every method on a ladder of steps, in both precisions, against a reference to 12 digits."""

import argparse
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from math import ceil, sqrt
from pathlib import Path
from typing import Any

from taichi_jello.physics.integrators import scheme, schemes
from taichi_jello.run.simulation import Simulation
from taichi_jello.studies._accuracy import work_precision
from taichi_jello.studies._accuracy.ahead import Rest, begun, compiling_ahead
from taichi_jello.studies._accuracy.cases import Case, built_in, case_of, default
from taichi_jello.studies._accuracy.rolls import TIMINGS, Roll, one_point, time_in_turns
from taichi_jello.studies._accuracy.truth import Truth, truth
from taichi_jello.studies._accuracy.verdict import FRAME, conclude
from taichi_jello.studies._motion import motion, motion_page
from taichi_jello.studies._report import headline, keep, machine, table, take
from taichi_jello.support import runtime
from taichi_jello.support.wording import plain

RUNGS, LEAST_RUNGS = 8, 4  # steps on a ladder, each half of the one before
SECONDS = {False: 36.0, True: 4.0}  # for all timings together, by --quick
TOLERANCES = (1e-1, 1e-3)  # that implicit steps are solved to, where their own is smaller
SPRINGS = 1e8  # that are passed in a second, about: it turns seconds into work, so that a rerun has the same ladders


@dataclass(frozen=True)
class Plan:
    """What is measured, and how many seconds of timings there are for each case and precision."""

    cases: list[Case]
    methods: list[str]
    precisions: list[str]
    budget: float

    @property
    def pieces(self) -> int:
        return len(self.cases) * (1 + len(self.precisions) * (len(self.methods) + 1))


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """All figures; with --quick the smooth case on a small lattice. Raises SceneError for an unknown method."""
    if chosen.scene == motion.NAME:
        return motion.measure(chosen)
    cases = asked_for(chosen)
    methods = chosen.method.split(",") if chosen.method else sorted(schemes())
    for method in methods:
        scheme(method)
    arch = runtime.choose_arch(chosen.arch)
    precisions = ["f32"] if arch in ("vulkan", "metal") else ["f64", "f32"]
    plan = Plan(cases, methods, precisions, SECONDS[chosen.quick] / len(cases) / len(precisions))
    told: dict[str, Any] = machine() | {"arch": arch, "cases": []}
    alone = chosen.scene is not None or arch != "cpu"
    ahead = nullcontext(nullcontext) if alone else compiling_ahead(arch, chosen.threads, methods, chosen.quick)
    with ahead as rest:
        take(chosen, told, pieces(chosen, plan, rest, told), "accuracy", plan.pieces)
    return told


def asked_for(chosen: argparse.Namespace) -> list[Case]:
    if chosen.scene is None:
        return default(chosen.quick)
    known = built_in(chosen.quick)
    return [known[chosen.scene]] if chosen.scene in known else [case_of(chosen.load(), chosen.seconds)]


def pieces(chosen: argparse.Namespace, plan: Plan, rest: Rest, told: dict[str, Any]) -> Iterator[None]:
    """The work in pieces of some seconds, each of which leaves what it found in `told`; every point is kept at once."""
    for case in plan.cases:
        exact = truth(case)
        points: list[dict[str, Any]] = []
        found = about(case, exact) | {"points": points}
        found.update(conclude(found))
        told["cases"].append(found)
        yield
        ladders: dict[str, list[int]] = {}
        for precision in plan.precisions:
            told["threads"] = runtime.start(told["arch"], precision, chosen.threads).threads
            rolls: list[Roll] = []
            for method in plan.methods:
                for roll in climb(case, exact, method, ladders, plan.budget / len(plan.methods), chosen):
                    rolls.append(roll)
                    points.append(roll.point)
                    found.update(conclude(found))
                    keep(chosen, told)
                yield
            with rest():
                time_in_turns(case, rolls, plan.budget)
            found.update(conclude(found))
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
    simulation = begun(case, method)
    given, rungs = ladders.get(method), ladders.setdefault(method, [])
    substeps = given[0] if given else coarsest(simulation, chosen)
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


def coarsest(simulation: Simulation, chosen: argparse.Namespace) -> int:
    """Substeps of a frame at the bottom of the ladder: the safe step, or a drawn frame where any is safe; for a method
    with a shorter safe step, or none, a tenth of the time in which the fastest motion swings by one radian."""
    if chosen.substeps:
        return int(chosen.substeps)
    frame, bound = simulation.frame_dt, simulation.system.bound
    safe = max(bound.dt, 0.1 / sqrt(bound.squared_frequency or 1e-300))
    if isinstance(chosen.dt, float):
        safe = chosen.dt
    return max(1, ceil(frame / min(safe, frame if chosen.dt else FRAME) * (1.0 - 1e-9)))


def rows(told: dict[str, Any]) -> list[dict[str, Any]]:
    """Every point as one flat line."""
    if "rows" in told:
        return list(told["rows"])
    return [{"case": case["case"]} | point for case in told["cases"] for point in case["points"]]


def text(told: dict[str, Any]) -> str:
    """The figures as tables, and what follows from them."""
    if "rows" in told:
        return motion_page.text(told)
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
    draw = motion_page.draw if "rows" in told else work_precision.draw
    draw(told, path)
