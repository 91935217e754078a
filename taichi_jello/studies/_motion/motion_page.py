"""What the study of motion found, as a table and as a picture."""

from math import inf
from pathlib import Path
from typing import Any

from taichi_jello.run.auto_method import AUTO
from taichi_jello.studies._accuracy.work_precision import MARKERS
from taichi_jello.studies._motion.trials import TRIALS
from taichi_jello.studies._report import headline, new_figure, save_figure, table

NEAR = 0.05  # of the truth, in everything
WAY = 4.905  # m that is fallen in 1 s
LEAST = 1e-6  # m, the least error of a fall that is drawn
HEADS = ("method", "substeps", "passes", "rebound", "off by", "spin kept", "swing left", "period", "energy left",
         "rolling", "fall [m]")  # fmt: skip
FORMS = {"rebound": "{:.3f}", "rebound_off": "{:+.3f}", "spin": "{:.3f}", "swing": "{:.3f}", "period_off": "{:+.2%}",
         "energy": "{:.3f}", "rolling_off": "{:+.2%}", "fall_off": "{:+.4f}"}  # fmt: skip
# By trial: how its panel is called, and what its figure is in truth.
PANELS = {
    "rebound": ("Rebound: height, of that fallen from", None),
    "spin": ("Spin kept after {seconds:g} s at 15 rad/s", 1.0),
    "swing": ("Lowest swing: amplitude left after 1 s, undamped", 1.0),
    "energy": ("Energy left after {seconds:g} s, undamped", 1.0),
    "rolling": ("Rolling down 10°: acceleration, of the true one", 1.0),
    "fall": ("Free fall of 1 s: error of the way [m]", None),
}


def text(told: dict[str, Any]) -> str:
    """The table, what it is measured against, and who comes near."""
    title = f"{headline(told)}; {told['arch']}, {told['precision']}, {told.get('threads', 1)} threads"
    lines = [title, f"a cube and a ball, {told['particles']} particles, {told['springs']} springs"]
    if told["rows"]:
        lines += [table(HEADS, map(cells, told["rows"])), *explained(told), conclusion(told["rows"])]
    if told["interrupted"]:
        lines.append("interrupted: the table holds what was measured until then")
    return "\n".join(lines)


def cells(row: dict[str, Any]) -> list[str]:
    """One line of the table."""
    told = [said(row[key], form) for key, form in FORMS.items()]
    return [row["method"], str(row["substeps"] or AUTO), f"{row['passes']:.0f}", *told]


def said(value: float | None, form: str) -> str:
    """One cell of it."""
    if value is None:
        return "-"
    return "diverged" if value == inf else f"{value:.1e}" if value > 100.0 else form.format(value)


def explained(told: dict[str, Any]) -> list[str]:
    """What the columns are measured against."""
    rebound, rolling = (told["references"][name] for name in ("rebound", "rolling"))
    return [
        "passes: over the springs, in a frame of 1/60 s, the mean of all trials; spin and energy: after "
        f"{told['seconds']:g} s; period and rolling: by how much too long and too fast; fall: of {WAY} m too far",
        f"rebound {rebound['value']:.4f} and rolling {rolling['value']:.4f} m/s² in truth: RK4 in f64 at "
        f"{rebound['dt']:.2g} s; steps twice as long change them by {abs(rebound['difference']):.1e} and "
        f"{abs(rolling['difference']):.1e} m/s²; a rigid ball would roll at {told['rolling_in_theory']:.4f} m/s²",
    ]


def away(row: dict[str, Any]) -> float:
    """The largest of a row's errors, each as a share of what is right."""
    lost = [abs(row[key] - 1.0) for key in ("spin", "swing", "energy")]
    off = [abs(row[key]) for key in ("rebound_off", "rolling_off")]
    return float(max(*lost, *off, abs(row["fall_off"]) / WAY))


def conclusion(rows: list[dict[str, Any]]) -> str:
    """Which methods come near in everything, and for how many passes."""
    least: dict[str, float] = {}
    for row in rows:
        if away(row) < NEAR:
            least[row["method"]] = min(row["passes"], least.get(row["method"], inf))
    near = [f"{method} at {passes:.0f} passes" for method, passes in sorted(least.items(), key=lambda one: one[1])]
    others = [method for method in dict.fromkeys(row["method"] for row in rows) if method not in least]
    parts = [f"within {NEAR:.0%} in everything: {', '.join(near) or 'none'}"]
    return "; ".join(parts + [f"not here: {', '.join(others)}"] * bool(others))


def draw(told: dict[str, Any], path: Path) -> None:
    """A panel for each trial: its figure over the passes that it took, a line for each method. Raises Lacking."""
    figure = new_figure(14.0, 8.0)
    axes = figure.subplots(2, 3)
    methods = list(dict.fromkeys(row["method"] for row in told["rows"]))
    for place, trial in zip(axes.flat, TRIALS, strict=True):
        panel(place, trial.name, trial.finds[0], told, methods)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=max(1, len(labels)), fontsize=9)
    figure.suptitle(
        "What a method makes of motion, over passes through all springs in a frame of 1/60 s; dashed: the truth",
        fontsize=12,
    )
    save_figure(figure, path)


def panel(axes: Any, trial: str, key: str, told: dict[str, Any], methods: list[str]) -> None:
    """The axes of one trial; what went bad is left out."""
    title, truth = PANELS[trial]
    truth = told["references"].get(trial, {}).get("value") if trial == "rebound" else truth
    for index, method in enumerate(methods):
        own = [row for row in told["rows"] if row["method"] == method and row[key] < inf]
        places = [row["passes_of"][trial] for row in own]
        look: dict[str, Any] = {"color": f"C{index % 10}", "marker": MARKERS[index % len(MARKERS)], "ms": 5}
        if method == AUTO:
            look = {"color": "k", "marker": "*", "ms": 13, "ls": "", "zorder": 5}
        axes.plot(places, [shown(row, trial, key) for row in own], lw=1.4, label=method, **look)
    axes.set_xscale("log")
    axes.set_title(title.format(seconds=told["seconds"]), fontsize=10, loc="left")
    axes.grid(alpha=0.25)
    if truth is not None:
        axes.axhline(truth, color="0.3", lw=1, ls="--")
        axes.set_ylim(-0.04, 1.3)
    if trial == "fall":
        axes.set_yscale("log")
    if axes.get_subplotspec().is_last_row():
        axes.set_xlabel("passes a frame")


def shown(row: dict[str, Any], trial: str, key: str) -> float:
    """Where a row's figure is drawn."""
    if trial == "rolling":
        return float(1.0 + row["rolling_off"])
    return max(LEAST, abs(row[key])) if trial == "fall" else float(row[key])
