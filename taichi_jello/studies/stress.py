"""Stiff and extreme cases for every method: is the state finite, is energy or shape lost, and what does it cost?"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.physics.integrators import schemes
from taichi_jello.run.auto_method import AUTO, check
from taichi_jello.run.diverged import Diverged
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.description import SceneError
from taichi_jello.studies._extremes import CASES, Extreme
from taichi_jello.studies._report import headline, machine, methods_of, new_figure, save_figure, table, take
from taichi_jello.support import runtime
from taichi_jello.support.wording import plain

QUICK = (AUTO, "rk4", "backward-euler")
ROUNDING = 1e-5  # of the largest energy, by which backward Euler, which only loses energy, may add to it
MIN_EXCHANGED = 0.05  # of the largest energy, for the other methods: a free fall exchanges none, and Euler's gains 2 %
MAX_RISE = 0.5  # of what is exchanged, by which the error of the other methods may raise the energy
VERDICTS = (
    ("#2f8a50", "passes: finite, no energy from nowhere, its shape and its side of a wall kept",
     lambda row: row["verdict"] == "ok"),
    ("#909090", "refuses, in one line, before it begins", lambda row: row["passes"] and row["verdict"] != "ok"),
    ("#d0392b", "fails", lambda row: not row["passes"]),
)  # fmt: skip


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """A row for each case and method. --quick: only some methods, and no case of a million steps; the results name
    what is left out. Raises SceneError for an unknown method."""
    methods = methods_of(chosen, QUICK if chosen.quick else [AUTO, *sorted(schemes())], check)
    skipped = [case.name for case in CASES if case.steps and chosen.quick]
    work = [(case, method) for case in CASES if case.name not in skipped for method in methods]
    if chosen.quick and not chosen.method:
        skipped += sorted(set(schemes()) - set(methods))
    results: dict[str, Any] = machine() | {"precision": chosen.precision, "rows": [], "skipped": skipped}
    take(chosen, results, pieces(chosen, work, results), "stress", len(work))
    return results


def pieces(chosen: argparse.Namespace, work: list[tuple[Extreme, str]], results: dict[str, Any]) -> Iterator[None]:
    for case, method in work:
        runtime.start(chosen.arch, chosen.precision, chosen.threads)
        results["rows"].append({"case": case.name, "asked": method} | run_case(case, method))
        yield


def run_case(case: Extreme, method: str) -> dict[str, Any]:
    """The verdict on one case: "ok", what is wrong, or why the method refuses; and the figures."""
    try:
        simulation = case.simulation(method=method)
    except SceneError as refused:
        return {"verdict": f"refuses: {refused.problem.partition(';')[0]}", "passes": True}
    start = case.start(simulation.x)
    simulation.restore(Snapshot(0.0, start, simulation.start.v))
    row = {"method": simulation.method, "substeps": simulation.substeps, "dt": simulation.dt}
    stores, frames = [simulation.energies()], case.frames(simulation)
    before = time.process_time()
    try:
        for _ in range(frames):
            simulation.frame()
            stores.append(simulation.energies())
    except Diverged as error:
        return row | {"verdict": f"stops: {error}", "passes": False}
    seconds = time.process_time() - before
    rise, too_much = energy_rise(simulation, stores)
    wrong = case.check(simulation, start)
    if too_much and not case.driven:
        wrong = wrong or f"energy rises by {rise:.1e}"
    integrator, passes = simulation.system.integrator, simulation.system.integrator.passes * simulation.substeps
    return row | {
        "verdict": wrong or "ok",
        "passes": not wrong,
        "rise": rise,
        "evaluations": integrator.solver.passes / frames if integrator.solves else passes,
        "ms_per_frame": 1e3 * seconds / frames,
    }


def energy_rise(simulation: Simulation, stores: list[dict[str, float]]) -> tuple[float, bool]:
    """By how much the energy rises, of all that is exchanged, and whether that is too much. stores: the energies [J] at
    the start and after each frame."""
    body, energy = simulation.body, [sum(store.values()) for store in stores]
    largest = max(sum(map(abs, store.values())) for store in stores)
    monotone = simulation.method == "backward-euler"
    allowed = ROUNDING if monotone else MAX_RISE
    least = 1e-5 * float(np.sum(body.stiffness * body.rest_length**2)) + 1e-12  # all springs stretched by 0.5 %
    scale = max(max(energy) - min(energy), least + (ROUNDING if monotone else MIN_EXCHANGED) * largest)
    rise = float(max(np.diff(energy).max() if monotone else max(energy) - energy[0], 0.0) / scale)
    return rise, rise > allowed


def text(results: dict[str, Any]) -> str:
    heads = ("case", "method", "substeps", "evaluations a frame", "rise", "verdict")
    cells = []
    for row in results["rows"]:
        chosen = f" ({row['method']})" if row["asked"] == AUTO and "method" in row else ""
        figures = (row.get(key, "-") for key in ("substeps", "evaluations", "rise"))
        cells.append((row["case"], row["asked"] + chosen, *figures, row["verdict"]))
    failed = sum(not row["passes"] for row in results["rows"])
    last = f"{len(results['rows'])} runs, {failed} of them failed" + ", interrupted" * results["interrupted"]
    left_out = [f"--quick leaves out: {', '.join(results['skipped'])}"] * bool(results["skipped"])
    return "\n".join([headline(results), table(heads, cells), last, *left_out])


def rows(results: dict[str, Any]) -> list[dict[str, Any]]:
    columns = ("case", "asked", "method", "substeps", "dt", "evaluations", "rise", "ms_per_frame", "passes", "verdict")
    return [{key: row.get(key) for key in columns} for row in results["rows"]]


def plot(results: dict[str, Any], path: Path) -> None:
    """A square for each case and method in the colour of its verdict, with its passes a frame. Raises Lacking."""
    cases = list(dict.fromkeys(row["case"] for row in results["rows"]))
    methods = list(dict.fromkeys(row["asked"] for row in results["rows"]))
    figure = new_figure(max(6.0, 3.0 + 0.75 * len(methods)), 1.7 + 0.27 * len(cases))
    axes = figure.add_subplot()
    for color, text, which in VERDICTS:
        own = [row for row in results["rows"] if which(row)]
        x, y = [methods.index(row["asked"]) for row in own], [cases.index(row["case"]) for row in own]
        if own:
            axes.barh(y, 0.94, 0.86, [place - 0.47 for place in x], color=color, label=text)
        for *place, row in zip(x, y, own, strict=True):
            passes = plain(row["evaluations"], 3) if "evaluations" in row else "-"
            axes.text(*place, passes, ha="center", va="center", color="white", fontsize=7)
    axes.set_xticks(range(len(methods)), methods, rotation=25, ha="right")
    axes.set_yticks(range(len(cases)), cases)
    axes.set(xlim=(-0.6, len(methods) - 0.4), ylim=(len(cases) - 0.4, -0.6))
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    figure.suptitle(
        "What becomes of a small jello in stiff and extreme cases\nnumbers: passes over its springs in a frame",
        fontsize=10,
    )
    figure.legend(loc="outside lower center", fontsize=8, frameon=False)
    save_figure(figure, path)
