"""The options of the command line."""

import argparse
import sys
import tomllib
from typing import Any, NoReturn

from taichi_jello import __version__
from taichi_jello.scene.look import COLORS, SHOWS
from taichi_jello.scene.validation import LARGEST, SMALLEST
from taichi_jello.support import runtime
from taichi_jello.support.plugins import modules


class Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {message} (see {self.prog} --help)", file=sys.stderr)
        raise SystemExit(2)


def number(text: str, low: float, expected: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= LARGEST:
        raise argparse.ArgumentTypeError(f"expected a number {expected}, got {text!r}")
    return value


def positive(text: str) -> float:
    return number(text, SMALLEST, f"greater than 0, {SMALLEST:g} to {LARGEST:g}")


def not_negative(text: str) -> float:
    return number(text, 0.0, f"of at least 0, at most {LARGEST:g}")


def turns(text: str) -> float:
    return number(text, -LARGEST, f"of turns, {-LARGEST:g} to {LARGEST:g}")


def count(text: str) -> int:
    if not (text.isascii() and text.isdigit()) or int(text) < 1:
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
    from taichi_jello.view.render.renderers import NAMES

    if text not in NAMES:
        raise argparse.ArgumentTypeError(f"expected one of {', '.join(NAMES)}, got {text!r}")
    return text


def setting(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    if not equals or not key:
        raise argparse.ArgumentTypeError(f"expected key.path=value, got {text!r}")
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError):
        return key, value


def shared_options() -> tuple[Parser, Parser, Parser]:
    """The options of simulations, of --replay and of pictures, shared by several commands."""
    scene = Parser(add_help=False)
    scene.add_argument("--method", metavar="NAME", help="integrator, instead of the scene's")
    scene.add_argument("--dt", type=step_size, metavar="auto|S", help="step in seconds, or the largest safe one")
    scene.add_argument("--substeps", type=count, metavar="N", help="steps in a drawn frame, in place of --dt")
    scene.add_argument("--arch", choices=runtime.ARCHES, default="cpu")
    scene.add_argument("--precision", choices=runtime.PRECISIONS, default="f32")
    scene.add_argument("--threads", type=count, metavar="N", help="CPU threads, by default all")
    scene.add_argument("--set", type=setting, action="append", default=[], metavar="KEY=VALUE", dest="settings",
                       help="override any scene key, for example jello.0.stiffness=300")  # fmt: skip
    scene.add_argument("--from", metavar="STATE.npz", dest="from_state", help="start from the last moment there")
    scene.add_argument("--quiet", action="store_true", help="print nothing but errors and warnings")

    replay = Parser(add_help=False)
    replay.add_argument("--replay", metavar="FILE", help="repeat a play recorded with --log")

    drawing = Parser(add_help=False)
    drawing.add_argument("--size", type=picture_size, default=(1280, 720), metavar="WxH")
    drawing.add_argument("--color", choices=COLORS, help="what the springs' colour shows")
    drawing.add_argument("--show", choices=SHOWS, help="what is drawn of jellos")
    drawing.add_argument("--scale", type=positive, metavar="N", help="the end of the colour scale, in N, %% or N/m")
    drawing.add_argument("--renderer", type=renderer, default="auto", metavar="NAME", help="auto, ggui or raster")
    return scene, replay, drawing


def options() -> Parser:
    """The parser of all commands."""
    parser = Parser(prog="jello", description="Real-time mass-spring jello. Without a command: play the cube.")
    parser.add_argument("--version", action="version", version=f"taichi_jello {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)
    scene, replay, drawing = shared_options()

    def add(name: str, text: str, parents: list[Any], **default_scene: Any) -> Any:
        command = commands.add_parser(name, help=text, description=text, parents=parents)
        if parents:
            command.add_argument("scene", metavar="SCENE", help="a demo, or a .py, .toml or .w file", **default_scene)
        return command

    play = add("play", "the interactive window", [scene, drawing, replay], nargs="?", default="cube")
    play.add_argument("--seconds", type=not_negative, metavar="S", help="close the window after that long")
    play.add_argument("--log", metavar="FILE", help="record the play in the window, for --replay")
    add("list", "the demos, one line each", [])
    run = add("run", "headless physics, written as NPZ", [scene, replay])
    run.add_argument("-o", "--output", required=True, metavar="OUT.npz")
    run.add_argument("--seconds", type=not_negative, metavar="S", help="how long to simulate")
    run.add_argument("--every", type=positive, metavar="S", help="time between saved moments, by default a frame")
    for command in (play, run):
        command.add_argument("--ledger", action="store_true", help="book the work of dashpots, friction and the like")
    run.add_argument("--plot", metavar="FILE", help="draw energies, work and the method's error there; keeps a ledger")
    shot = add("shot", "one picture", [scene, drawing, replay])
    shot.add_argument("-o", "--output", required=True, metavar="OUT.png")
    shot.add_argument("--at", type=not_negative, default=1.0, metavar="S", help="the moment, by default 1 s")
    video = add("video", "a film, pictures of it or its skin as meshes", [scene, drawing, replay])
    video.add_argument("-o", "--output", required=True, metavar="OUT.mp4|.gif",
                       help="or a file for each frame: name-%%04d.png, or .ply or .obj for the skin")  # fmt: skip
    video.add_argument("--seconds", type=not_negative, metavar="S", help="how long to simulate")
    video.add_argument("--fps", type=positive, metavar="N", help="frames a second: 60, or 25 for .gif")
    video.add_argument("--turn", type=turns, metavar="N", help="how often the camera goes round in the whole film")
    video.add_argument("--speed", type=positive, default=1.0, metavar="X", help="0.25 is four times slower than life")
    explain = add("explain", "what a scene compiles in and leaves out, and where its step comes from", [scene])
    explain.add_argument("--json", metavar="FILE", help="write the facts there too")
    study = commands.add_parser("study", help="measurements", parents=[scene])
    study.add_argument("name", metavar="NAME", help=f"one of {', '.join(studies())}")
    study.add_argument("scene", metavar="SCENE", nargs="*")
    study.add_argument("--json", metavar="FILE", help="write the figures there too")
    study.add_argument("--csv", metavar="FILE", help="write them as a table there too")
    study.add_argument("--plot", metavar="FILE", help="draw them there")
    study.add_argument("--seconds", type=positive, metavar="S", help="how long to simulate, instead of the study's own")
    study.add_argument("--poses", type=count, metavar="N", help="contact: how many for each pair, instead of its own")
    study.add_argument("--quick", action="store_true", help="a reduced ladder")
    return parser


def studies() -> dict[str, Any]:
    """The modules of the studies by name."""
    from taichi_jello import studies as folder

    return {module.__name__.rpartition(".")[2]: module for module in modules(folder)}
