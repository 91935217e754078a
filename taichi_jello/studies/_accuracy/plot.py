"""The work-precision diagram: error over run time, over passes through the springs and over the step, a row of axes for
each case."""

from pathlib import Path
from typing import Any

from taichi_jello.studies._accuracy.conclusions import FRAME, Figures, ladder, ms_a_frame
from taichi_jello.studies._report import new_figure, save_figure

MARKERS = "osD^vP*X<>hpd8"
Styles = dict[str, dict[str, Any]]  # colour and marker of each method


def draw(results: dict[str, Any], path: Path) -> None:
    """Write the diagram of all cases. Raises Lacking."""
    cases = [case for case in results["cases"] if case["points"]]
    figure = new_figure(17.5, 0.4 + 4.2 * max(1, len(cases)))
    axes = figure.subplots(max(1, len(cases)), 3, squeeze=False)
    methods = sorted({point["method"] for case in cases for point in case["points"]})
    styles = {name: {"color": f"C{k % 10}", "marker": MARKERS[k % len(MARKERS)]} for k, name in enumerate(methods)}
    for row, case in zip(axes, cases, strict=False):
        for place, panel in zip(row, (error_over_time, error_over_passes, error_over_step), strict=True):
            panel(place, case, styles)
            place.grid(alpha=0.25)
    threads = results.get("threads", 1)
    figure.suptitle(f"{results['processor']}, {results['arch']}, {threads} threads", fontsize=9, color="0.4")
    save_figure(figure, path)


def resolved(case: Figures, method: str, precision: str, tolerance: float | None = None) -> list[Figures]:
    """The points of `ladder` whose error is above the reference's floor; that error is under `shown`."""
    name = "centre" if case["chaotic"] else "error"
    points = ladder(case, method, precision, tolerance)
    return [p | {"shown": p[name]} for p in points if not p["diverged"] and p[name] > case["floor"]]


def curve(axes: Any, points: list[Figures], x: list[float], line: str, **style: Any) -> None:
    if points:
        axes.loglog(x, [p["shown"] for p in points], line, **{"ms": 4, "lw": 1.3} | style)


def error_over_time(axes: Any, case: Figures, styles: Styles) -> None:
    for method, style in styles.items():
        labelled = "f32" if resolved(case, method, "f32") else "f64"
        for precision, line in (("f64", "--"), ("f32", "-")):
            points = resolved(case, method, precision)
            label = method if precision == labelled else None
            curve(axes, points, [ms_a_frame(case, p) for p in points], line, label=label, **style)
    text: dict[str, Any] = {"color": "0.4", "fontsize": 8}
    axes.axvline(1e3 * FRAME, color="0.5", lw=1)
    axes.text(1e3 * FRAME, 0.02, " real time", transform=axes.get_xaxis_transform(), **text)
    floor = case["float32_floor"]
    if floor:
        axes.axhline(floor, color="0.7", lw=1, ls=":")
        axes.text(0.99, floor, "float32", transform=axes.get_yaxis_transform(), ha="right", **text)
    for best in case["fastest"]:
        axes.plot(best["ms_a_frame"], best["error"], "k|", ms=9, mew=1.5)
    axes.set_xlabel("run time of a 1/60 s frame [ms]; solid f32, dashed f64, | fastest to that error", fontsize=8)
    what = "centre of mass" if case["chaotic"] else "position RMS"
    axes.set_ylabel(f"error of {what} / edge at {case['seconds']:g} s")
    axes.set_title(f"{case['case']}: {case['shows'] or case['sentence']}", fontsize=10, loc="left")
    legend_beside(axes)


def error_over_passes(axes: Any, case: Figures, styles: Styles) -> None:
    """Thin lines: implicit steps solved to looser tolerances."""
    looser = sorted({p["tolerance"] for p in case["points"] if p["loosened"]}, reverse=True)
    for method, style in styles.items():
        precision = "f64" if resolved(case, method, "f64") else "f32"
        points = resolved(case, method, precision)
        curve(axes, points, [p["passes"] for p in points], "--", label=method, **style)
        for tolerance in looser:
            points = resolved(case, method, precision, tolerance)
            curve(axes, points, [p["passes"] for p in points], "-", color=style["color"], lw=0.6, alpha=0.7)
            for last in points[-1:]:
                axes.text(last["passes"], last["shown"], f"{tolerance:g}", color=style["color"], fontsize=6)
    axes.set_xlabel("passes through all springs, f64; thin: implicit steps solved to a looser tolerance", fontsize=8)


def error_over_step(axes: Any, case: Figures, styles: Styles) -> None:
    for method, style in styles.items():
        points = resolved(case, method, "f64") or resolved(case, method, "f32")
        order = case["orders"].get(method)
        label = f"{method}: order {order:.2f}" if order is not None else method
        curve(axes, points, [p["dt"] for p in points], "--", label=label, **style)
    axes.set_xlabel("dt [s], f64", fontsize=8)
    axes.set_title(case["sentence"], fontsize=7.5, loc="left", color="0.3", wrap=True)
    legend_beside(axes)


def legend_beside(axes: Any) -> None:
    """Outside the axes, so that it hides no curve."""
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
