"""Scenes in TOML, read and written."""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.scene.description import Collider, Jello, Scene
from taichi_jello.scene.validation import Checked, SceneError, cut, shown
from taichi_jello.scenefiles._lines import deepest_line, longest_number_line
from taichi_jello.scenefiles._lines import line_of as line_of
from taichi_jello.scenefiles._table import CHOICES, kinds, scene_from

SUFFIX = ".toml"
LEVEL_GROUND = [{"type": "plane"}]  # of a file without `collider`
WIDTH = 110  # columns of an array on one line


def load(path: Path) -> Scene:
    try:
        text = path.read_text(encoding="utf-8-sig")  # Windows' Notepad adds a byte order mark
    except UnicodeDecodeError as error:
        raise SceneError("", f"expected text in UTF-8: {error.reason} at byte {error.start}") from None
    try:
        return scene_from({"collider": LEVEL_GROUND} | tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise SceneError("", f"not valid TOML: {cut(str(error), 200)}") from None
    except RecursionError:
        raise SceneError("", f"line {deepest_line(text)}: expected values that are not nested so deeply") from None
    except SceneError:
        raise
    except ValueError:  # of an integer
        raise SceneError("", f"line {longest_number_line(text)}: expected numbers of fewer digits") from None


def dump(scene: Scene) -> str:
    """The scene as TOML that `load` reads back unchanged, without default values, but with `collider = []` for none.

    Raises SceneError, naming the key, for functions and for classes without a name in files."""
    table = {"collider": []} | _table("", scene)
    for force, values in zip(scene.force, table.pop("force", []), strict=True):
        table.setdefault(force.key, []).append(values)
    for key in {force.key for force in scene.force}:
        table[key] = table[key][0] if len(table[key]) == 1 else table[key]
    for name in ("collider", "jello"):  # last
        if name in table:
            table[name] = table.pop(name)
    return "\n".join(_lines(table, "")) + "\n"


def save(scene: Scene, path: Path) -> None:
    """Write the scene as TOML. Raises SceneError as `dump` does, OSError if the file cannot be written."""
    path.write_text(dump(scene), encoding="utf-8")


def _table(key: str, part: Any) -> dict[str, Any]:
    """The fields of a description that differ from their defaults, as TOML values."""
    table: dict[str, Any] = {}
    for base in (Collider, Jello):
        if isinstance(part, base):
            choice, known = CHOICES[base], kinds(base)
            table[choice] = getattr(part, choice, "")
            if known.get(table[choice]) is not type(part):
                raise SceneError(key, f"expected one of {', '.join(known)} to write, got a {type(part).__name__}")
    for each in fields(part):
        value = getattr(part, each.name)
        default = each.default_factory() if each.default_factory is not MISSING else each.default
        if not _same(value, default):
            table[each.name] = _value(f"{key}.{each.name}".lstrip("."), value)
    return table


def _same(a: Any, b: Any) -> bool:
    return type(a) is type(b) and (np.array_equal(a, b) if isinstance(a, np.ndarray) else bool(a == b))


def _value(key: str, value: Any) -> Any:
    if isinstance(value, Checked):
        return _table(key, value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: _value(f"{key}.{name}", one) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_value(f"{key}.{index}", one) for index, one in enumerate(value)]
    if isinstance(value, (bool, int, float, str)):
        return value
    raise SceneError(key, f"expected what TOML can hold, got {shown(value)}")


def _lines(table: dict[str, Any], path: str) -> list[str]:
    """A table's own keys, then its tables and arrays of tables, each with its header."""
    lines, below = [], []
    for name, value in table.items():
        full = f"{path}.{name}" if path else name
        if isinstance(value, dict) and not path:
            below += [f"[{full}]", *_lines(value, full)]
        elif isinstance(value, list) and value and all(isinstance(row, dict) for row in value):
            for row in value:
                below += [f"[[{full}]]", *_lines(row, full)]
        else:
            lines.append(f"{name} = {_text(value)}")
    return lines + below


def _text(value: Any) -> str:
    """One value; arrays too wide for a line get one line per element."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name} = {_text(one)}" for name, one in value.items()) + "}"
    if isinstance(value, list):
        parts = [_text(one) for one in value]
        flat = f"[{', '.join(parts)}]"
        return flat if len(flat) <= WIDTH else "[\n" + "".join(f"{part},\n" for part in parts) + "]"
    return repr(value)
