"""The largest stable step of every method: in theory, by bisection on a lattice, and what dt = "auto" takes."""

import argparse
from collections.abc import Iterator
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.physics.integrators import schemes
from taichi_jello.physics.stable_step import stable_limit
from taichi_jello.run.diverged import Diverged
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies._report import (
    INTERRUPTED,
    headline,
    machine,
    methods_of,
    new_figure,
    save_figure,
    table,
    take,
)
from taichi_jello.support import runtime

POINTS = (4, 4, 4)
MASS = 1.0 / 512.0  # kg, of a point
STIFFNESS = {False: [10.0**p for p in range(9)], True: [1.0, 1e4, 1e8]}  # N/m, by --quick
DAMPING = {False: [0.0, 0.05, 0.1, 0.2, 0.5, 1.0], True: [0.0, 0.2, 1.0]}  # damping ratios of the stiffest mode
STEPS = {False: 2000, True: 1000}  # of one run
SAMPLES = 30  # single steps before and after a run in which the amplitude is measured
GROWTH = 1.05  # of the amplitude in a run that counts as unstable
MIN_LIMIT = 0.02  # ω dt; a method with a smaller limit is unstable at every step
UNSTABLE = 0.3  # ω dt at which that is confirmed
HALVINGS = 6  # of the bisection's interval, which is
WIDTH = 1.25  # from the theoretical limit over this to the limit times this
LONG_STEPS = (3.0, 30.0, 1000.0)  # ω dt at which a method without a limit is tried,
LONGEST = 1.0 / 30.0  # s, and its longest step if that is longer
LONG_RUN = 60  # steps of such a run

Row = dict[str, Any]


def modes(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """ω²m/k of every mode of a lattice at rest, with springs of 1 N/m, the slowest first, and their shapes as columns
    (3N, 3N) of length 1. The first six are rigid motions."""
    n, d = len(body), body.direction
    K = np.zeros((n, 3, n, 3))
    for (i, j), block in zip(body.springs, np.einsum("si,sj->sij", d, d), strict=True):
        K[i, :, i] += block
        K[j, :, j] += block
        K[i, :, j] -= block
        K[j, :, i] -= block
    values, vectors = np.linalg.eigh(K.reshape(3 * n, 3 * n))
    return values, vectors


class Bench:
    """A free lattice under one method; springs and step are set for each run."""

    def __init__(self, method: str, steps: int):
        box = Box(points=POINTS, mass=POINTS[0] * POINTS[1] * POINTS[2] * MASS, stiffness=1.0, damping=1.0)
        self.simulation = Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=[box]), method=method, substeps=10**6)
        self.steps, self.scheme = steps, schemes()[method]
        values, shapes = modes(self.simulation.body)
        self.eigenvalue, self.mode = float(values[-1]), shapes[:, -1].reshape(-1, 3)  # of the stiffest mode
        self.amplitude = 1e-4 if self.simulation.system.owner.precision == "f32" else 1e-7  # m

    def tune(self, stiffness: float, zeta: float) -> float:
        """Set the stiffness [N/m] and the damping ratio of the stiffest mode; returns the mode's ω [1/s]."""
        omega = sqrt(self.eigenvalue * stiffness / MASS)
        self.simulation.tune(stiffness=stiffness, damping=2.0 * zeta * stiffness / omega)
        return omega

    def grows(self, dt: float, omega: float, steps: int) -> bool:
        """Whether a small displacement along the stiffest mode grows in so many steps of dt [s]."""
        simulation, rest = self.simulation, self.simulation.body.x
        simulation.clock.frame_dt = dt * simulation.substeps
        simulation.restore(Snapshot(0.0, rest + self.amplitude * self.mode, np.zeros_like(rest)))
        try:
            first = self._amplitude(omega)
            simulation.step(steps)
            return self._amplitude(omega) > GROWTH * first
        except Diverged:
            return True

    def _amplitude(self, omega: float) -> float:
        """The largest √(q² + (q'/ω)²) of the mode's coordinate q in the next steps."""
        largest = 0.0
        for _ in range(SAMPLES):
            now = self.simulation.snapshot()
            q, rate = np.sum((now.x - self.simulation.body.x) * self.mode), np.sum(now.v * self.mode)
            largest = max(largest, float(np.hypot(q, rate / omega)))
            self.simulation.step()
        return largest

    def limit(self, expected: float, omega: float) -> float:
        """The largest stable ω dt, by bisection around the expected one."""
        low, high = expected / WIDTH, expected * WIDTH
        for _ in range(HALVINGS):
            middle = sqrt(low * high)
            if self.grows(middle / omega, omega, self.steps):
                high = middle
            else:
                low = middle
        return sqrt(low * high)

    def row(self, stiffness: float, zeta: float) -> Row:
        """The limits at one stiffness and damping ratio. `found`: "limit"; "grows" at every step; "none" up to the step
        `measured`; None where theory and lattice disagree."""
        omega = self.tune(stiffness, zeta)
        theory = float(stable_limit(self.scheme.amplification, np.array([zeta]))[0])
        found: str | None
        if theory < MIN_LIMIT:
            theory = measured = 0.0
            found = "grows" if self.grows(UNSTABLE / omega, omega, self.steps) else None
        elif np.isinf(theory):
            measured = max(LONG_STEPS[-1], LONGEST * omega)
            found = None if any(self.grows(a / omega, omega, LONG_RUN) for a in (*LONG_STEPS, measured)) else "none"
        else:
            measured, found = self.limit(theory, omega), "limit"
        return {
            "method": self.scheme.name,
            "stiffness": stiffness,
            "zeta": zeta,
            "omega": omega,
            "theory": theory / omega,
            "measured": measured / omega,
            "auto": self.simulation.safe_dt,
            "found": found,
        }


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """A row for each method, stiffness and damping ratio. Raises SceneError for an unknown method."""
    methods = methods_of(chosen, sorted(schemes()))
    arch = runtime.choose_arch(chosen.arch)
    precision = "f32" if arch in ("vulkan", "metal") else "f64"
    results: dict[str, Any] = machine() | {"arch": arch, "precision": precision, "rows": []}
    total = len(methods) * len(STIFFNESS[chosen.quick]) * len(DAMPING[chosen.quick])
    take(chosen, results, pieces(methods, chosen, results), "stability", total)
    return results


