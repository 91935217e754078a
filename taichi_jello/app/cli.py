"""The command line: each subcommand reads its options, calls one function and prints."""

import argparse
import contextlib
import functools
import json
import os
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import taichi_jello.scenefiles as sceneio
from taichi_jello.app import energy_plot
from taichi_jello.app.options import options, studies
from taichi_jello.run.clock import steps_in
from taichi_jello.run.diverged import Diverged
from taichi_jello.run.replay import Recorded, Replay, Replayed, ReplayError, playable
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.trajectory import Trajectory, last_moment
from taichi_jello.scene.description import Scene, SceneError
from taichi_jello.scenefiles._table import changed
from taichi_jello.studies._report import FIGURES, Lacking, write_csv
from taichi_jello.studies._report import write_json as write_figures
from taichi_jello.support import interrupt, runtime
from taichi_jello.support.progress import bar
from taichi_jello.support.wording import counted


class Mistake(Exception):
    """Something in the call that cannot be: one line for the person."""


def make_scene(chosen: argparse.Namespace) -> Scene:
    scene = sceneio.load(chosen.scene)
    for key, value in chosen.settings:
        try:
            scene = changed(scene, key.split("."), value)
        except SceneError as error:
            raise Mistake(f"--set {error}") from None
    return in_color(chosen, scene)


def in_color(chosen: argparse.Namespace, scene: Scene) -> Scene:
    color = getattr(chosen, "color", None) or scene.camera.color
    return replace(scene, camera=replace(scene.camera, color=color))


def step_as_asked(chosen: argparse.Namespace, scene: Scene) -> Simulation:
    return Simulation(
        scene,
        method=chosen.method,
        dt=chosen.dt,
        substeps=chosen.substeps,
        ledger=getattr(chosen, "ledger", False),
        check_start=not getattr(chosen, "from_state", None),
    )


def make_simulation(chosen: argparse.Namespace, scene: Scene) -> Simulation:
    runtime.start(chosen.arch, chosen.precision, chosen.threads)
    try:
        simulation = step_as_asked(chosen, scene)
    except SceneError as error:
        if error.key in ("dt", "substeps"):  # which a scene has not at its top
            raise Mistake(f"--{error}") from None
        raise Mistake(str(sceneio.located(chosen.scene, error))) from None
    if chosen.from_state:
        try:
            simulation.restore(last_moment(Path(chosen.from_state), simulation.body))
        except OSError as error:
            raise Mistake(f"--from {chosen.from_state}: {error.strerror or error}") from None
        except ValueError as error:
            raise Mistake(f"--from {chosen.from_state}: {error}") from None
    if simulation.method_told and chosen.command in ("run", "shot", "video"):
        say(chosen, simulation.method_told)
    return simulation


def make_run(chosen: argparse.Namespace, scene: Scene) -> tuple[Any, Simulation, float]:
    """What is to be stepped, what is to be looked at, and how long [s]: the scene's simulation, or with --replay the
    one that repeats a play."""
    if not chosen.replay:
        simulation = make_simulation(chosen, scene)
        return simulation, simulation, scene.seconds
    if chosen.from_state:
        raise Mistake("--from: a replay begins where its play began; give one of --from and --replay")
    path = Path(chosen.replay)
    try:
        replay = Replay(path)
        replayed = Replayed(make_simulation(chosen, playable(scene)), replay)
        return replayed, replayed.simulation, replayed.length * replayed.dt
    except OSError as error:
        raise Mistake(f"--replay {path}: {error.strerror or error}") from None
    except (ReplayError, UnicodeDecodeError) as error:
        raise Mistake(f"--replay {error}") from None


