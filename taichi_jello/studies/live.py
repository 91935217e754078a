"""The same scene under several methods side by side, coloured by the drift from a reference."""

import argparse
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello import scenefiles
from taichi_jello.run.diverged import Diverged
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.description import Scene, SceneError
from taichi_jello.studies._report import INTERRUPTED, Lacking, headline, machine, methods_of, seconds_of, table, take
from taichi_jello.support import runtime
from taichi_jello.support.progress import bar
from taichi_jello.support.wording import plain

PLOTS = (".png", ".mp4", ".gif")
SIZE = (1280, 720)  # pixels of the whole picture
USUAL = ("euler", "symplectic-euler", "verlet", "rk4")
SECONDS = {False: 1.5, True: 0.5}  # by --quick
FINER = 8  # factor of the reference's substeps over those that RK4 needs
MIN_DRIFT, MAX_DRIFT = 1e-5, 1e-1  # over the edge, at the ends of the logarithmic colour scale


@dataclass
class Run:
    """One method's states, a frame apart, the wall-clock time of its frames [s], and when its numbers went bad [s]."""

    simulation: Simulation
    states: list[Snapshot]
    seconds: float = 0.0
    stopped: float | None = None

    def frame(self) -> None:
        """Advance by a frame; a run whose numbers went bad stays in its last good state."""
        if self.stopped is None:
            try:
                self.seconds += seconds_of(self.simulation.frame)
            except Diverged:
                self.stopped = self.simulation.time
        self.states.append(self.simulation.snapshot())


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """Every method's drift [m] at the end; the states for `plot` are under `_runs`. Raises SceneError for an unknown
    method."""
    scene = chosen.load() if chosen.scene else scenefiles.load("cube")
    methods = methods_of(chosen, USUAL)
    frames = max(1, round((chosen.seconds or SECONDS[chosen.quick]) / scene.solver.frame_dt))
    results: dict[str, Any] = machine() | {"methods": [], "_scene": scene, "_exact": [], "_runs": []}
    take(chosen, results, pieces(chosen, scene, methods, frames, results), "live", frames * (1 + len(methods)))
    exact, runs = results["_exact"], results["_runs"]
    done = min((len(run.states) for run in runs), default=0)
    results["methods"] = [row(run, exact, done) for run in runs if done]
    results["seconds"] = exact[done - 1].time if done else 0.0
    return results


def pieces(
    chosen: argparse.Namespace, scene: Scene, methods: list[str], frames: int, results: dict[str, Any]
) -> Iterator[None]:
    """First the reference, RK4 in f64 with short steps, then a frame of every method in turn."""
    arch = runtime.choose_arch(chosen.arch)
    runtime.start("cpu", "f64", chosen.threads)
    best = Simulation(scene, method="rk4")
    best.change_step(substeps=FINER * best.substeps)
    results["_exact"].append(best.snapshot())
    for _ in range(frames):
        best.frame()
        results["_exact"].append(best.snapshot())
        yield
    runtime.start(arch, chosen.precision, chosen.threads)
    for method in methods:
        simulation = started(scene, method, chosen)
        simulation.frame()  # compiles the kernels
        simulation.reset()
        results["_runs"].append(Run(simulation, [simulation.snapshot()]))
    for _ in range(frames):
        for run in results["_runs"]:
            run.frame()
            yield


def started(scene: Scene, method: str, chosen: argparse.Namespace) -> Simulation:
    """With the given step or the method's own safe one; a method without one gets a step as short as RK4 needs."""
    try:
        return Simulation(scene, method=method, dt=chosen.dt, substeps=chosen.substeps)
    except SceneError as error:
        if error.key != "solver.dt":
            raise
        return Simulation(scene, method=method, substeps=4 * Simulation(scene, method="rk4").substeps)


def row(run: Run, exact: list[Snapshot], done: int) -> dict[str, Any]:
    body, frames = run.simulation.body, len(run.states) - 1
    away = run.states[done - 1].x.astype(float) - exact[done - 1].x
    return {
        "method": run.simulation.method,
        "dt": run.simulation.dt,
        "substeps": run.simulation.substeps,
        "drift": float(np.sqrt(np.mean(np.sum(away**2, axis=1)))),
        "centre": float(np.linalg.norm(body.mass @ away) / body.mass.sum()),
        "ms_a_frame": 1e3 * run.seconds / max(1, frames),
        "stopped": run.stopped,
    }


