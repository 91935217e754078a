"""The command line: one function per subcommand."""

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

import taichi_jello.scenefiles as sceneio
from taichi_jello.app import energy_plot
from taichi_jello.app.options import options, studies
from taichi_jello.run.clock import steps_in
from taichi_jello.run.diverged import Diverged
from taichi_jello.run.replay import Recorded, Replay, Replayed, ReplayError, playable
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.trajectory import Trajectory, last_moment
from taichi_jello.scene.description import Scene, SceneError
from taichi_jello.scene.validation import printable
from taichi_jello.scenefiles._table import changed
from taichi_jello.studies._report import FIGURES, Lacking, write_csv, write_json
from taichi_jello.support import interrupt, runtime
from taichi_jello.support.progress import bar
from taichi_jello.support.wording import counted


class Mistake(Exception):
    """An error in the call, in one line."""


@contextlib.contextmanager
def mistakes(prefix: str, *kinds: type[Exception]) -> Iterator[None]:
    """Turn these exceptions into a Mistake that begins with `prefix`."""
    try:
        yield
    except kinds as error:
        raise Mistake(f"{prefix}{(isinstance(error, OSError) and error.strerror) or error}") from None


def make_scene(chosen: argparse.Namespace) -> Scene:
    scene = sceneio.load(chosen.scene)
    for key, value in chosen.settings:
        with mistakes("--set ", SceneError):
            scene = changed(scene, key.split("."), value)
    return as_seen(chosen, scene)


def as_seen(chosen: argparse.Namespace, scene: Scene) -> Scene:
    """With what --color, --show and --scale ask of the camera."""
    asked = {name: getattr(chosen, name, None) for name in ("color", "show", "scale")}
    return replace(scene, camera=replace(scene.camera, **{name: it for name, it in asked.items() if it is not None}))


def with_step(chosen: argparse.Namespace, scene: Scene) -> Simulation:
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
        simulation = with_step(chosen, scene)
    except SceneError as error:
        if error.key in ("dt", "substeps"):  # options, not top-level keys of a scene
            raise Mistake(f"--{error}") from None
        raise Mistake(str(sceneio.located(chosen.scene, error))) from None
    if chosen.from_state:
        with mistakes(f"--from {chosen.from_state}: ", OSError, ValueError, TypeError):
            simulation.restore(last_moment(Path(chosen.from_state), simulation.body))
    if simulation.method_told and chosen.command in ("run", "shot", "video"):
        say(chosen, simulation.method_told)
    return simulation


def make_run(chosen: argparse.Namespace, scene: Scene) -> tuple[Simulation | Replayed, Simulation, float]:
    """What to step, the simulation in it, and the length [s]: with --replay a simulation that repeats a play, else the
    scene's own."""
    if not chosen.replay:
        simulation = make_simulation(chosen, scene)
        return simulation, simulation, scene.seconds
    if chosen.from_state:
        raise Mistake("--from: a replay begins where its play began; give one of --from and --replay")
    path = Path(chosen.replay)
    with mistakes(f"--replay {path}: ", OSError), mistakes("--replay ", ReplayError, UnicodeDecodeError):
        replay = Replay(path)
        replayed = Replayed(make_simulation(chosen, playable(scene)), replay)
    return replayed, replayed.simulation, replayed.length * replayed.dt


