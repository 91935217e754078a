"""Stiff and extreme cases for every method: finite, energy never fed, shape recovered, side kept, and what it costs."""

import argparse
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.physics.integrators import schemes
from taichi_jello.run.auto_method import AUTO, check
from taichi_jello.run.clock import StepWarning
from taichi_jello.run.diverged import Diverged
from taichi_jello.scene.description import SceneError
from taichi_jello.studies._extremes import CASES, Extreme
from taichi_jello.studies._report import headline, machine, new_figure, save_figure, table, take
from taichi_jello.support import runtime
from taichi_jello.support.wording import plain

QUICK = (AUTO, "rk4", "backward-euler")
FED = 1e-5  # of the greatest energy, by which backward Euler may add to it: rounding
LITTLE = 0.05  # of all energy: what is lost counts for at least as much; a free fall loses none, and Euler's gains 2 %
SWAPPED = 0.5  # by which the others may: they swap energy with their own error, and must not feed it
LOOKS = (
    ("#2f8a50", "stands it: finite, no energy from nowhere, its shape and its side of a wall kept",
     lambda row: row["verdict"] == "ok"),
    ("#909090", "refuses, in one line, before it begins", lambda row: row["passes"] and row["verdict"] != "ok"),
    ("#d0392b", "fails", lambda row: not row["passes"]),
)  # fmt: skip


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """A row for each case and method; with --quick the methods `auto` chooses from, and no case of very many steps;
    what that leaves out is told. --method a,b: these alone. Raises SceneError for an unknown method."""
    methods = chosen.method.split(",") if chosen.method else list(QUICK) if chosen.quick else [AUTO, *sorted(schemes())]
    for method in methods:
        check(method)
    skipped = [case.name for case in CASES if case.steps and chosen.quick]
    told: dict[str, Any] = machine() | {"precision": chosen.precision, "rows": [], "skipped": skipped}
    if chosen.quick and not chosen.method:
        told["skipped"] += sorted(set(schemes()) - set(methods))
    pairs = [(case, method) for case in CASES if case.name not in skipped for method in methods]
    take(chosen, told, pieces(chosen, pairs, told), "stress", len(pairs))
    return told


def pieces(chosen: argparse.Namespace, pairs: list[tuple[Extreme, str]], told: dict[str, Any]) -> Iterator[None]:
    for case, method in pairs:
        runtime.start(chosen.arch, chosen.precision, chosen.threads)
        told["rows"].append({"case": case.name, "asked": method} | stand(case, method))
        yield


def stand(case: Extreme, method: str) -> dict[str, Any]:
    """What comes of one case: a verdict, "ok" or what is wrong or why the method refuses, and figures."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StepWarning)
            simulation = case.simulation(method=method)
    except SceneError as refused:
        return {"verdict": f"refuses: {refused.problem.partition(';')[0]}", "passes": True}
    start = case.begin(simulation.x)
    simulation.restore(type(simulation.start)(0.0, start, simulation.start.v))
    row = {"method": simulation.method, "substeps": simulation.substeps, "dt": simulation.dt}
    stores, frames = [simulation.energies()], case.frames(simulation)
    began = time.process_time()
    try:
        for _ in range(frames):
            simulation.frame()
            stores.append(simulation.energies())
    except Diverged as bad:
        return row | {"verdict": f"stops: {bad}", "passes": False}
    seconds = time.process_time() - began
    body = simulation.body
    energy = [sum(store.values()) for store in stores]
    most = max(sum(map(abs, store.values())) for store in stores)
    exact = simulation.method == "backward-euler"
    least = 1e-5 * float(np.sum(body.stiffness * body.rest_length**2)) + 1e-12  # all springs stretched by 0.5 %
    scale = max(max(energy) - min(energy), least + (FED if exact else LITTLE) * most)
    rise = float(max(np.diff(energy).max() if exact else max(energy) - energy[0], 0.0) / scale)
    allowed = FED if exact else SWAPPED
    fed = rise > allowed and not case.driven
    wrong = case.demand(simulation, start) or ("" if not fed else f"energy rises by {rise:.1e}")
    integrator = simulation.system.integrator
    return row | {
        "verdict": wrong or "ok",
        "passes": not wrong,
        "rise": rise,
        "evaluations": integrator.solver.passes / frames
        if integrator.solves
        else integrator.passes * simulation.substeps,
        "ms_per_frame": 1e3 * seconds / frames,
    }


def text(told: dict[str, Any]) -> str:
    heads = ("case", "method", "substeps", "evaluations a frame", "rise", "verdict")
    rows = [
        (r["case"], r["asked"] + (f" ({r['method']})" if r["asked"] == AUTO and "method" in r else ""),
         r.get("substeps", "-"), r.get("evaluations", "-"), r.get("rise", "-"), r["verdict"])
        for r in told["rows"]
    ]  # fmt: skip
    failed = sum(not r["passes"] for r in told["rows"])
    last = f"{len(told['rows'])} runs, {failed} of them failed" + (", interrupted" if told["interrupted"] else "")
    left_out = [f"--quick leaves out: {', '.join(told['skipped'])}"] * bool(told["skipped"])
    return "\n".join([headline(told), table(heads, rows), last, *left_out])


def rows(told: dict[str, Any]) -> list[dict[str, Any]]:
    columns = ("case", "asked", "method", "substeps", "dt", "evaluations", "rise", "ms_per_frame", "passes", "verdict")
    return [{key: row.get(key) for key in columns} for row in told["rows"]]


def plot(told: dict[str, Any], path: Path) -> None:
    """A square for each case and method, coloured by what came of it, with how often a frame passes the springs."""
    cases = list(dict.fromkeys(row["case"] for row in told["rows"]))
    methods = list(dict.fromkeys(row["asked"] for row in told["rows"]))
    figure = new_figure(max(6.0, 3.0 + 0.75 * len(methods)), 1.7 + 0.27 * len(cases))
    axes = figure.add_subplot()
    for color, text, which in LOOKS:
        own = [row for row in told["rows"] if which(row)]
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
