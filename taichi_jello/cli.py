"""The command line: each subcommand reads its options, calls one function and prints."""

import argparse
import contextlib
import json
import os
import sys
import tomllib
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import taichi_jello.sceneio as sceneio
from taichi_jello import runtime
from taichi_jello.physics.forces.grab import Grab
from taichi_jello.plugins import modules
from taichi_jello.replay import Recorded, Replay, Replayed, ReplayError
from taichi_jello.scene import COLORS, Scene, SceneError, override
from taichi_jello.simulation import Diverged, Simulation
from taichi_jello.trajectory import Trajectory, last_moment


class Mistake(Exception):
    """Something in the call that cannot be: one line for the person."""


class Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {message} (see {self.prog} --help)", file=sys.stderr)
        raise SystemExit(2)


def positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"expected a number greater than 0, got {text!r}")
    return value


def not_negative(text: str) -> float:
    return 0.0 if text in ("0", "0.0") else positive(text)


def count(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, got {text!r}")
    return int(text)


def step_size(text: str) -> float | str:
    return "auto" if text == "auto" else positive(text)


def picture_size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit() and 16 <= int(width) <= 8192 and 16 <= int(height) <= 8192):
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT in pixels, 16 to 8192 each, got {text!r}")
    return int(width), int(height)


def renderer(text: str) -> str:
    from taichi_jello.view.renderers import NAMES

    if text not in NAMES:
        raise argparse.ArgumentTypeError(f"expected one of {', '.join(NAMES)}, got {text!r}")
    return text


def setting(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    if not equals or not key:
        raise argparse.ArgumentTypeError(f"expected key.path=value, got {text!r}")
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key, value


def options() -> Parser:
    """The whole grammar."""
    parser = Parser(prog="jello", description="Real-time mass-spring jello. Without a command: play the cube.")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)

    scene = Parser(add_help=False)
    scene.add_argument("--method", metavar="NAME", help="integrator, instead of the scene's")
    scene.add_argument("--dt", type=step_size, metavar="auto|S", help="step in seconds, or the largest safe one")
    scene.add_argument("--substeps", type=count, metavar="N", help="steps in a drawn frame, instead of --dt")
    scene.add_argument("--arch", choices=runtime.ARCHES, default="cpu")
    scene.add_argument("--precision", choices=runtime.PRECISIONS, default="f32")
    scene.add_argument("--threads", type=count, metavar="N", help="CPU threads, by default all")
    scene.add_argument("--set", type=setting, action="append", default=[], metavar="KEY=VALUE", dest="settings",
                       help="override any scene key, for example jello.0.stiffness=300")  # fmt: skip
    scene.add_argument("--from", metavar="STATE.npz", dest="from_state", help="start from the last moment there")
    scene.add_argument("--quiet", action="store_true", help="print nothing but errors and warnings")

    replay = Parser(add_help=False)
    replay.add_argument("--replay", metavar="FILE", help="do again what a play recorded with --log")

    drawing = Parser(add_help=False)
    drawing.add_argument("--size", type=picture_size, default=(1280, 720), metavar="WxH")
    drawing.add_argument("--color", choices=COLORS, help="what the springs' colour shows")
    drawing.add_argument("--renderer", type=renderer, default="auto", metavar="NAME", help="auto, ggui or raster")

    def add(name: str, text: str, parents: list[Any], **default_scene: Any) -> Any:
        command = commands.add_parser(name, help=text, description=text, parents=parents)
        if parents:
            command.add_argument("scene", metavar="SCENE", help="a demo's name, a .py or a .toml", **default_scene)
        return command

    play = add("play", "the interactive window", [scene, drawing, replay], nargs="?", default="cube")
    play.add_argument("--seconds", type=not_negative, metavar="S", help="close the window after that long")
    play.add_argument("--log", metavar="FILE", help="record what is done in the window, for --replay")
    add("list", "the demos, one line each", [])
    run = add("run", "headless physics, written as NPZ", [scene, replay])
    run.add_argument("-o", "--output", required=True, metavar="OUT.npz")
    run.add_argument("--seconds", type=not_negative, metavar="S", help="how long to simulate")
    run.add_argument("--every", type=positive, metavar="S", help="time between saved moments, by default a frame")
    shot = add("shot", "one picture", [scene, drawing, replay])
    shot.add_argument("-o", "--output", required=True, metavar="OUT.png")
    shot.add_argument("--at", type=not_negative, default=1.0, metavar="S", help="the moment, by default 1 s")
    video = add("video", "a film, pictures of it or its skin as meshes", [scene, drawing, replay])
    video.add_argument("-o", "--output", required=True, metavar="OUT.mp4|.gif",
                       help="or a file for each frame: name-%%04d.png, or .ply or .obj for the skin")  # fmt: skip
    video.add_argument("--seconds", type=not_negative, metavar="S", help="how long to simulate")
    video.add_argument("--fps", type=positive, metavar="N", help="frames a second: 60, or 25 for .gif")
    video.add_argument("--speed", type=positive, default=1.0, metavar="X", help="0.25 is four times slower than life")
    explain = add("explain", "what a scene compiles in and leaves out, and where its step comes from", [scene])
    explain.add_argument("--json", metavar="FILE", help="write the facts there too")
    study = commands.add_parser("study", help="measurements", parents=[scene])
    study.add_argument("name", metavar="NAME", help=f"one of {', '.join(studies())}")
    study.add_argument("scene", metavar="SCENE", nargs="?")
    study.add_argument("--json", metavar="FILE", help="write the figures there too")
    study.add_argument("--quick", action="store_true", help="a reduced ladder")
    return parser


