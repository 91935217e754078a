"""The largest stable step of every method: by bisection on the lattice, in theory, and what dt = "auto" makes of it."""

import argparse
import warnings
from collections.abc import Iterator
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.physics.integrators import scheme, schemes
from taichi_jello.physics.stable_step import stable_limit
from taichi_jello.run.clock import StepWarning
from taichi_jello.run.diverged import Diverged
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies._report import headline, machine, new_figure, save_figure, table, take
from taichi_jello.support import runtime

POINTS = (4, 4, 4)
MASS = 1.0 / 512.0  # kg, of a point
STIFFNESS = {False: [10.0**p for p in range(9)], True: [1.0, 1e4, 1e8]}  # N/m, by --quick
DAMPING = {False: [0.0, 0.05, 0.1, 0.2, 0.5, 1.0], True: [0.0, 0.2, 1.0]}  # of the stiffest mode, over its critical one
STEPS = {False: 2000, True: 1000}  # of one run
SAMPLES = 30  # steps one by one, before and after, in which the swing is measured
GROWS = 1.05  # of the swing over a run, from which on it counts as growing
NEAREST = 0.02  # ω dt below which nothing is looked for: such a method grows at every step
SURELY = 0.3  # ω dt at which it is shown to
HALVINGS = 6
WIDTH = 1.25  # the limit is looked for between the theory's over this and times this
FAR = (3.0, 30.0, 1000.0)  # ω dt at which a method without a limit is tried,
LONG = 1.0 / 30.0  # s, and the longest step it is tried at if that is longer
FEW = 60  # steps of such a run


def swings(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """ω²m/k of every swing about the rest state of a lattice with springs of 1 N/m, the slowest first, and their shapes
    as columns (3N, 3N) of length 1; the first six move it as a rigid body."""
    n, d = len(body), body.direction
    K = np.zeros((n, 3, n, 3))
    for (i, j), block in zip(body.springs, np.einsum("si,sj->sij", d, d), strict=True):
        K[i, :, i] += block
        K[j, :, j] += block
        K[i, :, j] -= block
        K[j, :, i] -= block
    values, vectors = np.linalg.eigh(K.reshape(3 * n, 3 * n))
    return values, vectors


def stiffest_mode(body: Body) -> tuple[float, np.ndarray]:
    """ω²m/k of its fastest swing, and its shape (N, 3)."""
    values, vectors = swings(body)
    return float(values[-1]), vectors[:, -1].reshape(len(body), 3)


class Bench:
    """A free lattice under one method, whose springs are tuned and whose step is as given."""

    def __init__(self, method: str, steps: int):
        points = POINTS[0] * POINTS[1] * POINTS[2]
        box = Box(points=POINTS, mass=points * MASS, stiffness=1.0, damping=1.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StepWarning)
            self.simulation = Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=[box]), method=method, substeps=10**6)
        self.steps, self.scheme = steps, schemes()[method]
        self.eigenvalue, self.mode = stiffest_mode(self.simulation.body)
        self.small = 1e-4 if self.simulation.system.owner.precision == "f32" else 1e-7  # m

    def tune(self, stiffness: float, zeta: float) -> float:
        """Give the springs k [N/m] and the damping with which the stiffest mode has that ratio; returns its ω [1/s]."""
        omega = sqrt(self.eigenvalue * stiffness / MASS)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StepWarning)
            self.simulation.tune(stiffness=stiffness, damping=2.0 * zeta * stiffness / omega)
        return omega

    def grows(self, dt: float, omega: float, steps: int) -> bool:
        """Whether a small swing of the stiffest mode grows in so many steps of dt [s]."""
        simulation, rest = self.simulation, self.simulation.body.x
        simulation.clock.frame_dt = dt * simulation.substeps
        simulation.restore(Snapshot(0.0, rest + self.small * self.mode, np.zeros_like(rest)))
        try:
            first = self._swing(omega)
            simulation.step(steps)
            return bool(self._swing(omega) > GROWS * first)
        except Diverged:
            return True

    def _swing(self, omega: float) -> float:
        """The largest √(q² + (q'/ω)²) of the mode's coordinate q in the next steps."""
        largest = 0.0
        for _ in range(SAMPLES):
            now = self.simulation.snapshot()
            q, rate = np.sum((now.x - self.simulation.body.x) * self.mode), np.sum(now.v * self.mode)
            largest = max(largest, float(np.hypot(q, rate / omega)))
            self.simulation.step()
        return largest

    def limit(self, expected: float, omega: float) -> float:
        """The largest ω dt at which the swing does not grow, within WIDTH of the expected one: by bisection."""
        low, high = expected / WIDTH, expected * WIDTH
        for _ in range(HALVINGS):
            middle = sqrt(low * high)
            if self.grows(middle / omega, omega, self.steps):
                high = middle
            else:
                low = middle
        return sqrt(low * high)

    def row(self, stiffness: float, zeta: float) -> dict[str, Any]:
        """The limits at one stiffness and damping ratio. `found`: "limit", "grows" at every step, or "none" up to the
        step `measured`; None where neither the theory nor the lattice says so."""
        omega = self.tune(stiffness, zeta)
        theory = float(stable_limit(self.scheme.amplification, np.array([zeta]))[0])
        found: str | None
        if theory < NEAREST:
            theory = measured = 0.0
            found = "grows" if self.grows(SURELY / omega, omega, self.steps) else None
        elif np.isinf(theory):
            measured = max(FAR[-1], LONG * omega)
            found = None if any(self.grows(a / omega, omega, FEW) for a in (*FAR, measured)) else "none"
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
    methods = chosen.method.split(",") if chosen.method else sorted(schemes())
    for method in methods:
        scheme(method)
    arch = runtime.choose_arch(chosen.arch)
    precision = "f32" if arch in ("vulkan", "metal") else "f64"
    told: dict[str, Any] = machine() | {"arch": arch, "precision": precision, "rows": []}
    total = len(methods) * len(STIFFNESS[chosen.quick]) * len(DAMPING[chosen.quick])
    take(chosen, told, pieces(methods, chosen, told), "stability", total)
    return told


