"""What a method does to motion: how high a cube bounces, how much of its spin, swing and energy is left, how a ball
rolls and a cube falls, against the passes over the springs in a drawn frame. `jello study accuracy motion`."""

import argparse
from collections.abc import Iterator
from math import ceil, inf, log2, sqrt
from typing import Any

from taichi_jello.physics.integrators import schemes
from taichi_jello.run.auto_method import AUTO, check
from taichi_jello.run.clock import asked_substeps
from taichi_jello.run.diverged import Diverged
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.studies._motion.bodies import CubeAndBall
from taichi_jello.studies._motion.trials import FRAME, SLOPE, TRIALS, Figures, Trial
from taichi_jello.studies._report import machine, methods_of, save_progress, take
from taichi_jello.support import runtime

NAME = "motion"  # of the case
SECONDS = {False: 10.0, True: 2.0}  # duration of the spin and energy trials, by --quick
REFINEMENT = {False: 2, True: 4}  # factor between the substeps of two rungs
MAX_PASSES = 256  # a frame, about, on the last rung,
MAX_SOLVES = 16  # and substeps for a method that solves in each one
FINER = (4, 8)  # factors of RK4's safe substeps: for comparison, and for the reference
NO_CLOSED_FORM = ("rebound", "rolling")  # trials that need a reference

Start = tuple[str, str, int | None]  # arguments of runtime.start


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """A row for each method and number of substeps. Raises SceneError for an unknown method."""
    methods = methods_of(chosen, [*sorted(schemes()), AUTO], check)
    bodies = CubeAndBall(chosen.quick)
    results: dict[str, Any] = machine() | {
        "particles": len(bodies.body),
        "springs": len(bodies.body.springs),
        "case": NAME,
        "arch": runtime.choose_arch(chosen.arch),
        "precision": chosen.precision,
        "seconds": chosen.seconds or SECONDS[chosen.quick],
        "rolling_in_theory": bodies.rolling(SLOPE),
        "references": {},
        "rows": [],
    }
    take(chosen, results, pieces(chosen, methods, bodies, results), NAME, 1 + len(methods))
    return results


def pieces(
    chosen: argparse.Namespace, methods: list[str], bodies: CubeAndBall, results: dict[str, Any]
) -> Iterator[None]:
    """The references, then one method after the other; every row is saved at once."""
    results["references"].update(references(bodies, chosen.threads))
    yield
    for method in methods:
        bench = Bench(method, bodies, (results["arch"], results["precision"], chosen.threads))
        results["threads"] = runtime.current().threads
        for found in climb(bench, results, chosen):
            results["rows"].append(found)
            save_progress(chosen, results)
        yield


def references(bodies: CubeAndBall, threads: int | None) -> dict[str, Any]:
    """The figures without a closed form by RK4 in f64, and how far they are from those with steps twice as long."""
    bench, found = Bench("rk4", bodies, ("cpu", "f64", threads)), {}
    for trial in TRIALS:
        if trial.name in NO_CLOSED_FORM:
            bench.set_up(trial, 1)
            steps = [finer * ceil(FRAME / bench.simulation.safe_dt) for finer in FINER]
            coarse, fine = (bench.run(trial, substeps, 0.0)[0][trial.name] for substeps in steps)
            found[trial.name] = {"value": fine, "dt": FRAME / steps[1], "difference": fine - coarse}
    return found


