"""Scenes written in Python: a file with a function `scene()` that returns a Scene."""

import runpy
from pathlib import Path

from taichi_jello.scene import Scene, SceneError

SUFFIX = ".py"


def load(path: Path) -> Scene:
    try:
        names = runpy.run_path(str(path), run_name="taichi_jello_scene")
        if not callable(names.get("scene")):
            raise SceneError("scene", "expected a function scene() that returns a Scene")
        made = names["scene"]()
    except SceneError:
        raise
    except Exception as error:
        raise SceneError("", f"it fails with {type(error).__name__}: {error}") from error
    if not isinstance(made, Scene):
        raise SceneError("scene", f"expected scene() to return a Scene, got {made!r}")
    return made
