"""What every study needs: the machine it ran on, timings with their spread, tables, and figures as files."""

import argparse
import csv
import json
import math
import os
import platform
import signal
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello import __version__
from taichi_jello.support import interrupt, runtime
from taichi_jello.support.progress import bar

REPEATS = 9
FIGURES = (".png", ".svg", ".pdf")  # what matplotlib writes
INSTALL = "pip install 'taichi_jello[study]'"


class Lacking(Exception):
    """A package that is not here: one line for the person, with what installs it."""


def machine() -> dict[str, Any]:
    """Versions and processor, the beginning of every study's JSON."""
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


def headline(told: Mapping[str, Any]) -> str:
    """One line of what `machine` said."""
    return f"{told['processor']}, {told['cores']} cores; Python {told['python']}, Taichi {told['taichi']}"


def take(
    chosen: argparse.Namespace, told: dict[str, Any], pieces: Iterable[Any], title: str, total: float | None = None
) -> None:
    """Go through the pieces of a study's work, which leave what they find in `told`, with a bar. Ctrl-C and SIGTERM end
    it; until all is done `told` says that it was interrupted, and after each piece the file of --json has it."""
    before = signal.signal(signal.SIGTERM, interrupt.obey)
    told["interrupted"] = True
    try:
        for _ in bar(pieces, title, quiet=chosen.quiet, total=total):
            interrupt.look()
            keep(chosen, told)
        told["interrupted"] = False
    except KeyboardInterrupt:
        interrupt.forget()  # what is there is told in full
    finally:
        signal.signal(signal.SIGTERM, before)


def keep(chosen: argparse.Namespace, told: Any) -> None:
    """Write the figures so far to the file of --json, if there is one."""
    if chosen.json:
        write_json(Path(chosen.json), told)


def spread(run: Callable[[], Any], least: float, repeats: int = REPEATS) -> dict[str, float]:
    """Minimum and median seconds of `run`; each timing repeats it to last at least `least` seconds."""
    return summed_up(in_turns([run], least, repeats)[0])


def in_turns(runs: Sequence[Callable[[], Any]], least: float, repeats: int = REPEATS) -> list[list[float]]:
    """The seconds of each of `runs`, `repeats` times. They take turns, so that a machine which slows down for a while
    slows all of them, every other time the last one first; each is warmed up first and repeated to last at least
    `least` seconds a timing."""
    times, found = [], [[] for _ in runs]  # type: ignore[var-annotated]
    for run in runs:
        run()
        start = time.perf_counter()
        run()
        times.append(max(1, round(least / max(time.perf_counter() - start, 1e-9))))
    for turn in range(repeats):
        order = list(zip(runs, times, found, strict=True))
        for run, count, seconds in order[:: -1 if turn % 2 else 1]:
            start = time.perf_counter()
            for _ in range(count):
                run()
            seconds.append((time.perf_counter() - start) / count)
    return found


def summed_up(seconds: Sequence[float]) -> dict[str, float]:
    return {"min": min(seconds), "median": statistics.median(seconds)}


def table(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Columns under their heads, as wide as their widest cell: text to the left, the rest to the right."""
    cells = [[cell if isinstance(cell, str) else f"{cell:.4g}" for cell in row] for row in rows]
    lines = [list(heads), *cells]
    left = [all(isinstance(row[k], str) and not row[k][:1].isdigit() for row in cells) for k in range(len(heads))]
    widths = [max(len(line[k]) for line in lines) for k in range(len(heads))]

    def laid(line: Sequence[str]) -> str:
        return "  ".join(
            c.ljust(w) if at_left else c.rjust(w) for c, w, at_left in zip(line, widths, left, strict=True)
        )

    return "\n".join(laid(line).rstrip() for line in lines)


def write_json(path: Path, told: Any) -> None:
    """Write the figures, at once or not at all; a number that is not finite becomes null, which every JSON reader
    knows; what is under a key that begins with an underscore is left out."""
    whole = path.is_file() or not path.exists()  # a pipe or a terminal is written to as it is
    part = path.with_name(f"{path.name}.part") if whole else path
    part.write_text(json.dumps(_plain(told), indent=1) + "\n", encoding="utf-8")
    if whole:
        os.replace(part, path)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(part) for key, part in value.items() if not key.startswith("_")}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(part) for part in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write one line a row under the keys of the first; a dictionary within becomes columns such as seconds.min."""
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
    """An empty matplotlib figure of that size [inches], drawn without a screen. Raises Lacking."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise Lacking(f"needs matplotlib: {INSTALL}") from None
    return Figure(figsize=(width, height), layout="constrained")


def save_figure(figure: Any, path: Path) -> None:
    """Write it; the same figure gives the same bytes."""
    figure.savefig(path, dpi=110, metadata={"Software": None} if path.suffix == ".png" else None)
