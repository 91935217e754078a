"""What a method does to motion: how high a cube bounces, how much of its spin, swing and energy is left, how a ball
rolls and a cube falls, beside the passes over the springs that a drawn frame takes. `jello study accuracy motion`."""

import argparse
import warnings
from collections.abc import Iterator
from math import ceil, inf, log2, sqrt
from typing import Any

from taichi_jello.physics.integrators import schemes
from taichi_jello.run.auto_method import AUTO, check
from taichi_jello.run.clock import StepWarning, asked_substeps
from taichi_jello.run.diverged import Diverged
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.studies._motion.toys import Toys
from taichi_jello.studies._motion.trials import FRAME, SLOPE, TRIALS, Run, Trial
from taichi_jello.studies._report import keep, machine, take
from taichi_jello.support import runtime

NAME = "motion"  # of the case
SECONDS = {False: 10.0, True: 2.0}  # that spin and energy are followed, by --quick
LONGER = {False: 2, True: 4}  # times as many substeps as on the rung before
PASSES = 256  # a frame that the last rung may take, about,
SOLVES = 16  # and substeps where each one solves
FINER = (4, 8)  # times as many steps as RK4's safe one needs: one to compare with, and the reference
UNKNOWN = ("rebound", "rolling")  # trials without a closed form


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """Its figures: a row for each method and number of substeps. Raises SceneError for an unknown method."""
    methods = chosen.method.split(",") if chosen.method else [*sorted(schemes()), AUTO]
    for method in methods:
        check(method)
    toys = Toys(chosen.quick)
    told: dict[str, Any] = machine() | toys.numbers()
    told |= {"case": NAME, "arch": runtime.choose_arch(chosen.arch), "precision": chosen.precision}
    told |= {"seconds": chosen.seconds or SECONDS[chosen.quick], "rolling_in_theory": toys.rolling(SLOPE)}
    told |= {"references": {}, "rows": []}
    take(chosen, told, pieces(chosen, methods, toys, told), NAME, 1 + len(methods))
    return told


def pieces(chosen: argparse.Namespace, methods: list[str], toys: Toys, told: dict[str, Any]) -> Iterator[None]:
    """The references, then one method after the other; every row is kept at once."""
    runtime.start("cpu", "f64", chosen.threads)
    told["references"].update(references(toys))
    yield
    for method in methods:
        told["threads"] = runtime.start(told["arch"], told["precision"], chosen.threads).threads
        for found in climb(method, toys, told, chosen):
            told["rows"].append(found)
            keep(chosen, told)
        yield


def references(toys: Toys) -> dict[str, Any]:
    """By RK4 in f64 what no closed form is known of, and how far the same with steps twice as long is from it."""
    bench, found = Bench("rk4", toys), {}
    for trial in TRIALS:
        if trial.name in UNKNOWN:
            bench.set_up(trial, 1)
            steps = [finer * ceil(FRAME / bench.simulation.safe_dt) for finer in FINER]
            coarse, fine = (bench.run(trial, substeps, 0.0)[0][trial.name] for substeps in steps)
            found[trial.name] = {"value": fine, "dt": FRAME / steps[1], "difference": fine - coarse}
    return found


