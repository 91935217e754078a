"""A point of the work-precision diagram: one run of a case with one method and step, its errors, and its time."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.run.diverged import Diverged
from taichi_jello.run.simulation import Simulation
from taichi_jello.studies._accuracy.cases import Case
from taichi_jello.studies._accuracy.solution import Solution, rms, run_case
from taichi_jello.studies._report import min_and_median, seconds_of

TIMINGS = 7
TIMING_SECONDS = 0.2  # that one timing lasts if the budget allows


@dataclass
class Measurement:
    """A point of the diagram: its figures, as in the JSON, its simulation, and the seconds of each timing."""

    point: dict[str, Any]
    simulation: Simulation
    seconds: list[float]


def compiled(case: Case, method: str) -> Simulation:
    """The case's simulation, with all its kernels compiled."""
    simulation = Simulation(case.scene, method=method, substeps=1_000_000)
    simulation.step(1)
    simulation.energies()
    simulation.reset()
    return simulation


@contextmanager
def solver_tolerance(simulation: Simulation, tolerance: float | None) -> Iterator[None]:
    """Within, implicit steps are solved to this tolerance; None: to the method's own."""
    if tolerance is None:
        yield
        return
    solver = simulation.system.integrator.solver
    own = solver.accuracy
    try:
        solver.accuracy = solver.now.accuracy[0] = tolerance
        yield
    finally:
        solver.accuracy = solver.now.accuracy[0] = own


def prepare(simulation: Simulation, substeps: int) -> None:
    """Set the step, and do what a method does once for a step length, which is not timed."""
    simulation.change_step(substeps=substeps)
    if simulation.system.integrator.solves:
        simulation.system.integrator.prepare(simulation.system, simulation.dt)


def measure_point(
    case: Case, exact: Solution, simulation: Simulation, substeps: int, tolerance: float | None = None
) -> Measurement:
    """Run the case once and compare its end with the reference solution."""
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
    before = integrator.passes_so_far if integrator.solves else 0
    try:
        with solver_tolerance(simulation, tolerance):
            prepare(simulation, substeps)
            start = time.perf_counter()
            end = run_case(simulation, case, substeps, case.start(body.x))
            seconds = time.perf_counter() - start
    except Diverged:
        point |= dict.fromkeys(("error", "centre", "momentum", "angular_momentum", "energy"), np.inf)
        return Measurement(point | {"diverged": True, "seconds": {"min": np.inf, "median": np.inf}}, simulation, [])
    if integrator.solves:
        point["passes"] = integrator.passes_so_far - before
    energy = sum(simulation.energies().values())
    x, v = end.x.astype(float), end.v.astype(float)
    offset, drift = ((body.mass @ (a - b)) / body.mass.sum() for a, b in ((x, exact.x), (v, exact.v)))
    spin, exact_spin = (body.mass @ np.cross(a - exact.x.mean(0), b) for a, b in ((x, v), (exact.x, exact.v)))
    point |= {
        "error": rms(x, exact.x, exact.edge),
        "centre": float(np.linalg.norm(offset)) / exact.edge,
        "momentum": float(np.linalg.norm(drift) * body.mass.sum()),
        "angular_momentum": float(np.linalg.norm(spin - exact_spin)),
        "energy": abs(energy - exact.energy),
        "diverged": False,
        "seconds": {"min": seconds, "median": seconds},
    }
    return Measurement(point, simulation, [seconds])


def time_in_turns(case: Case, measurements: list[Measurement], budget: float) -> None:
    """Time every run several times, within the budget [s]. The runs take turns, so that a slow spell of the machine
    affects all of them; a timing repeats a short run."""
    measurements = [one for one in measurements if not one.point["diverged"]]
    measurements.sort(key=lambda one: one.seconds[0])  # short runs first: their timings are the noisiest
    share, end = budget / max(1, len(measurements)), time.perf_counter() + budget
    for _ in range(1, TIMINGS):  # the first timing was taken with the point
        for one in measurements:
            once = one.point["seconds"]["min"]
            if time.perf_counter() + once > end:
                break
            time_again(case, one, max(1, round(min(TIMING_SECONDS, share / TIMINGS) / once)))


def time_again(case: Case, one: Measurement, times: int) -> None:
    """Add a timing: the mean of so many runs."""
    substeps, x = one.point["steps"] // case.frames, case.start(one.simulation.body.x)

    def runs() -> None:
        for _ in range(times):
            run_case(one.simulation, case, substeps, x)
        ti.sync()

    with solver_tolerance(one.simulation, one.point["tolerance"] if one.point["loosened"] else None):
        prepare(one.simulation, substeps)
        ti.sync()
        one.seconds.append(seconds_of(runs) / times)
    one.point["seconds"] = min_and_median(one.seconds)