def pieces(methods: list[str], chosen: argparse.Namespace, told: dict[str, Any]) -> Iterator[None]:
    for method in methods:
        runtime.start(told["arch"], told["precision"], chosen.threads)
        bench = Bench(method, STEPS[chosen.quick])
        for zeta in DAMPING[chosen.quick]:
            for stiffness in STIFFNESS[chosen.quick]:
                told["rows"].append(bench.row(stiffness, zeta))
                yield


def rows(told: dict[str, Any]) -> list[dict[str, Any]]:
    return list(told["rows"])


def text(told: dict[str, Any]) -> str:
    """A line for each method and damping ratio: what is the same at every stiffness, ω dt of the stiffest mode."""
    lines = []
    for method, zeta in dict.fromkeys((row["method"], row["zeta"]) for row in told["rows"]):
        own = [row for row in told["rows"] if (row["method"], row["zeta"]) == (method, zeta)]
        lines.append((method, f"{zeta:g}", *cells(own)))
    k = sorted({row["stiffness"] for row in told["rows"]})
    heads = ("method", "damping ratio", "limit of ω dt in theory", "on the lattice", "auto takes", "of the limit")
    parts = [f"{headline(told)}; {told['arch']}, {told['precision']}", table(heads, lines)]
    if k:
        ends = f"{k[0]:g} to {k[-1]:g} N/m"
        parts.append(f"ω is of the stiffest swing; two numbers: least and largest of {len(k)} stiffnesses, {ends}")
    return "\n".join([*parts, conclusion(told)])


def cells(own: list[dict[str, Any]]) -> tuple[str, ...]:
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


