"""Scenes written in TOML."""

import tomllib
from pathlib import Path

from taichi_jello.scene import Scene, SceneError
from taichi_jello.sceneio._table import scene_from

SUFFIX = ".toml"


def load(path: Path) -> Scene:
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise SceneError("", f"not valid TOML: {error}") from None
    except UnicodeDecodeError as error:
        raise SceneError("", f"expected text in UTF-8: {error}") from None
    return scene_from(table)