def climb(method: str, toys: Toys, told: dict[str, Any], chosen: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A method's rows, from few substeps to as many as the cost allows; one of `auto`, which cuts frames itself."""
    if method == AUTO:
        yield row(Automatic(toys, told, chosen), None, told)
        return
    bench = Bench(method, toys)
    given = chosen.substeps or (asked_substeps(FRAME, chosen.dt) if isinstance(chosen.dt, float) else None)
    substeps = given or first_rung(bench)
    while True:
        found = row(bench, substeps, told)
        yield found
        substeps *= LONGER[chosen.quick]
        enough = bench.simulation.system.integrator.solves and substeps > SOLVES
        if given or enough or found["passes"] * LONGER[chosen.quick] > 1.01 * PASSES:
            return


def first_rung(bench: "Bench") -> int:
    """One substep a frame where a method takes steps of any length. Else a power of 2, the least with ω dt <= 2 for the
    fastest motion of the softest cube: the limit of Verlet's method without damping (Hairer, Lubich & Wanner, Geometric
    Numerical Integration, I.5.2)."""
    if bench.simulation.system.integrator.long_steps:
        return 1
    fastest = bench.toys.swings[0][-1] * sqrt(min(trial.stiffness for trial in TRIALS))
    return int(2 ** max(0, ceil(log2(0.5 * FRAME * fastest))))


def row(bench: "Bench", substeps: int | None, told: dict[str, Any]) -> dict[str, Any]:
    """All figures of a method with so many substeps; inf where the numbers went bad."""
    figures: dict[str, Any] = {}
    costs: dict[str, float] = {}
    for trial in TRIALS:
        found, costs[trial.name] = bench.run(trial, substeps, told["seconds"])
        figures.update(found)
    exact = {name: told["references"][name]["value"] for name in UNKNOWN}
    figures["rebound_off"] = figures["rebound"] - exact["rebound"]
    figures["rolling_off"] = figures["rolling"] / exact["rolling"] - 1.0
    diverged = [trial.name for trial in TRIALS if figures[trial.finds[0]] == inf]
    told_so = {"method": bench.method, "substeps": substeps, "passes": sum(costs.values()) / len(costs)}
    return told_so | figures | {"diverged": " ".join(diverged), "passes_of": costs}


def passes_until_now(simulation: Simulation) -> int:
    """How often it has gone through all springs, from some moment on; to be compared within one run."""
    if hasattr(simulation, "passes"):
        return int(simulation.passes)
    integrator, clock = simulation.system.integrator, simulation.clock
    if integrator.solves:
        return int(integrator.solver.passes)
    return int(integrator.passes * (clock.frames * clock.substeps + clock.done))


class Bench:
    """The toys under one method, compiled once and tuned for each trial."""

    simulation: Simulation

    def __init__(self, method: str, toys: Toys):
        self.method, self.toys = method, toys
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StepWarning)
            self.simulation = Simulation(toys.scene(), method=method, substeps=1_000_000)

    def set_up(self, trial: Trial, substeps: int | None) -> None:
        """Give everything the trial's numbers, and a frame so many substeps."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StepWarning)
            self.simulation.tune(**trial.numbers)
            self.simulation.change_step(substeps=substeps)

    def run(self, trial: Trial, substeps: int | None, seconds: float) -> tuple[Any, float]:
        """What the trial finds, and the passes a frame that it takes."""
        self.set_up(trial, substeps)
        self.simulation.restore(Snapshot(0.0, *trial.start(self.toys)))
        run, before = Run(self.simulation, self.toys, seconds), passes_until_now(self.simulation)
        try:
            found = trial.watch(run)
        except Diverged:
            found = dict.fromkeys(trial.finds, inf)
        passes = passes_until_now(self.simulation) - before
        integrator = self.simulation.system.integrator
        if run.frames == 0 and not integrator.solves:  # none of the frames that went bad counts
            return found, integrator.passes * self.simulation.substeps
        return found, passes / max(1, run.frames)


class Automatic(Bench):
    """The toys under `auto`, which looks at a scene when that is made: made anew for other numbers."""

    def __init__(self, toys: Toys, told: dict[str, Any], chosen: argparse.Namespace):
        self.method, self.toys = AUTO, toys
        self.numbers: dict[str, Any] = {}
        self.start = (told["arch"], told["precision"], chosen.threads)

    def set_up(self, trial: Trial, substeps: int | None) -> None:
        if trial.numbers != self.numbers:
            runtime.start(*self.start)  # what was compiled is found only if fields have the numbers that they had
            self.simulation = Simulation(self.toys.scene(**trial.numbers), method=AUTO, dt="auto")
            self.numbers = trial.numbers