def pieces(methods: list[str], chosen: argparse.Namespace, results: dict[str, Any]) -> Iterator[None]:
    for method in methods:
        runtime.start(results["arch"], results["precision"], chosen.threads)
        bench = Bench(method, STEPS[chosen.quick])
        for zeta in DAMPING[chosen.quick]:
            for stiffness in STIFFNESS[chosen.quick]:
                results["rows"].append(bench.row(stiffness, zeta))
                yield


def rows(results: dict[str, Any]) -> list[Row]:
    return list(results["rows"])


def text(results: dict[str, Any]) -> str:
    """A line for each method and damping ratio: ω dt of the stiffest mode, the same at every stiffness."""
    lines = []
    for method, zeta in dict.fromkeys((row["method"], row["zeta"]) for row in results["rows"]):
        own = [row for row in results["rows"] if (row["method"], row["zeta"]) == (method, zeta)]
        lines.append((method, f"{zeta:g}", *cells(own)))
    k = sorted({row["stiffness"] for row in results["rows"]})
    heads = ("method", "damping ratio", "limit of ω dt in theory", "on the lattice", "auto takes", "of the limit")
    parts = [f"{headline(results)}; {results['arch']}, {results['precision']}", table(heads, lines)]
    if k:
        ends = f"{k[0]:g} to {k[-1]:g} N/m"
        parts.append(f"ω is of the stiffest swing; two numbers: least and largest of {len(k)} stiffnesses, {ends}")
    return "\n".join([*parts, *conclusions(results["rows"]), *[INTERRUPTED] * results["interrupted"]])


def cells(own: list[Row]) -> tuple[str, ...]:
    """Theory, lattice, auto, and auto's share of the limit, at all stiffnesses."""
    found = {row["found"] for row in own}
    auto = span([row["auto"] * row["omega"] for row in own])
    if None in found:
        return "-", "not as in theory", auto, "-"
    if found == {"grows"}:
        return "0", "grows at every step", "refuses" if auto == "0" else auto, "-"
    if found == {"none"}:
        return "none", f"none up to dt = {min(row['measured'] for row in own):.2g} s and more", "any", "-"
    share = span([row["auto"] / row["measured"] for row in own])
    return span([r["theory"] * r["omega"] for r in own]), span([r["measured"] * r["omega"] for r in own]), auto, share