def rows(results: dict[str, Any]) -> list[dict[str, Any]]:
    return list(results["methods"])


def text(results: dict[str, Any]) -> str:
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
        for one in results["methods"]
    ]
    heads = ["method", "dt [s]", "steps a frame", "drift [mm]", "centre [mm]", "ms a frame"]
    about = f"drift from RK4 in f64 with {FINER} times as many steps, after {results['seconds']:.3g} s"
    return "\n".join([headline(results), about, table(heads, cells), *[INTERRUPTED] * results["interrupted"]])


def plot(results: dict[str, Any], path: Path) -> None:
    """The last state as a picture, or all states as a film. Raises Lacking without what a film needs."""
    from taichi_jello.film import Film, FilmProblem
    from taichi_jello.support.png_file import write_png

    if not results["methods"]:
        raise Lacking("nothing was measured that could be drawn")
    count = min(len(run.states) for run in results["_runs"])
    with closing(Tiles(results)) as tiles:
        if path.suffix == ".png":
            write_png(path, tiles.picture(count - 1))
            return
        every = 2 if path.suffix == ".gif" else 1
        try:
            film = Film(path, SIZE, 1.0 / (every * results["_scene"].solver.frame_dt))
        except FilmProblem as error:
            raise Lacking(str(error)) from None
        with film:
            for frame in bar(range(0, count, every), "drawing"):
                film.add(tiles.picture(frame))


class Tiles:
    """Draws all runs of a study in a grid, coloured by their drift."""

    def __init__(self, results: dict[str, Any]):
        from taichi_jello.view.drawing.springs import ramp_table
        from taichi_jello.view.render.renderers import drawing_of, open_renderer

        self.runs, self.exact, self.ramp = results["_runs"], results["_exact"], ramp_table()
        self.columns = ceil(sqrt(len(self.runs)))
        self.size = SIZE[0] // self.columns, SIZE[1] // ceil(len(self.runs) / self.columns)
        self.drawings = [drawing_of(run.simulation, self.size) for run in self.runs]
        for drawing in self.drawings:
            drawing.hidden.add("skin")  # the colour is on the springs
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
        now, exact = run.states[frame], self.exact[frame]
        drawing.update(now.x, now.v, now.time, color="plain", memory=now.memory)
        edge = float(np.ptp(run.simulation.body.rest, axis=0).max()) or 1.0
        drift = np.linalg.norm(now.x.astype(float) - exact.x, axis=1)
        if drawing.springs is not None:
            place = np.log(np.maximum(drift / edge, MIN_DRIFT) / MIN_DRIFT) / np.log(MAX_DRIFT / MIN_DRIFT)
            rgb = self.ramp[(np.clip(place, 0.0, 1.0) * (len(self.ramp) - 1)).astype(int)]
            shown = len(drawing.springs.lines.x) // 2
            drawing.springs.lines.rgb[:] = rgb[drawing.springs.pairs[:shown].ravel()]
            title = f"drift, log from {1e3 * MIN_DRIFT * edge:g} mm"
            drawing.springs.key = Key(title, "mm", 1e3 * MAX_DRIFT * edge, self.ramp)
        self.renderer.draw(drawing, drawing.viewpoint)
        image = self.renderer.image()
        sheet = legend(drawing.key, now.time, self.size)
        words = f"{run.simulation.method}, dt {1e3 * run.simulation.dt:.2g} ms"
        words += f", stopped at {run.stopped:.2g} s" if run.stopped is not None else ""
        height = self.size[1] / 24.0
        sheet.text(words, height, 1.8 * height, height)
        rms = 1e3 * float(np.sqrt(np.mean(drift**2)))
        sheet.text(f"drift {plain(rms)} mm", height, 3.6 * height, 0.8 * height)
        sheet.stamp(image)
        return image

    def close(self) -> None:
        self.renderer.close()
