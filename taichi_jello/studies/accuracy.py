"""Error against run time: every method with ever shorter steps, in both precisions, against a reference to 12 digits.
`jello study accuracy motion` is the study in `_motion`."""

import argparse
from collections.abc import Iterator
from math import ceil, sqrt
from pathlib import Path

from taichi_jello.physics.integrators import schemes
from taichi_jello.run.simulation import Simulation
from taichi_jello.studies._accuracy import plot as work_precision
from taichi_jello.studies._accuracy.cases import Case, built_in, case_of, default
from taichi_jello.studies._accuracy.conclusions import FRAME, Figures, conclude
from taichi_jello.studies._accuracy.points import TIMINGS, Measurement, compiled, measure_point, time_in_turns
from taichi_jello.studies._accuracy.solution import Solution, reference_solution
from taichi_jello.studies._motion import motion, page
from taichi_jello.studies._report import INTERRUPTED, headline, machine, methods_of, save_progress, table, take
from taichi_jello.support import runtime
from taichi_jello.support.wording import plain

MAX_RUNGS, MIN_RUNGS = 8, 4  # steps on a ladder, each half as long as the one before
SECONDS = {False: 36.0, True: 4.0}  # for all timings together, by --quick
TOLERANCES = (1e-1, 1e-3)  # to which implicit steps are solved as well, where their own is smaller
SPRINGS_PER_SECOND = 1e8  # a rough estimate instead of a timing, so that every run has the same ladders


def measure(chosen: argparse.Namespace) -> Figures:
    """All figures; with --quick the smooth case on a small lattice. Raises SceneError for an unknown method."""
    if chosen.scene == motion.NAME:
        return motion.measure(chosen)
    known = built_in(chosen.quick)
    if chosen.scene is None:
        cases = default(chosen.quick)
    else:
        cases = [known.get(chosen.scene) or case_of(chosen.load(), chosen.seconds)]
    methods = methods_of(chosen, sorted(schemes()))
    arch = runtime.choose_arch(chosen.arch)
    precisions = ["f32"] if arch in ("vulkan", "metal") else ["f64", "f32"]
    results: Figures = machine() | {"arch": arch, "cases": []}
    total = len(cases) * (1 + len(precisions) * (len(methods) + 1))
    take(chosen, results, pieces(chosen, cases, methods, precisions, results), "accuracy", total)
    return results


def pieces(
    chosen: argparse.Namespace, cases: list[Case], methods: list[str], precisions: list[str], results: Figures
) -> Iterator[None]:
    """For each case the reference solution, then a method at a time, then the timings. Every point is saved at once."""
    budget = SECONDS[chosen.quick] / len(cases) / len(precisions)
    for case in cases:
        exact = reference_solution(case)
        points: list[Figures] = []
        found = description(case, exact) | {"points": points}
        found.update(conclude(found))
        results["cases"].append(found)
        yield
        ladders: dict[str, list[int]] = {}
        for precision in precisions:
            results["threads"] = runtime.start(results["arch"], precision, chosen.threads).threads
            measurements: list[Measurement] = []
            for method in methods:
                for one in climb(case, exact, method, ladders, budget / len(methods), chosen):
                    measurements.append(one)
                    points.append(one.point)
                    found.update(conclude(found))
                    save_progress(chosen, results)
                yield
            time_in_turns(case, measurements, budget)
            found.update(conclude(found))
            yield


def description(case: Case, exact: Solution) -> Figures:
    return {
        "case": case.name,
        "shows": case.shows,
        "seconds": case.seconds,
        "edge": exact.edge,
        "particles": len(case.body),
        "springs": len(case.body.springs),
        "reference": exact.how,
        **{key: getattr(exact, key) for key in ("disagreement", "floor", "growth", "chaotic")},
        "energy_at_start": exact.energy_at_start,
        "energy": exact.energy,
    }


def climb(
    case: Case, exact: Solution, method: str, ladders: dict[str, list[int]], budget: float, chosen: argparse.Namespace
) -> Iterator[Measurement]:
    """The method's points from the longest stable step down, until the error is below the reference's floor or the work
    exceeds the budget [s]. The second precision uses the ladder that the first has left in `ladders`."""
    simulation = compiled(case, method)
    given, rungs = ladders.get(method), ladders.setdefault(method, [])
    substeps = given[0] if given else coarsest(simulation, chosen)
    for rung in range(len(given) if given else 1 if chosen.substeps or chosen.dt else MAX_RUNGS):
        one = measure_point(case, exact, simulation, given[rung] if given else substeps)
        yield one
        for tolerance in TOLERANCES if one.point["tolerance"] else ():
            if tolerance > 2.0 * one.point["tolerance"]:
                yield measure_point(case, exact, simulation, one.point["steps"] // case.frames, tolerance)
        if given:
            continue
        rungs.append(substeps)
        work = one.point["passes"] * len(simulation.body.springs) / SPRINGS_PER_SECOND
        too_slow = rung + 1 >= MIN_RUNGS and 2.0 * work > 0.5 * budget / TIMINGS
        if too_slow or one.point["error"] < exact.floor:
            return
        substeps *= 2


def coarsest(simulation: Simulation, chosen: argparse.Namespace) -> int:
    """Substeps a frame at the bottom of the ladder: of the safe step, or of a drawn frame where any step is safe. A
    method with a shorter safe step, or none, begins at a tenth of the time in which the fastest mode turns by 1 rad."""
    if chosen.substeps:
        return int(chosen.substeps)
    frame, bound = simulation.frame_dt, simulation.system.bound
    safe = max(bound.dt, 0.1 / sqrt(bound.squared_frequency or 1e-300))
    if isinstance(chosen.dt, float):
        safe = chosen.dt
    return max(1, ceil(frame / min(safe, frame if chosen.dt else FRAME) * (1.0 - 1e-9)))


def rows(results: Figures) -> list[Figures]:
    """Every point as one flat line."""
    if "rows" in results:
        return list(results["rows"])
    return [{"case": case["case"]} | point for case in results["cases"] for point in case["points"]]


def text(results: Figures) -> str:
    """The figures as tables, and the conclusions."""
    if "rows" in results:
        return page.text(results)
    lines = [f"{headline(results)}; {results['arch']}, {results.get('threads', 1)} threads"]
    for case in results["cases"]:
        lines += ["", *case_page(case)]
    return "\n".join(lines + [INTERRUPTED] * results["interrupted"])


def case_page(case: Figures) -> list[str]:
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
    chaos = ": too chaotic for errors point by point; centre of mass and energy instead" if case["chaotic"] else ""
    return [
        f"{case['case']}: {case['shows'] or case['particles']}, {case['seconds']:.4g} s, "
        f"{case['particles']} particles, {case['springs']} springs",
        f"reference: {case['reference']}; they differ by {case['disagreement']:.1e} of the edge",
        f"a push of 1e-9 grows {case['growth']:.3g}-fold{chaos}",
        table(heads, cells),
        *case["conclusions"],
        case["sentence"],
    ]


def plot(results: Figures, path: Path) -> None:
    """Error over run time and over the step, a row of axes for each case. Raises Lacking."""
    (page.draw if "rows" in results else work_precision.draw)(results, path)
