"""What follows from a case's points: fitted orders, the float32 floor, the fastest methods, and a recommendation."""

from typing import Any

import numpy as np

from taichi_jello.physics.integrators import schemes
from taichi_jello.support.wording import plain

FRAME = 1.0 / 60.0  # s; run times are given for one drawn frame
ERRORS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)  # for which the fastest method is named
RECOMMENDED_ERROR = 1e-3  # m
MAX_FITTED_ERROR = 0.01  # larger errors are not yet in the range where the order shows
FITTED_POINTS = 3  # the finest above the reference's floor

Figures = dict[str, Any]  # a case or a point, as in the JSON


def conclude(case: Figures) -> Figures:
    """The conclusions, to be added to a case."""
    found: Figures = {"orders": orders(case), "float32_floor": float32_floor(case)}
    found["fastest"] = [best for best in (fastest(case, error) for error in ERRORS) if best]
    return found | {"conclusions": conclusion_lines(found), "sentence": recommendation(case)}


def measured_error(case: Figures, point: Figures) -> float:
    """The error of a point, of its centre of mass in a chaotic case, but at least the reference's floor."""
    return float(max(point["centre" if case["chaotic"] else "error"], case["floor"]))


def ladder(case: Figures, method: str, precision: str, tolerance: float | None = None) -> list[Figures]:
    """The points of a method: those solved to its own tolerance, or those to a looser one."""
    points = [p for p in case["points"] if (p["method"], p["precision"]) == (method, precision)]
    if tolerance is None:
        return [p for p in points if not p["loosened"]]
    return [p for p in points if p["loosened"] and p["tolerance"] == tolerance]


def orders(case: Figures) -> dict[str, float]:
    """The slope of log error over log dt by method, from f64 points, where there are enough."""
    found = {}
    for method in dict.fromkeys(point["method"] for point in case["points"]):
        points = [p for p in ladder(case, method, "f64") if case["floor"] < p["error"] < MAX_FITTED_ERROR]
        points = points[-FITTED_POINTS:]
        if len(points) == FITTED_POINTS and not case["chaotic"]:
            steps, errors = ([np.log(p[key]) for p in points] for key in ("dt", "error"))
            found[method] = float(np.polyfit(steps, errors, 1)[0])
    return found


def float32_floor(case: Figures) -> float | None:
    """The least error in f32, if f64 is ten times more accurate at some step."""
    points = [p for p in case["points"] if not p["loosened"]]
    exact = {(p["method"], p["steps"]): p["error"] for p in points if p["precision"] == "f64"}
    rounded = [p for p in points if p["precision"] == "f32" and not p["diverged"]]
    seen = any(10.0 * exact.get((p["method"], p["steps"]), np.inf) < p["error"] for p in rounded)
    return min(p["error"] for p in rounded) if seen and not case["chaotic"] else None


def fastest(case: Figures, error: float) -> Figures | None:
    """The point of least median time with at most that error, and the next other method."""
    good = [p for p in case["points"] if not p["diverged"] and measured_error(case, p) <= error]
    good.sort(key=lambda p: p["seconds"]["median"])
    if not good:
        return None
    best = good[0]
    second = next((p for p in good if p["method"] != best["method"]), None)
    return {
        "error": error,
        **{key: best[key] for key in ("method", "precision", "dt", "tolerance", "passes")},
        "ms_a_frame": ms_a_frame(case, best),
        "next": second and second["method"],
        "times_as_long": second and second["seconds"]["median"] / best["seconds"]["median"],
    }


def ms_a_frame(case: Figures, point: Figures) -> float:
    return float(1e3 * FRAME / case["seconds"] * point["seconds"]["median"])


def conclusion_lines(found: Figures) -> list[str]:
    lines = []
    if found["orders"]:
        expected = {name: kind.order for name, kind in schemes().items()}
        slopes = (f"{name} {slope:.2f} ({expected.get(name, '?')})" for name, slope in found["orders"].items())
        lines.append("fitted orders (in theory): " + ", ".join(slopes))
    if found["float32_floor"]:
        lines.append(f"float32 comes no nearer than {found['float32_floor']:.1e}")
    for best in found["fastest"]:
        solved = f", solved to {best['tolerance']:g}" if best["tolerance"] else ""
        other = "no other method got there"
        if best["next"]:
            other = f"{best['next']} takes {plain(best['times_as_long'])} times as long"
        lines.append(
            f"fastest to {best['error']:g}: {best['method']} {best['precision']} at dt = {best['dt']:.3g} s{solved}, "
            f"{plain(best['ms_a_frame'], 3)} ms a frame; {other}"
        )
    return lines


def recommendation(case: Figures) -> str:
    """Which method and step keep the error below a millimetre."""
    what = "with its centre of mass " if case["chaotic"] else ""
    goal = f"{what}within {1e3 * RECOMMENDED_ERROR:g} mm for {case['seconds']:.3g} s"
    best = fastest(case, RECOMMENDED_ERROR / case["edge"])
    if best:
        return (
            f"To be {goal}, use {best['method']} at dt = {best['dt']:.2g} s in {best['precision']}, "
            f"{plain(best['ms_a_frame'])} ms a frame of {1e3 * FRAME:.1f} ms."
        )
    reached = [p for p in case["points"] if not p["diverged"]]
    if not reached:
        return f"Nothing here was {goal}."
    nearest = min(reached, key=lambda p: measured_error(case, p))
    error = 1e3 * case["edge"] * measured_error(case, nearest)
    return f"Nothing here was {goal}; {nearest['method']} at dt = {nearest['dt']:.2g} s came to {plain(error)} mm."
