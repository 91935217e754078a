"""The same scene under several methods side by side, coloured by how far each has drifted from the reference."""

import argparse
import time
import warnings
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello import scenefiles
from taichi_jello.physics.integrators import scheme, schemes
from taichi_jello.run.clock import StepWarning
from taichi_jello.run.diverged import Diverged
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.description import Scene, SceneError
from taichi_jello.studies._report import Lacking, headline, machine, table, take
from taichi_jello.support import runtime
from taichi_jello.support.progress import bar
from taichi_jello.support.wording import plain

PLOTS = (".png", ".mp4", ".gif")
SIZE = (1280, 720)  # pixels of the whole picture
USUAL = ("euler", "symplectic-euler", "verlet", "rk4")  # of those that there are
SECONDS = {False: 1.5, True: 0.5}  # by --quick
FINER = 8  # times as many steps has the reference as RK4 needs
LEAST, MOST = 1e-5, 1e-1  # drift over the edge at the ends of the colour scale, which is logarithmic


@dataclass
class Run:
    """One method's moments, a frame apart, and the time its frames took."""

    simulation: Simulation
    moments: list[Snapshot]
    seconds: float = 0.0
    stopped: float | None = None

    def frame(self) -> None:
        """Go on by a frame; a run whose numbers went bad stays where it was last good."""
        if self.stopped is None:
            start = time.perf_counter()
            try:
                self.simulation.frame()
            except Diverged:
                self.stopped = self.simulation.time
            self.seconds += time.perf_counter() - start
        self.moments.append(self.simulation.snapshot())


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """Every method's drift [m] at the end; --method names those to be shown, separated by commas. The moments to be
    drawn are under `_runs`. Raises SceneError for an unknown method."""
    scene = chosen.load() if chosen.scene else scenefiles.load("cube")
    usual = [name for name in USUAL if name in schemes()]
    methods = chosen.method.split(",") if chosen.method else usual
    for method in methods:
        scheme(method)
    frames = max(1, round((chosen.seconds or SECONDS[chosen.quick]) / scene.solver.frame_dt))
    told: dict[str, Any] = machine() | {"methods": [], "_scene": scene}
    take(chosen, told, pieces(chosen, scene, methods, frames, told), "live", frames * (1 + len(methods)))
    exact, runs = told.get("_exact", []), told.get("_runs", [])
    done = min((len(run.moments) for run in runs), default=0)
    told["methods"] = [row(run, exact, done) for run in runs if done]
    told["seconds"] = exact[done - 1].time if done else 0.0
    return told


def pieces(
    chosen: argparse.Namespace, scene: Scene, methods: list[str], frames: int, told: dict[str, Any]
) -> Iterator[None]:
    """First the reference, RK4 in f64 with short steps, then a frame of every method in turn."""
    arch = runtime.choose_arch(chosen.arch)
    runtime.start("cpu", "f64", chosen.threads)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)
        best = Simulation(scene, method="rk4")
        best.change_step(substeps=FINER * best.substeps)
        exact = told["_exact"] = [best.snapshot()]
        for _ in range(frames):
            best.frame()
            exact.append(best.snapshot())
            yield
        runtime.start(arch, chosen.precision, chosen.threads)
        runs = told["_runs"] = []
        for method in methods:
            simulation = started(scene, method, chosen)
            simulation.frame()  # compiles the kernels
            simulation.reset()
            runs.append(Run(simulation, [simulation.snapshot()]))
        for _ in range(frames):
            for run in runs:
                run.frame()
                yield


def started(scene: Scene, method: str, chosen: argparse.Namespace) -> Simulation:
    """With the step asked for, its own safe one, or where it has none one as short as RK4 needs."""
    try:
        return Simulation(scene, method=method, dt=chosen.dt, substeps=chosen.substeps)
    except SceneError as error:
        if error.key != "solver.dt":
            raise
        return Simulation(scene, method=method, substeps=4 * Simulation(scene, method="rk4").substeps)


def row(run: Run, exact: list[Snapshot], done: int) -> dict[str, Any]:
    body, frames = run.simulation.body, len(run.moments) - 1
    away = run.moments[done - 1].x.astype(float) - exact[done - 1].x
    return {
        "method": run.simulation.method,
        "dt": run.simulation.dt,
        "substeps": run.simulation.substeps,
        "drift": float(np.sqrt(np.mean(np.sum(away**2, axis=1)))),
        "centre": float(np.linalg.norm(body.mass @ away) / body.mass.sum()),
        "ms_a_frame": 1e3 * run.seconds / max(1, frames),
        "stopped": run.stopped,
    }


def rows(told: dict[str, Any]) -> list[dict[str, Any]]:
    return list(told["methods"])


