"""The results of the motion study as a table and as a picture."""

from math import inf
from pathlib import Path
from typing import Any

from taichi_jello.run.auto_method import AUTO
from taichi_jello.studies._accuracy.plot import MARKERS
from taichi_jello.studies._motion.trials import TRIALS
from taichi_jello.studies._report import INTERRUPTED, headline, new_figure, save_figure, table

ACCURATE = 0.05  # the largest error of a method that the last line names
FALLEN = 4.905  # m in 1 s
MIN_DRAWN = 1e-6  # m, the least error of a fall that is drawn
HEADS = ("method", "substeps", "passes", "rebound", "off by", "spin kept", "swing left", "period", "energy left",
         "rolling", "fall [m]")  # fmt: skip
FORMATS = {"rebound": "{:.3f}", "rebound_off": "{:+.3f}", "spin": "{:.3f}", "swing": "{:.3f}", "period_off": "{:+.2%}",
           "energy": "{:.3f}", "rolling_off": "{:+.2%}", "fall_off": "{:+.4f}"}  # fmt: skip
# The title of each trial's panel, and the exact value of its figure.
PANELS = {
    "rebound": ("Rebound: height over that of the drop", None),
    "spin": ("Spin kept after {seconds:g} s at 15 rad/s", 1.0),
    "swing": ("Lowest swing: amplitude left after 1 s, undamped", 1.0),
    "energy": ("Energy left after {seconds:g} s, undamped", 1.0),
    "rolling": ("Rolling down 10°: acceleration over the exact one", 1.0),
    "fall": ("Free fall of 1 s: error of the distance [m]", None),
}


def text(results: dict[str, Any]) -> str:
    title = f"{headline(results)}; {results['arch']}, {results['precision']}, {results.get('threads', 1)} threads"
    lines = [title, f"a cube and a ball, {results['particles']} particles, {results['springs']} springs"]
    if results["rows"]:
        lines += [table(HEADS, map(cells, results["rows"])), *legend(results), conclusion(results["rows"])]
    return "\n".join(lines + [INTERRUPTED] * results["interrupted"])


def cells(row: dict[str, Any]) -> list[str]:
    figures = [cell(row[key], form) for key, form in FORMATS.items()]
    return [row["method"], str(row["substeps"] or AUTO), f"{row['passes']:.0f}", *figures]


def cell(value: float | None, form: str) -> str:
    if value is None:
        return "-"
    return "diverged" if value == inf else f"{value:.1e}" if value > 100.0 else form.format(value)


def legend(results: dict[str, Any]) -> list[str]:
    """What the columns mean."""
    rebound, rolling = (results["references"][name] for name in ("rebound", "rolling"))
    return [
        "passes: over the springs, in a frame of 1/60 s, the mean of all trials; spin and energy: after "
        f"{results['seconds']:g} s; period and rolling: by how much too long and too fast; fall: of {FALLEN} m too far",
        f"rebound {rebound['value']:.4f} and rolling {rolling['value']:.4f} m/s² by the reference: RK4 in f64 at "
        f"{rebound['dt']:.2g} s; steps twice as long change them by {abs(rebound['difference']):.1e} and "
        f"{abs(rolling['difference']):.1e} m/s²; a rigid ball would roll at {results['rolling_in_theory']:.4f} m/s²",
    ]


def largest_error(row: dict[str, Any]) -> float:
    """The largest of a row's relative errors."""
    lost = [abs(row[key] - 1.0) for key in ("spin", "swing", "energy")]
    off = [abs(row[key]) for key in ("rebound_off", "rolling_off")]
    return float(max(*lost, *off, abs(row["fall_off"]) / FALLEN))


def conclusion(rows: list[dict[str, Any]]) -> str:
    """Which methods are accurate in everything, and at how many passes."""
    fewest: dict[str, float] = {}
    for row in rows:
        if largest_error(row) < ACCURATE:
            fewest[row["method"]] = min(row["passes"], fewest.get(row["method"], inf))
    near = [f"{method} at {passes:.0f} passes" for method, passes in sorted(fewest.items(), key=lambda one: one[1])]
    others = [method for method in dict.fromkeys(row["method"] for row in rows) if method not in fewest]
    rest = f"; not here: {', '.join(others)}" if others else ""
    return f"within {ACCURATE:.0%} in everything: {', '.join(near) or 'none'}{rest}"


def draw(results: dict[str, Any], path: Path) -> None:
    """A panel for each trial: its figure over its passes, a line for each method. Raises Lacking."""
    figure = new_figure(14.0, 8.0)
    axes = figure.subplots(2, 3)
    for place, trial in zip(axes.flat, TRIALS, strict=True):
        panel(place, trial.name, trial.figures[0], results)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=max(1, len(labels)), fontsize=9)
    figure.suptitle(
        "What a method does to motion, over passes through all springs in a frame of 1/60 s; dashed: exact",
        fontsize=12,
    )
    save_figure(figure, path)


def panel(axes: Any, trial: str, key: str, results: dict[str, Any]) -> None:
    """The axes of one trial; diverged runs are left out."""
    title, exact = PANELS[trial]
    exact = results["references"].get(trial, {}).get("value") if trial == "rebound" else exact
    for index, method in enumerate(dict.fromkeys(row["method"] for row in results["rows"])):
        own = [row for row in results["rows"] if row["method"] == method and row[key] < inf]
        passes = [row["passes_of"][trial] for row in own]
        style: dict[str, Any] = {"color": f"C{index % 10}", "marker": MARKERS[index % len(MARKERS)], "ms": 5}
        if method == AUTO:
            style = {"color": "k", "marker": "*", "ms": 13, "ls": "", "zorder": 5}
        axes.plot(passes, [height(row, trial, key) for row in own], lw=1.4, label=method, **style)
    axes.set_xscale("log")
    axes.set_title(title.format(seconds=results["seconds"]), fontsize=10, loc="left")
    axes.grid(alpha=0.25)
    if exact is not None:
        axes.axhline(exact, color="0.3", lw=1, ls="--")
        axes.set_ylim(-0.04, 1.3)
    if trial == "fall":
        axes.set_yscale("log")
    if axes.get_subplotspec().is_last_row():
        axes.set_xlabel("passes a frame")


def height(row: dict[str, Any], trial: str, key: str) -> float:
    """Where a row is drawn."""
    if trial == "rolling":
        return float(1.0 + row["rolling_off"])
    return max(MIN_DRAWN, abs(row[key])) if trial == "fall" else float(row[key])
