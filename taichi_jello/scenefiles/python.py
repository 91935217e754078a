"""Scenes written in Python: a file with a function `scene()` that returns a Scene."""

import runpy
import traceback
from pathlib import Path

from taichi_jello.scene.description import Scene
from taichi_jello.scene.validation import SceneError, cut, shown
from taichi_jello.scenefiles._own_code import COMPILED

SUFFIX = ".py"


def _place(path: Path, error: BaseException) -> str:
    """The last line of the file in an error's traceback; empty if there is none."""
    lines = [line for frame, line in traceback.walk_tb(error.__traceback__) if frame.f_code.co_filename == str(path)]
    if isinstance(error, SyntaxError) and error.filename == str(path):
        lines.append(error.lineno or 1)
    return f"line {lines[-1]}: " if lines else ""


def failure(error: BaseException, place: str) -> SceneError:
    """An error that a file's code raised at `place`, in one line. Of what Taichi could not compile the last line of its
    report says why."""
    try:
        text = str(error).strip()
        told = text.splitlines()[-1] if COMPILED.search(text) else text.partition("\n")[0]
        text = cut(f": {told}", 200).removesuffix(": ")
    except Exception:
        text = ", whose message cannot be shown"
    return SceneError("", f"{place}it fails with {type(error).__name__}{text}")


def load(path: Path) -> Scene:
    try:
        names = runpy.run_path(str(path), run_name="taichi_jello_scene")
        if not callable(names.get("scene")):
            raise SceneError("scene", "expected a function scene() that returns a Scene")
        made = names["scene"]()
    except SceneError as error:
        raise SceneError("", f"{_place(path, error)}{error}") from error
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(f"{path}: {_place(path, error)}stopped while it was loaded") from None
    except BaseException as error:  # a file may raise anything
        raise failure(error, _place(path, error)) from error
    if not isinstance(made, Scene):
        line = names["scene"].__code__.co_firstlineno if hasattr(names["scene"], "__code__") else 1
        raise SceneError("", f"line {line}: scene: expected scene() to return a Scene, got {shown(made)}")
    return made
