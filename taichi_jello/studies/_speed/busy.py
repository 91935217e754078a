"""The speed of each form of the step while another process is busy on the same cores (see physics/team_size.py)."""

import subprocess
import sys
from statistics import fmean
from typing import Any

from taichi_jello.run.simulation import Simulation
from taichi_jello.scene.description import Scene
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies._report import interleaved
from taichi_jello.support import runtime

STIFFNESS = 1.28  # N/m, with which two threads run the larger cube in real time
WATCHING = "watching"  # the form that adapts its threads to the time they take


def busy_row(arch: str, n: int, shortest: float, repeats: int) -> dict[str, Any]:
    """Million springs per second of whole frames of a cube of n³ points beside a busy process, the mean of all timings,
    by form: one thread, all threads, parallel tasks, and as many threads as pays; and the last one's share of the best
    of the others."""
    cores = len(runtime.usable_cores())
    if arch != "cpu" or cores < 2:
        return {"not_measured": "there is no team of threads"}
    runtime.start(arch)
    cube = Scene(gravity=(0.0, 0.0, 0.0), jello=[Box(points=(n, n, n), stiffness=STIFFNESS, damping=0.0)])
    teams = {"one thread": 1, f"team of {cores}": cores, "parallel": 0, WATCHING: cores}
    made = {name: Simulation(cube, method="symplectic-euler", team=team) for name, team in teams.items()}
    for name, simulation in made.items():
        if simulation.system.size and name != WATCHING:
            simulation.system.size.hold(cores)
        simulation.frame()  # compiles
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        found = interleaved([simulation.frame for simulation in made.values()], shortest, repeats)
    finally:
        process.kill()
        process.wait()
    one = made[WATCHING]
    springs = len(one.body.springs) * one.substeps
    rates = {name: springs / fmean(times) / 1e6 for name, times in zip(made, found, strict=True)}
    best = max(rate for name, rate in rates.items() if name != WATCHING)
    return {"n": n, "million_springs_per_second": rates, "of_the_best": rates[WATCHING] / best}


def line(row: dict[str, Any]) -> str:
    if "not_measured" in row:
        return f"beside a busy process: not measured: {row['not_measured']}"
    rates = ", ".join(f"{name} {rate:.0f}" for name, rate in row["million_springs_per_second"].items())
    found = f"beside a busy process, {row['n']}³ points, M springs/s: {rates}"
    return f"{found}; {WATCHING} is {row['of_the_best']:.2f} of the best of the others"