def text(told: dict[str, Any]) -> str:
    """The drifts as a table."""
    cells = [
        [
            one["method"],
            f"{one['dt']:.3g}",
            str(one["substeps"]),
            plain(1e3 * one["drift"], 3) if one["stopped"] is None else f"stopped at {one['stopped']:.3g} s",
            plain(1e3 * one["centre"], 3),
            plain(one["ms_a_frame"], 3),
        ]
        for one in told["methods"]
    ]
    heads = ["method", "dt [s]", "steps a frame", "drift [mm]", "centre [mm]", "ms a frame"]
    lines = [headline(told), f"drift from RK4 in f64 with {FINER} times as many steps, after {told['seconds']:.3g} s"]
    lines.append(table(heads, cells))
    if told["interrupted"]:
        lines.append("interrupted: the table holds what was measured until then")
    return "\n".join(lines)


def plot(told: dict[str, Any], path: Path) -> None:
    """The last moment as one picture, or all of them as a film. Raises Lacking without what a film needs."""
    from taichi_jello.film import Film, FilmProblem
    from taichi_jello.support.png_file import write_png

    if not told["methods"]:
        raise Lacking("nothing was measured that could be drawn")
    count = min(len(run.moments) for run in told["_runs"])
    with closing(Tiles(told)) as tiles:
        if path.suffix == ".png":
            write_png(path, tiles.picture(count - 1))
            return
        every = 2 if path.suffix == ".gif" else 1
        try:
            film = Film(path, SIZE, 1.0 / (every * told["_scene"].solver.frame_dt))
        except FilmProblem as error:
            raise Lacking(str(error)) from None
        with film:
            for frame in bar(range(0, count, every), "drawing"):
                film.add(tiles.picture(frame))


class Tiles:
    """Draws all runs of a study beside each other, two or more in a row."""

    def __init__(self, told: dict[str, Any]):
        from taichi_jello.view.drawing.springs import ramp_table
        from taichi_jello.view.render.renderers import drawing_of, open_renderer

        self.runs, self.exact, self.ramp = told["_runs"], told["_exact"], ramp_table()
        self.columns = ceil(sqrt(len(self.runs)))
        self.rows = ceil(len(self.runs) / self.columns)
        self.size = SIZE[0] // self.columns, SIZE[1] // self.rows
        self.drawings = [drawing_of(run.simulation, self.size) for run in self.runs]
        for drawing in self.drawings:
            drawing.hidden.add("skin")  # the springs carry the colour
        self.renderer = open_renderer("auto", self.size)

    def picture(self, frame: int) -> np.ndarray:
        """(height, width, 3) uint8."""
        sheet = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
        for k in range(len(self.runs)):
            left, top = k % self.columns * self.size[0], k // self.columns * self.size[1]
            sheet[top : top + self.size[1], left : left + self.size[0]] = self.tile(k, frame)
        return sheet

    def tile(self, k: int, frame: int) -> np.ndarray:
        from taichi_jello.view.drawing.springs import Key
        from taichi_jello.view.render.legend import legend

        run, drawing = self.runs[k], self.drawings[k]
        now, exact = run.moments[frame], self.exact[frame]
        drawing.update(now.x, now.v, now.time, color="plain", memory=now.memory)
        edge = float(np.ptp(run.simulation.body.rest, axis=0).max()) or 1.0
        away = np.linalg.norm(now.x.astype(float) - exact.x, axis=1)
        place = np.log(np.maximum(away / edge, LEAST) / LEAST) / np.log(MOST / LEAST)
        rgb = self.ramp[(np.clip(place, 0.0, 1.0) * (len(self.ramp) - 1)).astype(int)]
        if drawing.springs is not None:
            shown = len(drawing.springs.lines.x) // 2
            drawing.springs.lines.rgb[:] = rgb[drawing.springs.pairs[:shown].ravel()]
            drawing.springs.key = Key(f"drift, log from {1e3 * LEAST * edge:g} mm", "mm", 1e3 * MOST * edge, self.ramp)
        self.renderer.draw(drawing, drawing.viewpoint)
        image = self.renderer.image()
        sheet = legend(drawing.key, now.time, self.size)
        words = f"{run.simulation.method}, dt {1e3 * run.simulation.dt:.2g} ms"
        words += f", stopped at {run.stopped:.2g} s" if run.stopped is not None else ""
        rms = 1e3 * float(np.sqrt(np.mean(away**2)))
        height = self.size[1] / 24.0
        sheet.text(words, height, 1.8 * height, height)
        sheet.text(f"drift {plain(rms)} mm", height, 3.6 * height, 0.8 * height)
        sheet.stamp(image)
        return image

    def close(self) -> None:
        self.renderer.close()