def output(name: str, *suffixes: str, option: str = "-o") -> Path:
    """The path of a file to be written, checked before any work is done for it."""
    path = Path(name)
    if suffixes and path.suffix not in suffixes:
        raise Mistake(f"{option} {name}: expected a name ending in {' or '.join(suffixes)}")
    if path.is_dir() or not path.parent.is_dir():
        raise Mistake(f"{option} {name}: expected a file in a folder that exists")
    if not os.access(path.parent, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise Mistake(f"{option} {name}: may not be written")
    if not path.exists():
        try:
            tempfile.TemporaryFile(dir=path.parent).close()
        except OSError as error:  # a folder of the system's own, a full disk
            raise Mistake(f"{option} {name}: its folder takes no files: {error.strerror}") from None
    return path


def write_json(name: str | None, told: Any) -> None:
    if name:
        try:
            Path(name).write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise Mistake(f"--json {name}: {error.strerror}") from None


def say(chosen: argparse.Namespace, text: str) -> None:
    if not chosen.quiet:
        print(text, flush=True)


def do_list(chosen: argparse.Namespace) -> None:
    for name, path in sceneio.demos().items():
        print(f"{name:10s} {sceneio.describe(path)}")


def do_run(chosen: argparse.Namespace) -> None:
    path = output(chosen.output, ".npz")
    plot_path = output(chosen.plot, *FIGURES, option="--plot") if chosen.plot else None
    chosen.ledger = chosen.ledger or plot_path is not None
    scene = make_scene(chosen)
    stepped, simulation, seconds = make_run(chosen, scene)
    trajectory = Trajectory(simulation)
    seconds = seconds if chosen.seconds is None else chosen.seconds
    per_save = max(1, round((chosen.every or simulation.frame_dt) / stepped.dt))
    total = steps_in(seconds, stepped.dt)
    trajectory.add()
    try:
        for done in bar(range(0, total, per_save), scene.title, quiet=chosen.quiet):
            stepped.step(min(per_save, total - done))
            trajectory.add()
    except Diverged:
        trajectory.add()
        trajectory.save(path)
        print(f"jello: saved up to the last good state, {simulation.time:.6g} s, in {path}", file=sys.stderr)
        raise
    trajectory.save(path)
    energy = ", ".join(f"{name} {value:.4g}" for name, value in simulation.energies().items())
    say(
        chosen,
        f"{path}: {counted(len(trajectory.moments), 'moment')} to {simulation.time:.6g} s; energies [J] {energy}",
    )
    if chosen.ledger:
        work = ", ".join(f"{name} {joules:.4g}" for name, joules in simulation.work.items())
        say(chosen, f"work [J] {work or 'none'}; residual {simulation.energy_residual:.3g}")
    if plot_path:
        with plotting(plot_path):
            energy_plot.draw(trajectory.arrays(), scene.title or chosen.scene, plot_path)


@contextlib.contextmanager
def plotting(path: Path) -> Iterator[None]:
    """Tell what lacks for a plot as a mistake."""
    try:
        yield
    except Lacking as error:
        raise Mistake(f"--plot {path}: {error}") from None


@contextlib.contextmanager
def last_good_kept(simulation: Simulation, path: Path) -> Iterator[None]:
    """If the numbers go bad within, keep the last good state beside `path`."""
    try:
        yield
    except Diverged:
        trajectory = Trajectory(simulation)
        trajectory.add()
        kept = path.with_suffix(".last-good.npz")
        trajectory.save(kept)
        print(f"jello: the last good state, {simulation.time:.6g} s, is in {kept}", file=sys.stderr)
        raise


def do_shot(chosen: argparse.Namespace) -> None:
    from taichi_jello.support.png_file import write_png
    from taichi_jello.view import picture

    path = output(chosen.output, ".png")
    stepped, simulation, _ = make_run(chosen, make_scene(chosen))
    if chosen.at < stepped.time:
        raise Mistake(f"--at {chosen.at:g}: expected at least {stepped.time:g} s, where --from begins")
    with last_good_kept(simulation, path):
        stepped.advance(chosen.at - stepped.time)
    write_png(path, picture(stepped, chosen.size, renderer=chosen.renderer))
    say(chosen, f"{path}: {simulation.scene.title or chosen.scene} at {stepped.time:.4g} s")


def do_video(chosen: argparse.Namespace) -> None:
    from taichi_jello.film import Film, FilmProblem, Mesh
    from taichi_jello.view.render.film_frames import Clock, Pictures, Skins

    try:
        film = Film(chosen.output, chosen.size, chosen.fps, keep=(KeyboardInterrupt, Diverged))
    except FilmProblem as error:
        raise Mistake(f"-o {chosen.output}: {error}") from None
    path = output(chosen.output, film.path.suffix)
    stepped, simulation, seconds = make_run(chosen, make_scene(chosen))
    clock = Clock(stepped, film.rate, chosen.speed)
    count = clock.frames(seconds if chosen.seconds is None else chosen.seconds)
    try:
        camera = Skins(simulation) if film.takes is Mesh else Pictures(stepped, chosen.size, chosen.renderer)
    except ValueError as error:
        raise Mistake(f"-o {chosen.output}: {error}") from None
    try:
        with last_good_kept(simulation, path.with_name(f"{film.stem}.npz")), contextlib.closing(camera), film:
            for k in bar(range(count), simulation.scene.title, quiet=chosen.quiet):
                clock.go(k)
                film.add(camera.take())
    except (KeyboardInterrupt, Diverged):
        told = f"{path} has the first {film.frames} of {count} frames" if film.kept else "no film is kept"
        print(f"jello: stopped; {told}", file=sys.stderr)
        raise
    say(chosen, f"{path}: {counted(film.frames, 'frame')}, {float(film.frames / film.rate):.4g} s")


def play_in_window(chosen: argparse.Namespace) -> None:
    from taichi_jello.view.window.play import play

    def make(scene: Scene) -> Simulation:
        return step_as_asked(chosen, playable(in_color(chosen, scene)))

    stepped, simulation, _ = make_run(chosen, playable(make_scene(chosen)))
    if not chosen.log:
        play(stepped, size=chosen.size, seconds=chosen.seconds, make=make)
        return
    try:
        recorded = Recorded(simulation, Path(chosen.log))
    except OSError as error:
        raise Mistake(f"--log {chosen.log}: {error.strerror or error}") from None
    with contextlib.closing(recorded):
        play(recorded, size=chosen.size, seconds=chosen.seconds, make=make)
    say(chosen, recorded.close())


def do_play(chosen: argparse.Namespace) -> None:
    from taichi_jello.support.png_file import unused, write_png
    from taichi_jello.view import film_strip, window_problem

    if chosen.log and (chosen.replay or chosen.from_state):
        raise Mistake("--log: a play is recorded from the scene's beginning; leave out --replay and --from")
    problem = "a window needs the renderer ggui" if chosen.renderer == "raster" else window_problem()
    if problem is None:
        play_in_window(chosen)
        return
    if chosen.log:
        raise Mistake(f"--log {chosen.log}: there is nothing to record without a window: {problem}")
    stepped, simulation, seconds = make_run(chosen, make_scene(chosen))
    path = output(unused(Path(f"{Path(chosen.scene).stem}.png")).name, ".png")
    say(chosen, f"no window: {problem}; drawing offscreen instead")
    with last_good_kept(simulation, path):
        strip = film_strip(stepped, chosen.size, renderer=chosen.renderer, seconds=seconds)
    write_png(path, strip)
    print(path.resolve())


def do_explain(chosen: argparse.Namespace) -> None:
    from taichi_jello.run.explain import facts, text

    told = facts(make_simulation(chosen, make_scene(chosen)))
    write_json(chosen.json, told)
    say(chosen, text(told))


def do_study(chosen: argparse.Namespace) -> None:
    found = studies()
    if chosen.name not in found:
        raise Mistake(f"study: expected one of {', '.join(found)}, got {chosen.name!r}")
    study = found[chosen.name]
    for option, name in (("--plot", "plot"), ("--csv", "rows"), ("--poses", "POSES")):
        if getattr(chosen, option[2:]) and not hasattr(study, name):
            raise Mistake(f"{option}: the study {chosen.name} has none")
    json_path = output(chosen.json, option="--json") if chosen.json else None
    csv_path = output(chosen.csv, option="--csv") if chosen.csv else None
    plot_path = output(chosen.plot, *getattr(study, "PLOTS", FIGURES), option="--plot") if chosen.plot else None
    chosen.load, chosen.scenes = functools.partial(make_scene, chosen), chosen.scene
    chosen.scene = chosen.scenes[0] if chosen.scenes else None
    if len(chosen.scenes) > 1 and not getattr(study, "MANY", False):
        raise Mistake(f"study {chosen.name}: expected one scene, got {', '.join(chosen.scenes)}")
    told = study.measure(chosen)
    say(chosen, study.text(told))
    if json_path:
        write_figures(json_path, told)
    if csv_path:
        write_csv(csv_path, study.rows(told))
    if plot_path:
        with plotting(plot_path):
            study.plot(told, plot_path)
    if told.get("interrupted"):
        raise KeyboardInterrupt


def main(arguments: list[str] | None = None) -> int:
    """Run one command. Exit status: 0 done, 2 a mistake in the call or the scene, 3 the numbers went bad."""
    warnings.showwarning = lambda message, *_, **__: print(f"jello: warning: {message}", file=sys.stderr)
    with interrupt.heeded():
        return obeyed(sys.argv[1:] if arguments is None else arguments)


def obeyed(arguments: list[str]) -> int:
    """Do what was asked for. Returns the exit status."""
    try:
        parser = options()
        chosen = parser.parse_args(arguments if arguments else ["play"])
        if chosen.command is None:
            parser.error("expected a command")
        globals()[f"do_{chosen.command}"](chosen)
    except ReplayError as error:
        print(f"jello: --replay {error}", file=sys.stderr)
        return 2
    except (Mistake, SceneError, runtime.RuntimeProblem) as error:
        print(f"jello: {error}", file=sys.stderr)
        return 2
    except Diverged as error:
        print(f"jello: {error}", file=sys.stderr)
        return 3
    except BrokenPipeError:  # the reader, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        print(f"jello: {error.filename or ''}: {error.strerror or error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except Exception:
        if interrupt.asked():  # inside a class, Python makes RuntimeError of it
            return 130
        raise
    return 0