def span(values: list[float]) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} … {high}"


def conclusions(rows: list[Row]) -> list[str]:
    limits = [row for row in rows if row["found"] == "limit"]
    lines = []
    if limits:
        error = max(abs(row["measured"] / row["theory"] - 1.0) for row in limits)
        beyond = sum(row["auto"] > row["measured"] for row in limits)
        lines.append(
            f"{len(limits)} limits, at most {100 * error:.1f} % from theory; auto's step was beyond {beyond} of them"
        )
    wrong = [row for row in rows if row["found"] is None]
    return lines + [f"not as in theory: {r['method']} at k = {r['stiffness']:g}, ratio {r['zeta']:g}" for r in wrong]


def plot(results: dict[str, Any], path: Path) -> None:
    """Largest stable dt over stiffness, and largest stable ω dt over the damping ratio. Raises Lacking."""
    figure = new_figure(11.0, 5.1)
    figure.suptitle("The longest step with which the stiffest swing of a free jello does not grow", fontsize=11)
    left, right = figure.subplots(1, 2)
    ratios = sorted({row["zeta"] for row in results["rows"]})
    shown = min(ratios, key=lambda zeta: abs(zeta - 0.2), default=0.0)
    zero = 0.5 * min((zeta for zeta in ratios if zeta > 0.0), default=1.0)  # where the ratio 0 is on the log axis
    by_stiffness = [(row["stiffness"], 1.0, row) for row in results["rows"] if row["zeta"] == shown]
    by_damping = [(row["zeta"] or zero, row["omega"], row) for row in results["rows"]]
    limited = list(dict.fromkeys(row["method"] for row in results["rows"] if row["found"] == "limit"))
    draw(left, by_stiffness, limited)
    draw(right, by_damping, limited)
    unlimited = list(dict.fromkeys(row["method"] for row in results["rows"] if row["found"] == "none"))
    small: dict[str, Any] = {"fontsize": 8, "color": "0.4", "ha": "right"}
    if unlimited:
        words = "\n".join(["triangles: no limit found up to there", *unlimited])
        left.text(0.98, 0.97, words, transform=left.transAxes, va="top", **small)
    left.axhline(1.0 / 60.0, color="0.5", lw=1)
    left.text(0.99, 1.0 / 60.0, "one step a frame", transform=left.get_yaxis_transform(), va="bottom", **small)
    left.set(xlabel=f"stiffness k [N/m]; damping ratio of the stiffest swing {shown:g}", ylabel="largest stable dt [s]")
    right.set(xlabel="damping ratio of the stiffest swing", ylabel="largest stable ω dt of it")
    right.set_xticks([zeta or zero for zeta in ratios], [f"{zeta:g}" for zeta in ratios])
    right.minorticks_off()
    left.legend(fontsize=8, loc="lower left")
    right.set_title("lines: theory; dots: found on the lattice; dashed: what auto takes", fontsize=9, loc="left")
    points = " by ".join(map(str, POINTS))
    left.set_title(f"{points} points of {MASS:.3g} kg, {results['precision']}", fontsize=9, loc="left")
    save_figure(figure, path)


def draw(axes: Any, places: list[tuple[float, float, Row]], methods: list[str]) -> None:
    """A panel. places: x and the factor of the steps of each row; methods: those with a limit."""
    axes.grid(alpha=0.25)
    for index, method in enumerate(methods):
        own = [one for one in places if one[2]["method"] == method and one[2]["found"] == "limit"]
        own.sort(key=lambda one: one[0])
        x = [place for place, _, _ in own]
        for key, line, style in (("theory", "-", {"lw": 1}), ("auto", "--", {"lw": 1}), ("measured", "o", {"ms": 4})):
            label = method if key == "measured" else None
            steps = [row[key] * scale for _, scale, row in own]
            axes.loglog(x, steps, line, color=f"C{index % 10}", label=label, **style)
    free = [one for one in places if one[2]["found"] == "none"]
    if free:
        steps = [row["measured"] * scale for _, scale, row in free]
        axes.loglog([place for place, _, _ in free], steps, "^", color="0.4", ms=5, mfc="none")