def output(name: str, *suffixes: str, option: str = "-o") -> Path:
    """The path of an output file, checked before any work is done."""
    path = Path(name)
    if suffixes and path.suffix.lower() not in suffixes:
        raise Mistake(f"{option} {name}: expected a name ending in {' or '.join(suffixes)}")
    if path.is_dir() or not path.parent.is_dir():
        raise Mistake(f"{option} {name}: expected a file in a folder that exists")
    if not os.access(path.parent, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise Mistake(f"{option} {name}: may not be written")
    if not path.exists():
        try:
            tempfile.TemporaryFile(dir=path.parent).close()
        except OSError as error:  # a system folder or a full disk
            raise Mistake(f"{option} {name}: its folder takes no files: {error.strerror}") from None
    return path


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
    moments = counted(len(trajectory.moments), "moment")
    say(chosen, f"{path}: {moments} to {simulation.time:.6g} s; energies [J] {energy}")
    if chosen.ledger:
        work = ", ".join(f"{name} {joules:.4g}" for name, joules in simulation.work.items())
        say(chosen, f"work [J] {work or 'none'}; residual {simulation.energy_residual:.3g}")
    if plot_path:
        with mistakes(f"--plot {plot_path}: ", Lacking):
            energy_plot.draw(trajectory.arrays(), scene.title or chosen.scene, plot_path)


@contextlib.contextmanager
def last_good_kept(simulation: Simulation, path: Path) -> Iterator[None]:
    """If the simulation diverges within, save the last good state beside `path`."""
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

    with mistakes(f"-o {chosen.output}: ", FilmProblem):
        film = Film(chosen.output, chosen.size, chosen.fps, keep=(KeyboardInterrupt, Diverged))
    path = output(chosen.output, film.path.suffix)
    stepped, simulation, seconds = make_run(chosen, make_scene(chosen))
    clock = Clock(stepped, film.rate, chosen.speed)
    seconds = seconds if chosen.seconds is None else chosen.seconds
    count = clock.frames(seconds)
    with mistakes(f"-o {chosen.output}: ", ValueError):
        orbit = None if chosen.turn is None else chosen.turn / max(seconds, clock.per_frame)
        camera = Skins(simulation) if film.takes is Mesh else Pictures(stepped, chosen.size, chosen.renderer, orbit)
    try:
        with last_good_kept(simulation, path.with_name(f"{film.stem}.npz")), contextlib.closing(camera), film:
            for k in bar(range(count), simulation.scene.title, quiet=chosen.quiet):
                clock.go(k)
                film.add(camera.take())
    except (KeyboardInterrupt, Diverged):
        kept = f"{path} has the first {film.frames} of {count} frames" if film.kept else "no film is kept"
        print(f"jello: stopped; {kept}", file=sys.stderr)
        raise
    say(chosen, f"{path}: {counted(film.frames, 'frame')}, {float(film.frames / film.rate):.4g} s")


def play_in_window(chosen: argparse.Namespace) -> None:
    from taichi_jello.view.window.play import play

    def make(scene: Scene) -> Simulation:
        return with_step(chosen, playable(as_seen(chosen, scene)))

    stepped, simulation, _ = make_run(chosen, playable(make_scene(chosen)))
    if not chosen.log:
        play(stepped, size=chosen.size, seconds=chosen.seconds, make=make, renderer=chosen.renderer)
        return
    with mistakes(f"--log {chosen.log}: ", OSError):
        recorded = Recorded(simulation, Path(chosen.log))
    with contextlib.closing(recorded):
        play(recorded, size=chosen.size, seconds=chosen.seconds, make=make, renderer=chosen.renderer)
    say(chosen, recorded.close())


def do_play(chosen: argparse.Namespace) -> None:
    from taichi_jello.support.png_file import unused, write_png
    from taichi_jello.view import film_strip, window_problem

    if chosen.log and (chosen.replay or chosen.from_state):
        raise Mistake("--log: a play is recorded from the scene's beginning; leave out --replay and --from")
    problem = window_problem()
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

    found = facts(make_simulation(chosen, make_scene(chosen)))
    if chosen.json:
        with mistakes(f"--json {chosen.json}: ", OSError):
            Path(chosen.json).write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    say(chosen, text(found))


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
    result = study.measure(chosen)
    say(chosen, study.text(result))
    if json_path:
        write_json(json_path, result)
    if csv_path:
        write_csv(csv_path, study.rows(result))
    if plot_path:
        with mistakes(f"--plot {plot_path}: ", Lacking):
            study.plot(result, plot_path)
    if result.get("interrupted"):
        raise KeyboardInterrupt


def main(arguments: list[str] | None = None) -> int:
    """Run one command. Exit status: 0 done, 2 invalid call or scene, 3 diverged, 130 Ctrl-C."""
    warnings.showwarning = lambda message, *_, **__: print(
        f"jello: warning: {printable(str(message))}", file=sys.stderr
    )
    with interrupt.heeded():
        try:
            parser = options()
            chosen = parser.parse_args((sys.argv[1:] if arguments is None else arguments) or ["play"])
            if chosen.command is None:
                parser.error("expected a command")
            globals()[f"do_{chosen.command}"](chosen)
        except (Mistake, SceneError, ReplayError, runtime.RuntimeProblem) as error:
            print(printable(f"jello: {'--replay ' * isinstance(error, ReplayError)}{error}"), file=sys.stderr)
            return 2
        except Diverged as error:
            print(f"jello: {error}", file=sys.stderr)
            return 3
        except BrokenPipeError:  # the reader, such as `head`, has seen enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        except OSError as error:
            print(f"jello: {error.filename or ''}: {error.strerror or error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt as error:
            if str(error):
                print(f"jello: {printable(str(error))}", file=sys.stderr)
            return 130
        except Exception as error:
            if interrupt.asked():  # Python turns it into RuntimeError inside a class
                return 130
            problem = sceneio.failure(error)
            if problem is None:
                raise
            print(printable(f"jello: {problem}"), file=sys.stderr)
            return 2
        return 0