def studies() -> dict[str, Any]:
    """The studies there are, by name."""
    from taichi_jello import studies as folder

    return {module.__name__.rpartition(".")[2]: module for module in modules(folder)}


def make_scene(chosen: argparse.Namespace) -> Scene:
    scene = sceneio.load(chosen.scene)
    for key, value in chosen.settings:
        try:
            scene = override(scene, key.split("."), value)
        except SceneError as error:
            raise Mistake(f"--set {error}") from None
    if getattr(chosen, "color", None):
        scene = replace(scene, camera=replace(scene.camera, color=chosen.color))
    return scene


def make_simulation(chosen: argparse.Namespace, scene: Scene) -> Simulation:
    if getattr(chosen, "replay", None) and chosen.from_state:
        raise Mistake("--from: a replay begins where its play began; give one of --from and --replay")
    runtime.start(chosen.arch, chosen.precision, chosen.threads)
    try:
        simulation = Simulation(scene, method=chosen.method, dt=chosen.dt, substeps=chosen.substeps)
    except SceneError as error:
        raise Mistake(f"{chosen.scene}: {error}") from None
    if chosen.from_state:
        try:
            simulation.restore(last_moment(Path(chosen.from_state)))
        except OSError as error:
            raise Mistake(f"--from {chosen.from_state}: {error.strerror or error}") from None
        except ValueError as error:
            raise Mistake(f"--from {chosen.from_state}: {error}") from None
    return simulation


def by_hand(scene: Scene) -> Scene:
    """The scene with a hand that can grab its jellos."""
    return scene if any(isinstance(f, Grab) for f in scene.force) else replace(scene, force=(*scene.force, Grab()))


def make_run(chosen: argparse.Namespace, scene: Scene) -> tuple[Any, Simulation, float]:
    """What is to be stepped, what is to be looked at, and how long [s]: the scene's simulation, or with --replay the
    one that repeats a play."""
    if not chosen.replay:
        simulation = make_simulation(chosen, scene)
        return simulation, simulation, scene.seconds
    path = Path(chosen.replay)
    try:
        replay = Replay(path)
        replayed = Replayed(make_simulation(chosen, by_hand(scene)), replay)
        return replayed, replayed.simulation, replayed.length * replayed.dt
    except OSError as error:
        raise Mistake(f"--replay {path}: {error.strerror or error}") from None
    except (ReplayError, UnicodeDecodeError) as error:
        raise Mistake(f"--replay {error}") from None


