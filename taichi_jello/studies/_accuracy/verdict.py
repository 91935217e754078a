"""What follows from a case's points: fitted orders, the float32 floor, who is fastest, and one plain sentence."""

from typing import Any

import numpy as np

from taichi_jello.physics.integrators import schemes
from taichi_jello.support.wording import plain

FRAME = 1.0 / 60.0  # s; run times are told for one drawn frame
MARKS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)  # errors for which the fastest method is named
NEAR = 1e-3  # m, of the sentence
COARSE = 0.01  # errors above it are no measure of an order
FITTED = 3  # points, the finest that the reference can tell apart


def conclude(case: dict[str, Any]) -> dict[str, Any]:
    """The conclusions, to be added to a case."""
    found: dict[str, Any] = {"orders": orders(case), "float32_floor": float32_floor(case)}
    found["fastest"] = [who for who in (fastest(case, mark) for mark in MARKS) if who]
    return found | {"told": told(case, found), "sentence": sentence(case)}


def measured(case: dict[str, Any], point: dict[str, Any]) -> float:
    """The error that counts: the reference cannot tell apart what lies below its floor. In a chaotic case it is the
    centre of mass'."""
    return max(point["centre" if case["chaotic"] else "error"], case["floor"])


def ladder(case: dict[str, Any], method: str, precision: str) -> list[dict[str, Any]]:
    """The points of a method, those that were solved to its own tolerance."""
    return [p for p in case["points"] if (p["method"], p["precision"]) == (method, precision) and not p["loosened"]]


def orders(case: dict[str, Any]) -> dict[str, float]:
    """Slope of log error over log dt by method, from f64 points, where there are enough."""
    found = {}
    for method in dict.fromkeys(point["method"] for point in case["points"]):
        own = [p for p in ladder(case, method, "f64") if not case["chaotic"]]
        own = [p for p in own if case["floor"] < p["error"] < COARSE][-FITTED:]
        if len(own) >= 3:
            steps, errors = ([np.log(p[key]) for p in own] for key in ("dt", "error"))
            found[method] = float(np.polyfit(steps, errors, 1)[0])
    return found


def float32_floor(case: dict[str, Any]) -> float | None:
    """The least error in f32, once there is a step at which f64 is ten times better."""
    own = [p for p in case["points"] if not p["loosened"]]
    exact = {(p["method"], p["steps"]): p["error"] for p in own if p["precision"] == "f64"}
    rounded = [p for p in own if p["precision"] == "f32" and not p["diverged"]]
    seen = any(10.0 * exact.get((p["method"], p["steps"]), np.inf) < p["error"] for p in rounded)
    return min(p["error"] for p in rounded) if seen and not case["chaotic"] else None


def fastest(case: dict[str, Any], mark: float) -> dict[str, Any] | None:
    """The point of least median time with at most that error, and the next other method's."""
    good = [p for p in case["points"] if not p["diverged"] and measured(case, p) <= mark]
    good.sort(key=lambda p: p["seconds"]["median"])
    if not good:
        return None
    best = good[0]
    second = next((p for p in good if p["method"] != best["method"]), None)
    return {
        "error": mark,
        **{key: best[key] for key in ("method", "precision", "dt", "tolerance", "passes")},
        "ms_a_frame": ms_a_frame(case, best),
        "next": second and second["method"],
        "times_as_long": second and second["seconds"]["median"] / best["seconds"]["median"],
    }


def ms_a_frame(case: dict[str, Any], point: dict[str, Any]) -> float:
    return float(1e3 * FRAME / case["seconds"] * point["seconds"]["median"])


def told(case: dict[str, Any], found: dict[str, Any]) -> list[str]:
    """The conclusions as lines."""
    lines = []
    if found["orders"]:
        expected = {name: kind.order for name, kind in schemes().items()}
        slopes = (f"{name} {slope:.2f} ({expected.get(name, '?')})" for name, slope in found["orders"].items())
        lines.append("fitted orders (in theory): " + ", ".join(slopes))
    if found["float32_floor"]:
        lines.append(f"float32 comes no nearer than {found['float32_floor']:.1e}")
    for who in found["fastest"]:
        line = f"fastest to {who['error']:g}: {who['method']} {who['precision']} at dt = {who['dt']:.3g} s"
        line += f", solved to {who['tolerance']:g}, " if who["tolerance"] else ", "
        line += f"{plain(who['ms_a_frame'], 3)} ms a frame"
        if who["next"]:
            line += f"; {who['next']} takes {plain(who['times_as_long'])} times as long"
        else:
            line += "; no other method got there"
        lines.append(line)
    return lines


def sentence(case: dict[str, Any]) -> str:
    """What to use to be near enough."""
    what = "with its centre of mass " if case["chaotic"] else ""
    goal = f"{what}within {1e3 * NEAR:g} mm for {case['seconds']:.3g} s"
    best = fastest(case, NEAR / case["edge"])
    if best:
        return (
            f"To be {goal}, use {best['method']} at dt = {best['dt']:.2g} s in {best['precision']}, "
            f"{plain(best['ms_a_frame'])} ms a frame of {1e3 * FRAME:.1f} ms."
        )
    reached = [p for p in case["points"] if not p["diverged"]]
    if not reached:
        return f"Nothing here was {goal}."
    nearest = min(reached, key=lambda p: measured(case, p))
    error = 1e3 * case["edge"] * measured(case, nearest)
    return f"Nothing here was {goal}; {nearest['method']} at dt = {nearest['dt']:.2g} s came to {plain(error)} mm."