class Bench:
    """The cube and the ball under one method, compiled once and tuned for each trial. Since `auto` chooses when a
    simulation is made, it gets a new one for other numbers."""

    simulation: Simulation

    def __init__(self, method: str, bodies: CubeAndBall, start: Start):
        self.method, self.bodies, self.start = method, bodies, start
        self.tuning: dict[str, Any] = {}
        runtime.start(*start)
        if method != AUTO:
            self.simulation = Simulation(bodies.scene(), method=method, substeps=1_000_000)

    def set_up(self, trial: Trial, substeps: int | None) -> None:
        """Tune for a trial, and set the substeps of a frame."""
        if self.method != AUTO:
            self.simulation.tune(**trial.tuning)
            self.simulation.change_step(substeps=substeps)
        elif trial.tuning != self.tuning:
            runtime.start(*self.start)  # Taichi's kernel cache only finds kernels whose fields have the same numbers
            self.simulation = Simulation(self.bodies.scene(**trial.tuning), method=AUTO, dt="auto")
        self.tuning = trial.tuning

    def run(self, trial: Trial, substeps: int | None, seconds: float) -> tuple[Any, float]:
        """The trial's figures, inf where the numbers went bad, and its passes a frame."""
        self.set_up(trial, substeps)
        self.simulation.restore(Snapshot(0.0, *trial.start(self.bodies)))
        before, frames = passes_so_far(self.simulation), 0

        def states() -> Iterator[Snapshot]:
            nonlocal frames
            yield self.simulation.snapshot()
            for _ in range(round((trial.seconds or seconds) / FRAME)):
                self.simulation.frame()
                frames += 1
                yield self.simulation.snapshot()

        found: Figures
        try:
            found = trial.measure(self.bodies, states())
        except Diverged:
            found = dict.fromkeys(trial.figures, inf)
        integrator = self.simulation.system.integrator
        if frames == 0 and not integrator.solves:  # the first frame went bad and is not counted
            return found, integrator.passes * self.simulation.substeps
        return found, (passes_so_far(self.simulation) - before) / max(1, frames)


def passes_so_far(simulation: Simulation) -> int:
    """How often it has gone through all springs; only differences within a run have a meaning."""
    if hasattr(simulation, "passes"):
        return int(simulation.passes)
    integrator, clock = simulation.system.integrator, simulation.clock
    if integrator.solves:
        return integrator.passes_so_far
    return int(integrator.passes * (clock.frames * clock.substeps + clock.done))


def climb(bench: Bench, results: dict[str, Any], chosen: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A method's rows, from few substeps to as many as the cost allows; `auto`, which sets its own step, has one."""
    if bench.method == AUTO:
        yield row(bench, None, results)
        return
    given = chosen.substeps or (asked_substeps(FRAME, chosen.dt) if isinstance(chosen.dt, float) else None)
    substeps = given or first_rung(bench)
    while True:
        found = row(bench, substeps, results)
        yield found
        substeps *= REFINEMENT[chosen.quick]
        too_many = bench.simulation.system.integrator.solves and substeps > MAX_SOLVES
        if given or too_many or found["passes"] * REFINEMENT[chosen.quick] > 1.01 * MAX_PASSES:
            return


def first_rung(bench: Bench) -> int:
    """One substep a frame for a method that takes steps of any length. Else the least power of 2 with ω dt <= 2 for the
    fastest mode of the softest cube: the limit of Verlet's method without damping (Hairer, Lubich & Wanner, Geometric
    Numerical Integration, I.5.2)."""
    if bench.simulation.system.integrator.long_steps:
        return 1
    fastest = bench.bodies.modes[0][-1] * sqrt(min(trial.tuning["stiffness"] for trial in TRIALS))
    return int(2 ** max(0, ceil(log2(0.5 * FRAME * fastest))))


def row(bench: Bench, substeps: int | None, results: dict[str, Any]) -> dict[str, Any]:
    """All figures of a method with so many substeps; inf where the numbers went bad."""
    figures: dict[str, Any] = {}
    costs: dict[str, float] = {}
    for trial in TRIALS:
        found, costs[trial.name] = bench.run(trial, substeps, results["seconds"])
        figures.update(found)
    exact = {name: results["references"][name]["value"] for name in NO_CLOSED_FORM}
    figures["rebound_off"] = figures["rebound"] - exact["rebound"]
    figures["rolling_off"] = figures["rolling"] / exact["rolling"] - 1.0
    diverged = [trial.name for trial in TRIALS if figures[trial.figures[0]] == inf]
    setting = {"method": bench.method, "substeps": substeps, "passes": sum(costs.values()) / len(costs)}
    return setting | figures | {"diverged": " ".join(diverged), "passes_of": costs}
