"""Ways to solve backward Euler steps of a stiff cube that lands, in NumPy beside each other: passes over the springs
and time until a step is as near to the converged one as asked for. What wins here is worth writing for a processor. The
program's own solve is measured too, beside itself with the plain preconditioner."""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.studies._program import METHODS, Program
from taichi_jello.studies._report import headline, machine, new_figure, save_figure, table, take
from taichi_jello.studies._solvers import INNER, OUTER, STEP, Array, Inner, Landing, newton, turned, two_levels_added

PROGRAM = "program's newton, f32"
PLAIN = "blocks"  # of Newton's method alone, the measure for all others
LOOKS = {
    "newton": {"marker": "o", "linestyle": "-"},
    "l-bfgs": {"marker": "^", "linestyle": "--", "markerfacecolor": "none"},
    PROGRAM: {"marker": "s", "linestyle": ":"},
}
GOALS = (0.1, 0.01, 0.001)  # of the distance from the first guess to the converged step
CONVERGED = 1e-5  # of the first Newton step
SECONDS = 20.0  # after which a way is left where it is
LARGEST = {"inverse": 4100, "sparse factors": 4100}  # particles; beyond, 8.6 GB and minutes at 32³


@dataclass(frozen=True)
class Fall:
    """A cube of points³, which frames are measured, of a fall that touches the ground in the second, and the passes
    after which a way is left where it is."""

    points: int
    frames: tuple[int, ...]
    most: int


FALLS = {
    False: (Fall(8, (2, 3), 5000), Fall(16, (2, 3), 1500), Fall(32, (2,), 300)),
    True: (Fall(7, (2,), 1000),),
}  # by --quick


@dataclass
class Way:
    """One way, and what it took in all frames until each of GOALS; infinity: it never came there."""

    outer: str
    inner: str
    apply: Inner | None
    prepared: float
    numbers: int
    passes: Array = field(default_factory=lambda: np.zeros(len(GOALS)))
    seconds: Array = field(default_factory=lambda: np.zeros(len(GOALS)))

    def solve(self, problem: Landing, guess: Array, converged: Array, most: int) -> None:
        first, spent, reached = rms(guess - converged), 0.0, 0
        problem.passes = 0
        steps = OUTER[self.outer](problem, self.apply, guess, most=most)
        while reached < len(GOALS) and problem.passes < most and spent < SECONDS:
            began = time.perf_counter()
            x = next(steps)
            spent += time.perf_counter() - began
            while reached < len(GOALS) and rms(x - converged) <= GOALS[reached] * first:
                self.passes[reached] += problem.passes
                self.seconds[reached] += spent
                reached += 1
        self.passes[reached:] = self.seconds[reached:] = np.inf


@dataclass
class Own(Way):
    """The program's own solve."""

    program: Program = None  # type: ignore[assignment]

    def solve(self, problem: Landing, guess: Array, converged: Array, most: int) -> None:
        first, reached = rms(guess - converged), 0
        for x, passes, seconds in self.program.iterates(problem):
            while reached < len(GOALS) and rms(x - converged) <= GOALS[reached] * first:
                self.passes[reached] += passes
                self.seconds[reached] += seconds
                reached += 1
            if reached == len(GOALS) or passes >= most or seconds > SECONDS:
                break
        self.passes[reached:] = self.seconds[reached:] = np.inf


def rms(d: Array) -> float:
    return float(np.sqrt(np.mean(np.einsum("nk,nk->n", d, d))))


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """A row for each size, outer and inner way."""
    falls = FALLS[chosen.quick]
    told: dict[str, Any] = machine() | {"rows": [], "left_out": {}}
    total = sum(len(fall.frames) * (1 + len(METHODS) + len(OUTER) * len(inner_ways(fall.points))) for fall in falls)
    take(chosen, told, (None for fall in falls for _ in compared(fall, told)), "solvers", total)
    return told


def inner_ways(points: int) -> list[str]:
    return [name for name in INNER if points**3 <= LARGEST.get(name, np.inf)]


