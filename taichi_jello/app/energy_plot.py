"""Energies and work over time as a picture (matplotlib, of the extra `study`)."""

from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.studies._report import new_figure, save_figure


def draw(arrays: dict[str, Any], title: str, path: Path) -> None:
    """Draw the energy_* of Trajectory.arrays, its work_* if it has any, and energy_residual beside what was turned
    over. Raises Lacking without matplotlib."""
    kept = "energy_residual" in arrays
    figure = new_figure(7.0, 7.5 if kept else 3.2)
    axes = figure.subplots(3 if kept else 1, 1, sharex=True, squeeze=False)[:, 0]
    time = arrays["time"]
    energies = {n.removeprefix("energy_"): a for n, a in arrays.items() if n.startswith("energy_")}
    residual = energies.pop("residual", None)
    energies = {name: values for name, values in energies.items() if np.any(values)}
    for name, values in energies.items():
        axes[0].plot(time, values, label=name)
    axes[0].plot(time, sum(energies.values(), np.zeros(len(time))), "k", lw=1, label="sum")
    axes[0].set_ylabel("energy [J]")
    axes[0].set_title(f"{title}: {arrays['method']}, dt = {float(arrays['dt']):.3g} s", fontsize=10, loc="left")
    if residual is not None:
        for name, values in arrays.items():
            if name.startswith("work_") and np.any(values):
                axes[1].plot(time, values, label=name.removeprefix("work_").replace("_", " "))
        axes[1].set_ylabel("work done on the jellos [J]")
        axes[2].plot(time, residual, "k", label="energy - work: the method's own error")
        axes[2].set_ylabel("residual [J]")
    for one in axes:
        one.grid(alpha=0.25)
        one.legend(fontsize=8)
    axes[-1].set_xlabel("time [s]")
    save_figure(figure, path)