def conclusion(told: dict[str, Any]) -> str:
    limits = [row for row in told["rows"] if row["found"] == "limit"]
    lines = []
    if limits:
        away = max(abs(row["measured"] / row["theory"] - 1.0) for row in limits)
        beyond = sum(row["auto"] > row["measured"] for row in limits)
        lines.append(
            f"{len(limits)} limits, at most {100 * away:.1f} % from theory; auto's step was beyond {beyond} of them"
        )
    wrong = [row for row in told["rows"] if row["found"] is None]
    lines += [f"not as in theory: {r['method']} at k = {r['stiffness']:g}, ratio {r['zeta']:g}" for r in wrong]
    if told["interrupted"]:
        lines.append("interrupted: the table holds what was measured until then")
    return "\n".join(lines)


def plot(told: dict[str, Any], path: Path) -> None:
    """Largest stable dt over stiffness, and the limit of ω dt over damping. Raises Lacking."""
    figure = new_figure(11.0, 5.1)
    figure.suptitle("The longest step with which the stiffest swing of a free jello does not grow", fontsize=11)
    left, right = figure.subplots(1, 2)
    methods = list(dict.fromkeys(row["method"] for row in told["rows"] if row["found"] == "limit"))
    ratios = sorted({row["zeta"] for row in told["rows"]})
    shown = min(ratios, key=lambda zeta: abs(zeta - 0.2), default=0.0)
    zero = 0.5 * min((zeta for zeta in ratios if zeta > 0.0), default=1.0)  # where the ratio 0 is drawn
    for index, method in enumerate(methods):
        own = [row for row in told["rows"] if row["method"] == method]
        at_one = sorted((row for row in own if row["zeta"] == shown), key=lambda row: row["stiffness"])
        color = f"C{index % 10}"
        draw(left, [row["stiffness"] for row in at_one], at_one, [1.0] * len(at_one), color, method)
        draw(right, [row["zeta"] or zero for row in own], own, [row["omega"] for row in own], color, method)
    free = [row for row in told["rows"] if row["found"] == "none"]
    if free:
        names = "\n".join(dict.fromkeys(row["method"] for row in free))
        told_so = f"triangles: no limit found up to there\n{names}"
        left.text(0.98, 0.97, told_so, transform=left.transAxes, ha="right", va="top", fontsize=8, color="0.4")
        look = {"color": "0.4", "ms": 5, "mfc": "none"}
        at_one = [row for row in free if row["zeta"] == shown]
        left.loglog([r["stiffness"] for r in at_one], [r["measured"] for r in at_one], "^", **look)
        right.loglog([r["zeta"] or zero for r in free], [r["measured"] * r["omega"] for r in free], "^", **look)
    left.axhline(1.0 / 60.0, color="0.5", lw=1)
    left.text(0.99, 1.0 / 60.0, "one step a frame", transform=left.get_yaxis_transform(), ha="right", va="bottom",
              fontsize=8, color="0.4")  # fmt: skip
    left.set(xlabel=f"stiffness k [N/m]; damping ratio of the stiffest swing {shown:g}", ylabel="largest stable dt [s]")
    right.set(xlabel="damping ratio of the stiffest swing", ylabel="largest stable ω dt of it")
    right.set_xticks([zeta or zero for zeta in ratios], [f"{zeta:g}" for zeta in ratios])
    right.minorticks_off()
    for axes in (left, right):
        axes.grid(alpha=0.25)
    left.legend(fontsize=8, loc="lower left")
    right.set_title("lines: theory; dots: found on the lattice; dashed: what auto takes", fontsize=9, loc="left")
    points = " by ".join(map(str, POINTS))
    left.set_title(f"{points} points of {MASS:.3g} kg, {told['precision']}", fontsize=9, loc="left")
    save_figure(figure, path)


def draw(axes: Any, places: list[float], own: list[dict[str, Any]], scale: list[float], color: str, name: str) -> None:
    """What was measured as marks, the theory as a line and what `auto` takes as a dashed one."""
    order = sorted((k for k, row in enumerate(own) if row["found"] == "limit"), key=lambda k: places[k])
    x = [places[k] for k in order]
    if order:
        for key, style in (("theory", "-"), ("auto", "--")):
            axes.loglog(x, [own[k][key] * scale[k] for k in order], style, color=color, lw=1)
        axes.loglog(x, [own[k]["measured"] * scale[k] for k in order], "o", color=color, ms=4, label=name)