def compared(fall: Fall, told: dict[str, Any]) -> Iterator[None]:
    """All ways, one after the other in every frame."""
    problem, points = Landing(fall.points), fall.points
    told["left_out"][f"{points}³"] = [name for name in INNER if name not in inner_ways(points)]
    ways = [Way("newton", PLAIN, None, 0.0, 9 * points**3)]
    for name in inner_ways(points):
        began = time.perf_counter()
        apply, numbers = INNER[name](problem)
        took = time.perf_counter() - began
        ways += [Way(outer, name, apply, took, numbers) for outer in OUTER]
    for name in METHODS:
        began = time.perf_counter()
        program = Program(problem, name)
        ways.append(Own(PROGRAM, name, None, time.perf_counter() - began, program.numbers, program=program))
    best = two_levels_added(problem)[0]
    for frame in range(fall.frames[-1] + 1):
        guess, _, _ = turned(problem.x, problem.m, STEP * problem.v, 1.0)
        converged = reference(problem, best, guess)
        for way in ways if frame in fall.frames else []:
            way.solve(problem, guess, converged, fall.most)
            if frame == fall.frames[-1]:
                told["rows"].append(row(points, len(fall.frames), way))
            yield
        problem.v, problem.x = (converged - problem.x) / STEP, converged


def reference(problem: Landing, inner: Inner, guess: Array) -> Array:
    last, first = guess, None
    for x in newton(problem, inner, guess, forcing=1e-2):
        last, moved = x, rms(x - last)
        first = first or moved
        if moved <= CONVERGED * first:
            break
    return last


def row(points: int, frames: int, way: Way) -> dict[str, Any]:
    goals = [f"{100 * goal:g} %" for goal in GOALS]
    return {
        "points": points,
        "outer": way.outer,
        "inner": way.inner,
        "prepare": way.prepared,
        "megabytes": 8e-6 * way.numbers,
        "passes": dict(zip(goals, (way.passes / frames).tolist(), strict=True)),
        "ms": dict(zip(goals, (1e3 * way.seconds / frames).tolist(), strict=True)),
    }


def rows(told: dict[str, Any]) -> list[dict[str, Any]]:
    return list(told["rows"])


def text(told: dict[str, Any]) -> str:
    goals = [f"{100 * goal:g} %" for goal in GOALS]
    heads = ("points", "outer", "inner", "prepare s", "MB", *[f"passes to {goal}" for goal in goals], "ms to 1 %")
    lines = [
        (f"{r['points']}³", r["outer"], r["inner"], r["prepare"], r["megabytes"], *r["passes"].values(), r["ms"]["1 %"])
        for r in told["rows"]
    ]
    said = [headline(told), table(heads, lines)]
    for points in dict.fromkeys(r["points"] for r in told["rows"]):
        here = [r for r in told["rows"] if r["points"] == points]
        best = {
            outer: min(((r["ms"]["1 %"], r["inner"]) for r in here if r["outer"] == outer), default=(np.inf, "none"))
            for outer in OUTER
        }
        plain = next((r["ms"]["1 %"] for r in here if (r["outer"], r["inner"]) == ("newton", PLAIN)), np.inf)
        told_best = ", ".join(f"{outer} with {inner} {ms:.3g} ms" for outer, (ms, inner) in best.items())
        said.append(f"{points}³, quickest to 1 %: {told_best}; plain Newton with {PLAIN} {plain:.3g} ms")
        times = {r["inner"]: r["ms"]["1 %"] for r in here if r["outer"] == PROGRAM}
        listed = ", ".join(f"{inner} {ms:.3g} ms" for inner, ms in times.items())
        said.append(f"{points}³, the program to 1 %: {listed}, {times[PLAIN] / min(times.values()):.3g} times as quick")
    for size, names in told["left_out"].items():
        if names:
            said.append(f"{size}, left out as too large: {', '.join(names)}")
    return "\n".join([*said, *(["interrupted"] if told["interrupted"] else [])])


def plot(told: dict[str, Any], path: Path) -> None:
    """Time to 1 % over the number of points, a line for each way."""
    figure = new_figure(7.0, 4.5)
    axes = figure.add_subplot()
    ways = [(o, i) for o in OUTER for i in [*INNER, PLAIN] if i != PLAIN or o == "newton"]
    ways += [(PROGRAM, inner) for inner in METHODS]
    for outer, inner in ways:
        own = [r for r in told["rows"] if (r["outer"], r["inner"]) == (outer, inner)]
        axes.loglog(
            [r["points"] ** 3 for r in own],
            [r["ms"]["1 %"] for r in own],
            **LOOKS[outer],
            color="k" if inner == PLAIN else f"C{[*INNER].index(inner)}",
            label=f"{outer}, {inner}",
        )
    axes.set_xlabel("particles")
    axes.set_ylabel("ms until 1 % of the converged step")
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    axes.grid(alpha=0.3)
    save_figure(figure, path)