def output(name: str, suffix: str) -> Path:
    """The path of a file to be written, checked before any work is done for it."""
    path = Path(name)
    if path.suffix != suffix:
        raise Mistake(f"-o {name}: expected a name ending in {suffix}")
    if path.is_dir() or not path.parent.is_dir():
        raise Mistake(f"-o {name}: expected a file in a folder that exists")
    if not os.access(path.parent, os.W_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise Mistake(f"-o {name}: may not be written")
    return path


def write_json(name: str | None, told: Any) -> None:
    if name:
        try:
            Path(name).write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise Mistake(f"--json {name}: {error.strerror}") from None


def bar(chosen: argparse.Namespace, steps: Any, text: str) -> Any:
    """The steps, with a progress bar where somebody watches."""
    if chosen.quiet or not sys.stderr.isatty():
        return steps
    from rich.console import Console
    from rich.progress import track

    return track(steps, description=text, console=Console(stderr=True), transient=True)


def say(chosen: argparse.Namespace, text: str) -> None:
    if not chosen.quiet:
        print(text, flush=True)


def do_list(chosen: argparse.Namespace) -> None:
    for name, path in sceneio.demos().items():
        print(f"{name:10s} {sceneio.describe(path)}")


def do_run(chosen: argparse.Namespace) -> None:
    path = output(chosen.output, ".npz")
    scene = make_scene(chosen)
    stepped, simulation, seconds = make_run(chosen, scene)
    trajectory = Trajectory(simulation)
    seconds = seconds if chosen.seconds is None else chosen.seconds
    per_save = max(1, round((chosen.every or simulation.frame_dt) / stepped.dt))
    total = round(seconds / stepped.dt)
    trajectory.add()
    try:
        for done in bar(chosen, range(0, total, per_save), scene.title):
            stepped.step(min(per_save, total - done))
            trajectory.add()
    except Diverged:
        trajectory.add()
        trajectory.save(path)
        print(f"jello: saved up to the last good state, {simulation.time:.6g} s, in {path}", file=sys.stderr)
        raise
    trajectory.save(path)
    energy = ", ".join(f"{name} {value:.4g}" for name, value in simulation.energies().items())
    say(chosen, f"{path}: {len(trajectory.moments)} moments to {simulation.time:.6g} s; energies [J] {energy}")


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
    from taichi_jello.record import write_png

    path = output(chosen.output, ".png")
    stepped, simulation, _ = make_run(chosen, make_scene(chosen))
    if chosen.at < simulation.time:
        raise Mistake(f"--at {chosen.at:g}: expected at least {simulation.time:g} s, where --from begins")
    with last_good_kept(simulation, path):
        stepped.advance(chosen.at - simulation.time)
    write_png(path, simulation.render(chosen.size, renderer=chosen.renderer))
    say(chosen, f"{path}: {simulation.scene.title or chosen.scene} at {simulation.time:.4g} s")


def do_video(chosen: argparse.Namespace) -> None:
    from taichi_jello.film import Film, FilmProblem, Mesh
    from taichi_jello.film.takes import Clock, Pictures, Skins

    try:
        film = Film(chosen.output, chosen.size, chosen.fps, keep=(KeyboardInterrupt, Diverged))
    except FilmProblem as error:
        raise Mistake(f"-o {chosen.output}: {error}") from None
    path = output(chosen.output, film.path.suffix)
    stepped, simulation, seconds = make_run(chosen, make_scene(chosen))
    clock = Clock(stepped, film.rate, chosen.speed)
    count = clock.frames(seconds if chosen.seconds is None else chosen.seconds)
    try:
        camera = Skins(simulation) if film.takes is Mesh else Pictures(simulation, chosen.size, chosen.renderer)
    except ValueError as error:
        raise Mistake(f"-o {chosen.output}: {error}") from None
    try:
        with last_good_kept(simulation, path.with_name(f"{film.stem}.npz")), contextlib.closing(camera), film:
            for k in bar(chosen, range(count), simulation.scene.title):
                clock.go(k)
                film.add(camera.take())
    except (KeyboardInterrupt, Diverged):
        told = f"{path} has the first {film.frames} of {count} frames" if film.kept else "no film is kept"
        print(f"jello: stopped; {told}", file=sys.stderr)
        raise
    say(chosen, f"{path}: {film.frames} frames, {float(film.frames / film.rate):.4g} s")


def play_in_window(chosen: argparse.Namespace) -> None:
    from taichi_jello.view.viewer import play

    stepped, simulation, _ = make_run(chosen, by_hand(make_scene(chosen)))
    if not chosen.log:
        play(stepped, size=chosen.size, seconds=chosen.seconds)
        return
    try:
        recorded = Recorded(simulation, Path(chosen.log))
    except OSError as error:
        raise Mistake(f"--log {chosen.log}: {error.strerror or error}") from None
    with contextlib.closing(recorded):
        play(recorded, size=chosen.size, seconds=chosen.seconds)
    say(chosen, f"{chosen.log}: {recorded.frames} frames recorded")


def do_play(chosen: argparse.Namespace) -> None:
    from taichi_jello.record import write_png
    from taichi_jello.view import film_strip, window_problem

    if chosen.log and (chosen.replay or chosen.from_state):
        raise Mistake("--log: a play is recorded from the scene's beginning; leave out --replay and --from")
    problem = "a window needs the renderer ggui" if chosen.renderer == "raster" else window_problem()
    if problem is None:
        play_in_window(chosen)
        return
    if chosen.log:
        raise Mistake(f"--log {chosen.log}: there is nothing to record without a window: {problem}")
    stepped, simulation, _ = make_run(chosen, make_scene(chosen))
    path = output(f"{Path(chosen.scene).stem}.png", ".png")
    say(chosen, f"no window: {problem}; drawing offscreen instead")
    with last_good_kept(simulation, path):
        strip = film_strip(stepped, chosen.size, renderer=chosen.renderer)
    write_png(path, strip)
    print(path.resolve())


def do_explain(chosen: argparse.Namespace) -> None:
    from taichi_jello.explain import facts, text

    told = facts(make_simulation(chosen, make_scene(chosen)))
    write_json(chosen.json, told)
    say(chosen, text(told))


def do_study(chosen: argparse.Namespace) -> None:
    found = studies()
    if chosen.name not in found:
        raise Mistake(f"study: expected one of {', '.join(found)}, got {chosen.name!r}")
    told = found[chosen.name].measure(chosen)
    write_json(chosen.json, told)
    say(chosen, found[chosen.name].text(told))


def main(arguments: list[str] | None = None) -> int:
    """Run one command. Exit status: 0 done, 2 a mistake in the call or the scene, 3 the numbers went bad."""
    warnings.showwarning = lambda message, *_, **__: print(f"jello: warning: {message}", file=sys.stderr)
    arguments = sys.argv[1:] if arguments is None else arguments
    parser = options()
    chosen = parser.parse_args(arguments if arguments else ["play"])
    if chosen.command is None:
        parser.error("expected a command")
    try:
        globals()[f"do_{chosen.command}"](chosen)
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
    return 0
