"""The work-precision diagram: error over run time, over passes through the springs and over the step, a row of axes for
each case."""

from pathlib import Path
from typing import Any

from taichi_jello.studies._accuracy.verdict import FRAME, ladder, ms_a_frame
from taichi_jello.studies._report import new_figure, save_figure

MARKERS = "osD^vP*X<>hpd8"


def draw(told: dict[str, Any], path: Path) -> None:
    """Write the diagram of all cases. Raises Lacking."""
    cases = [case for case in told["cases"] if case["points"]]
    figure = new_figure(17.5, 0.4 + 4.2 * max(1, len(cases)))
    axes = figure.subplots(max(1, len(cases)), 3, squeeze=False)
    methods = sorted({point["method"] for case in cases for point in case["points"]})
    looks = {method: (f"C{k % 10}", MARKERS[k % len(MARKERS)]) for k, method in enumerate(methods)}
    for (left, middle, right), case in zip(axes, cases, strict=False):
        over_time(left, case, looks)
        over_passes(middle, case, looks)
        over_step(right, case, looks)
    figure.suptitle(f"{told['processor']}, {told['arch']}, {told.get('threads', 1)} threads", fontsize=9, color="0.4")
    save_figure(figure, path)


def drawn(case: dict[str, Any], method: str, precision: str, tolerance: float | None = None) -> list[dict[str, Any]]:
    """The points that the reference can tell from the truth: of the method's own tolerance, or of a looser one."""
    name = "centre" if case["chaotic"] else "error"
    points = ladder(case, method, precision)
    if tolerance is not None:
        points = [p for p in case["points"] if (p["method"], p["precision"]) == (method, precision)]
        points = [p for p in points if p["loosened"] and p["tolerance"] == tolerance]
    return [p | {"shown": p[name]} for p in points if not p["diverged"] and p[name] > case["floor"]]


def tolerances(case: dict[str, Any]) -> list[float]:
    return sorted({p["tolerance"] for p in case["points"] if p["loosened"]}, reverse=True)


def over_time(axes: Any, case: dict[str, Any], looks: dict[str, tuple[str, str]]) -> None:
    for method, (color, marker) in looks.items():
        named = "f32" if drawn(case, method, "f32") else "f64"
        for precision, style in (("f64", "--"), ("f32", "-")):
            points = drawn(case, method, precision)
            if points:
                times, errors = [ms_a_frame(case, p) for p in points], [p["shown"] for p in points]
                label = method if precision == named else None
                axes.loglog(times, errors, style, color=color, marker=marker, ms=4, lw=1.3, label=label)
    axes.axvline(1e3 * FRAME, color="0.5", lw=1)
    axes.text(1e3 * FRAME, 0.02, " real time", transform=axes.get_xaxis_transform(), color="0.4", fontsize=8)
    if case["float32_floor"]:
        axes.axhline(case["float32_floor"], color="0.7", lw=1, ls=":")
        axes.text(
            0.99,
            case["float32_floor"],
            "float32",
            transform=axes.get_yaxis_transform(),
            color="0.4",
            fontsize=8,
            ha="right",
        )
    for who in case["fastest"]:
        axes.plot(who["ms_a_frame"], who["error"], "k|", ms=9, mew=1.5)
    axes.set_xlabel("run time of a 1/60 s frame [ms]; solid f32, dashed f64, | fastest to that error", fontsize=8)
    axes.set_ylabel(error_name(case))
    axes.set_title(f"{case['case']}: {case['shows'] or case['sentence']}", fontsize=10, loc="left")
    beside(axes)
    axes.grid(alpha=0.25)


def beside(axes: Any) -> None:
    """A legend that hides no line."""
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def over_passes(axes: Any, case: dict[str, Any], looks: dict[str, tuple[str, str]]) -> None:
    """In the colours of the other axes. Thin lines: implicit steps solved to looser tolerances."""
    for method, (color, marker) in looks.items():
        precision = "f64" if drawn(case, method, "f64") else "f32"
        for tolerance in (None, *tolerances(case)):
            points = drawn(case, method, precision, tolerance)
            if not points:
                continue
            passes, errors = [p["passes"] for p in points], [p["shown"] for p in points]
            if tolerance is None:
                axes.loglog(passes, errors, "--", color=color, marker=marker, ms=4, lw=1.3, label=method)
            else:
                axes.loglog(passes, errors, "-", color=color, lw=0.6, alpha=0.7)
                axes.text(passes[-1], errors[-1], f"{tolerance:g}", color=color, fontsize=6)
    axes.set_xlabel("passes through all springs, f64; thin: implicit steps solved to a looser tolerance", fontsize=8)
    axes.grid(alpha=0.25)


def over_step(axes: Any, case: dict[str, Any], looks: dict[str, tuple[str, str]]) -> None:
    for method, (color, marker) in looks.items():
        points = drawn(case, method, "f64") or drawn(case, method, "f32")
        if points:
            order = case["orders"].get(method)
            label = f"{method}: order {order:.2f}" if order is not None else method
            steps, errors = [p["dt"] for p in points], [p["shown"] for p in points]
            axes.loglog(steps, errors, "--", color=color, marker=marker, ms=4, lw=1.3, label=label)
    axes.set_xlabel("dt [s], f64", fontsize=8)
    axes.set_title(case["sentence"], fontsize=7.5, loc="left", color="0.3", wrap=True)
    beside(axes)
    axes.grid(alpha=0.25)


def error_name(case: dict[str, Any]) -> str:
    what = "centre of mass" if case["chaotic"] else "position RMS"
    return f"error of {what} / edge at {case['seconds']:g} s"
