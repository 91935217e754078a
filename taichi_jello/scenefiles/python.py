"""Scenes written in Python: a file with a function `scene()` that returns a Scene."""

import runpy
import traceback
from pathlib import Path

from taichi_jello.scene.description import Scene, SceneError

SUFFIX = ".py"


def _place(path: Path, error: BaseException) -> str:
    """The last line of the file in an error's traceback."""
    lines = [line for frame, line in traceback.walk_tb(error.__traceback__) if frame.f_code.co_filename == str(path)]
    if isinstance(error, SyntaxError) and error.filename == str(path):
        lines.append(error.lineno or 1)
    return f"line {lines[-1]}: " if lines else ""


def load(path: Path) -> Scene:
    try:
        names = runpy.run_path(str(path), run_name="taichi_jello_scene")
        if not callable(names.get("scene")):
            raise SceneError("scene", "expected a function scene() that returns a Scene")
        made = names["scene"]()
    except SceneError as error:
        raise SceneError("", f"{_place(path, error)}{error}") from error
    except (Exception, SystemExit) as error:
        problem = f"it fails with {type(error).__name__}: {str(error).partition(chr(10))[0]}"
        raise SceneError("", f"{_place(path, error)}{problem}") from error
    if not isinstance(made, Scene):
        raise SceneError("scene", f"expected scene() to return a Scene, got {made!r}")
    return made
