"""Jellos thrown at each other at 20 m/s, which are not to pass: how many of many poses do."""

import argparse
from collections.abc import Iterator
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

from taichi_jello.run.auto_method import AUTO, check
from taichi_jello.scene.description import SceneError
from taichi_jello.studies._contact.pairs import SHAPES, Pair, thrown
from taichi_jello.studies._report import headline, machine, new_figure, save_figure, table, take
from taichi_jello.support import runtime
from taichi_jello.support.wording import counted

MANY = True  # shapes in one call
MESHES = ("rabbit", "teapot")
POSES, FEW_OF_MESHES, FEW = 12, 4, 3
QUICK = {"box", "ring", "sheet", "rope"}
PAIRS = list(combinations_with_replacement(SHAPES, 2))
WAYS = ((0.1, 200.0), (1.0, 200.0), (0.1, 1e4), (1.0, 1e5))  # size [m] and stiffness [N/m] of what is thrown
THROWS = [
    Pair(*names, *way)
    for names in PAIRS
    if not set(names) & set(MESHES)
    for way in WAYS[: 4 if names[0] == names[1] else 2]
]
THROWS += [Pair(name, name) for name in MESHES]


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """A row for each pair, or for those of the shapes named; with --quick only some, in few poses. --method: another
    than auto. Raises SceneError for an unknown method or shape."""
    method = chosen.method or AUTO
    for name in chosen.scenes:
        if name not in SHAPES:
            raise SceneError("study contact", f"expected shapes, of {', '.join(SHAPES)}, got {name!r}")
    check(method)
    only = set(chosen.scenes) or (QUICK if chosen.quick else set(SHAPES))
    work = [pair for pair in THROWS if {pair.one, pair.other} <= only]
    results: dict[str, Any] = machine() | {"method": method, "rows": []}
    take(chosen, results, pieces(chosen, work, method, results), "contact", len(work))
    return results


def pieces(chosen: argparse.Namespace, work: list[Pair], method: str, results: dict[str, Any]) -> Iterator[None]:
    for pair in work:
        runtime.start(chosen.arch, chosen.precision, chosen.threads)
        poses = FEW if chosen.quick else FEW_OF_MESHES if {pair.one, pair.other} & set(MESHES) else POSES
        results["rows"].append(row(pair, method, chosen.poses or poses))
        yield


def row(pair: Pair, method: str, poses: int) -> dict[str, Any]:
    """What becomes of a pair: in which poses one goes through the other, and in which round it."""
    simulation = pair.simulation(method)
    names = {"one": pair.one, "other": pair.other, "size": pair.size, "stiffness": pair.stiffness}
    found = list(thrown(simulation, pair.size, range(poses)))
    through = [one["pose"] for one in found if one["through"]]
    around = [one["pose"] for one in found if one["beyond"] and not one["through"]]
    return names | {"method": simulation.method, "poses": poses, "through": through, "around": around}


def text(results: dict[str, Any]) -> str:
    parts, own = [headline(results)], results["rows"]
    if own:
        heads = ("thrown at 20 m/s", "method", "poses", "went through", "went round")
        lines = [(named(one), one["method"], one["poses"], len(one["through"]), len(one["around"])) for one in own]
        through, poses = sum(len(one["through"]) for one in own), sum(one["poses"] for one in own)
        parts += [table(heads, lines), f"{counted(poses, 'pose')}, {through} went through"]
    return "\n".join(parts + ["interrupted"] * results["interrupted"])


def named(one: dict[str, Any]) -> str:
    return f"{one['one']}, {one['other']}, {one['size']:g} m, {one['stiffness']:g} N/m"


def rows(results: dict[str, Any]) -> list[dict[str, Any]]:
    return [one | {key: " ".join(map(str, one[key])) for key in ("through", "around")} for one in results["rows"]]


def plot(results: dict[str, Any], path: Path) -> None:
    """A bar for each pair: which share of the poses ended how."""
    figure = new_figure(9.0, 1.5 + 0.17 * len(results["rows"]))
    axes = figure.add_subplot()
    for place, one in enumerate(results["rows"]):
        through, around = (len(one[key]) / one["poses"] for key in ("through", "around"))
        left = 0.0
        for share, color in ((through, "#d0392b"), (around, "#e0b040"), (1.0 - through - around, "#2f8a50")):
            axes.barh(place, share, 0.8, left, color=color)
            left += share
    axes.set_yticks(range(len(results["rows"])), [named(one) for one in results["rows"]], fontsize=7)
    axes.set(xlim=(0.0, 1.0), ylim=(len(results["rows"]) - 0.4, -0.6), xlabel="share of the poses")
    axes.spines[:].set_visible(False)
    figure.suptitle("Thrown at 20 m/s: come back (green), gone round (yellow), gone through (red)", fontsize=9)
    save_figure(figure, path)
