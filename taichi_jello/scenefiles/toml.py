"""Scenes written in TOML, read and written."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.scene.description import Collider, Jello, Scene
from taichi_jello.scene.validation import Checked, SceneError
from taichi_jello.scenefiles._lines import line_of as line_of
from taichi_jello.scenefiles._table import kinds, scene_from

SUFFIX = ".toml"
WIDE = 110  # columns that an array may take on one line


def load(path: Path) -> Scene:
    try:
        text = path.read_text(encoding="utf-8-sig")  # Windows' Notepad marks the order of bytes
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError("", f"not valid TOML: {error}") from None
    except UnicodeDecodeError as error:
        raise SceneError("", f"expected text in UTF-8: {error}") from None
    return scene_from(table)


def dump(scene: Scene) -> str:
    """The scene as TOML that `load` reads back the same; what is as by default is left out.

    Raises SceneError, naming the key, for what TOML cannot hold: functions, and classes that no file can name."""
    own = _table("", scene, without=("jello", "collider", "force"))
    for index, force in enumerate(scene.force):
        rows = own.setdefault(force.key, [])
        rows.append(_table(f"force.{index}", force))
    own |= {key: rows[0] for key, rows in own.items() if key in {f.key for f in scene.force} and len(rows) == 1}
    for name, base, choice in (("collider", Collider, "type"), ("jello", Jello, "shape")):
        parts = getattr(scene, name)
        if parts:
            own[name] = [_chosen(f"{name}.{i}", part, base, choice) for i, part in enumerate(parts)]
    return "\n".join(_lines(own, "")) + "\n"


def save(scene: Scene, path: Path) -> None:
    """Write the scene as TOML; raises SceneError as `dump` does, OSError if the file cannot be written."""
    path.write_text(dump(scene), encoding="utf-8")


def _chosen(key: str, part: Any, base: type, choice: str) -> dict[str, Any]:
    known = kinds(base, choice)
    name = getattr(part, choice, "")
    if known.get(name) is not type(part):
        raise SceneError(key, f"expected one of {', '.join(known)} to write, got a {type(part).__name__}")
    return {choice: name} | _table(key, part)


def _table(key: str, part: Any, without: Sequence[str] = ()) -> dict[str, Any]:
    """The fields of a description that are not as by default, as TOML's kinds of values."""
    table = {}
    for each in fields(part):
        value = getattr(part, each.name)
        default = each.default_factory() if each.default_factory is not MISSING else each.default
        if each.name in without or _same(value, default):
            continue
        table[each.name] = _value(f"{key}.{each.name}".lstrip("."), value)
    return table


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and np.array_equal(a, b)
    return type(a) is type(b) and bool(a == b)


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
    raise SceneError(key, f"expected what TOML can hold, got {value!r}")


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
    """One value; arrays that are too wide for a line have a line for each element."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name} = {_text(one)}" for name, one in value.items()) + "}"
    if isinstance(value, list):
        parts = [_text(one) for one in value]
        flat = f"[{', '.join(parts)}]"
        return flat if len(flat) <= WIDE else "[\n" + "".join(f"{part},\n" for part in parts) + "]"
    return repr(value)
