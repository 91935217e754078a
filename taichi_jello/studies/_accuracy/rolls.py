"""One point of the work-precision diagram: a case rolled out with steps of one length, its errors, and its time."""

import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.run.clock import StepWarning
from taichi_jello.run.diverged import Diverged
from taichi_jello.run.simulation import Simulation
from taichi_jello.studies._accuracy.cases import Case
from taichi_jello.studies._accuracy.truth import Truth, rms, roll_out

TIMINGS = 7
LONG = 0.2  # s that one timing lasts, if there is time for it


@dataclass
class Roll:
    """One point of the diagram: its figures, the simulation it was made with, and the seconds each timing took."""

    point: dict[str, Any]
    simulation: Simulation
    seconds: list[float]


@contextmanager
def solved_to(simulation: Simulation, tolerance: float | None) -> Iterator[None]:
    """Within, implicit steps are solved to this tolerance; to the method's own if it is None."""
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
    """Time every roll-out several times, in turns, so that a machine which slows down for a while slows all of them,
    until the budget [s] is spent. A timing lasts LONG if that allows, by repeating the roll-out."""
    rolls = [roll for roll in rolls if not roll.point["diverged"]]
    rolls.sort(key=lambda roll: roll.seconds[0])  # what is quick is what noise is greatest in
    share, end = budget / max(1, len(rolls)), time.perf_counter() + budget
    for _ in range(1, TIMINGS):  # the first time was when the point was made
        for roll in rolls:
            once = roll.point["seconds"]["min"]
            if time.perf_counter() + once > end:
                break
            time_once_more(case, roll, max(1, round(min(LONG, share / TIMINGS) / once)))


def time_once_more(case: Case, roll: Roll, times: int) -> None:
    """The mean of so many roll-outs."""
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
