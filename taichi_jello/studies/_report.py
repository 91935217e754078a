"""What all studies share: the machine, the loop over a study's pieces, timings, tables, and output files."""

import argparse
import csv
import json
import math
import os
import platform
import signal
import statistics
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello import __version__
from taichi_jello.physics.integrators import scheme
from taichi_jello.run.clock import StepWarning
from taichi_jello.run.simulation import Simulation
from taichi_jello.support import interrupt, runtime
from taichi_jello.support.progress import bar

REPEATS = 9
FIGURES = (".png", ".svg", ".pdf")  # what matplotlib writes
INSTALL = "pip install 'taichi_jello[study]'"
INTERRUPTED = "interrupted: the table holds what was measured until then"


class Lacking(Exception):
    """A missing package; the message is one line that says how to install it."""


def machine() -> dict[str, Any]:
    """Versions and processor: every study's JSON begins with them."""
    return {
        "version": __version__,
        "taichi": ".".join(map(str, ti.__version__)),
        "numpy": np.__version__,
        "python": platform.python_version(),
        "processor": processor(),
        "cores": len(runtime.usable_cores()),
    }


def processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return (names or [platform.processor() or platform.machine()])[0]


def headline(results: Mapping[str, Any]) -> str:
    """The machine in one line."""
    return f"{results['processor']}, {results['cores']} cores; Python {results['python']}, Taichi {results['taichi']}"


def methods_of(chosen: argparse.Namespace, usual: Iterable[str], check: Callable[[str], object] = scheme) -> list[str]:
    """The methods that --method names, or the usual ones. Raises SceneError for an unknown method."""
    methods = chosen.method.split(",") if chosen.method else list(usual)
    for method in methods:
        check(method)
    return methods


def take(
    chosen: argparse.Namespace, results: dict[str, Any], pieces: Iterable[Any], title: str, total: float | None = None
) -> None:
    """Run through the pieces of a study, which add to `results`, with a progress bar. Ctrl-C and SIGTERM end it. The
    --json file is written after each piece; `results["interrupted"]` is true until all pieces are done."""
    before = signal.signal(signal.SIGTERM, interrupt.obey)
    results["interrupted"] = True
    try:
        with warnings.catch_warnings(action="ignore", category=StepWarning):  # studies try unstable steps on purpose
            for _ in bar(pieces, title, quiet=chosen.quiet, total=total):
                interrupt.look()
                save_progress(chosen, results)
        results["interrupted"] = False
    except KeyboardInterrupt:
        interrupt.forget()  # the study still prints and draws its results so far
    finally:
        signal.signal(signal.SIGTERM, before)


def save_progress(chosen: argparse.Namespace, results: Mapping[str, Any]) -> None:
    """Write the results so far to the --json file, if there is one."""
    if chosen.json:
        write_json(Path(chosen.json), results)


def seconds_of(run: Callable[[], object], times: int = 1) -> float:
    """The mean wall-clock time [s] of `times` calls."""
    start = time.perf_counter()
    for _ in range(times):
        run()
    return (time.perf_counter() - start) / times


def timed(run: Callable[[], object], shortest: float, repeats: int = REPEATS) -> dict[str, float]:
    """Minimum and median seconds of `run`; each timing calls it often enough to last `shortest` seconds."""
    return min_and_median(interleaved([run], shortest, repeats)[0])


def interleaved(runs: Sequence[Callable[[], object]], shortest: float, repeats: int = REPEATS) -> list[list[float]]:
    """`repeats` timings [s] of each run, after a warm-up. The runs take turns, in reversed order every other time, so
    that a slow spell of the machine affects all of them. Each timing lasts at least `shortest` seconds."""
    times = []
    for run in runs:
        run()
        times.append(max(1, round(shortest / max(seconds_of(run), 1e-9))))
    found: list[list[float]] = [[] for _ in runs]
    for turn in range(repeats):
        order = list(zip(runs, times, found, strict=True))
        for run, count, seconds in order[:: -1 if turn % 2 else 1]:
            seconds.append(seconds_of(run, count))
    return found


def stepping(simulation: Simulation, steps: int, dt: float) -> Callable[[], None]:
    """A function to be timed: so many steps of dt [s] of the physics alone."""

    def run() -> None:
        simulation.system.steps(0, steps, dt)
        ti.sync()

    return run


def min_and_median(seconds: Sequence[float]) -> dict[str, float]:
    return {"min": min(seconds), "median": statistics.median(seconds)}


def table(heads: Sequence[str], rows: Iterable[Sequence[str | float]]) -> str:
    """Aligned columns under their heads: text to the left, numbers to the right."""
    cells = [[cell if isinstance(cell, str) else f"{cell:.4g}" for cell in row] for row in rows]
    columns = []
    for head, *column in zip(heads, *cells, strict=True):
        is_text = all(not cell[:1].isdigit() for cell in column)
        width = max(map(len, [head, *column]))
        columns.append([cell.ljust(width) if is_text else cell.rjust(width) for cell in (head, *column)])
    return "\n".join("  ".join(line).rstrip() for line in zip(*columns, strict=True))


def write_json(path: Path, results: Mapping[str, Any]) -> None:
    """Write the results atomically. Infinity and NaN become null; keys that begin with an underscore are left out."""
    is_file = path.is_file() or not path.exists()  # a pipe or a terminal cannot be replaced
    part = path.with_name(f"{path.name}.part") if is_file else path
    part.write_text(json.dumps(_as_json(results), indent=1) + "\n", encoding="utf-8")
    if is_file:
        os.replace(part, path)


def _as_json(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _as_json(part) for key, part in value.items() if not key.startswith("_")}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_as_json(part) for part in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a line for each row under the keys of the first; a nested dictionary becomes columns like seconds.min."""
    flat = [dict(_columns(row)) for row in rows]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(flat[0]) if flat else [])
        writer.writeheader()
        writer.writerows(flat)


def _columns(row: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    for key, value in row.items():
        if isinstance(value, Mapping):
            yield from _columns(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def new_figure(width: float, height: float) -> Any:
    """An empty matplotlib figure of that size [inches] that needs no screen. Raises Lacking without matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise Lacking(f"needs matplotlib: {INSTALL}") from None
    return Figure(figsize=(width, height), layout="constrained")


def save_figure(figure: Any, path: Path) -> None:
    """Write the figure; the same figure gives the same bytes."""
    figure.savefig(path, dpi=110, metadata={"Software": None} if path.suffix == ".png" else None)
