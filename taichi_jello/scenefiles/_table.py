"""Scenes from nested tables, as scene files hold them. Every error names its key."""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, replace
from functools import cache
from typing import Any

from taichi_jello import shapes
from taichi_jello.physics import colliders, forces
from taichi_jello.scene.description import Collider, Force, Jello, Scene
from taichi_jello.scene.override import override
from taichi_jello.scene.validation import Checked, SceneError, shown, word
from taichi_jello.support.plugins import classes

CHOICES = {Jello: "shape", Collider: "type", Force: "key"}  # the class attribute that names each subclass in files


@cache
def kinds(base: type) -> dict[str, type]:
    """The subclasses of Jello, Collider or Force by their names in files."""
    folder = {Jello: shapes, Collider: colliders, Force: forces}[base]
    return {getattr(found, CHOICES[base]): found for found in classes(folder, base)}


def make(kind: Any, table: Any, key: str) -> Any:
    """An instance of the dataclass `kind` from a table of its fields. A table for Jello or Collider also names the
    subclass."""
    if not isinstance(table, Mapping):
        raise SceneError(key, f"expected a table, got {shown(table)}")
    values = dict(table)
    if kind in (Jello, Collider):
        choice, found = CHOICES[kind], kinds(kind)
        if choice not in values:
            raise SceneError(f"{key}.{choice}", f"expected one of {', '.join(found)}, it is missing")
        kind = found[word(f"{key}.{choice}", values.pop(choice), tuple(found))]
    known = {each.name: each for each in fields(kind)}
    for name in values:
        if name not in known:
            raise SceneError(_below(key, name), f"unknown key, expected one of {', '.join(known)}")
    required = [n for n, each in known.items() if each.default is MISSING and each.default_factory is MISSING]
    missing = [name for name in required if name not in values]
    if missing:
        raise SceneError(key, f"expected {' and '.join(missing)} too, which is missing")
    for name, value in values.items():
        part = known[name].default_factory
        if name in kind.parts:
            values[name] = make_rows(kind.parts[name], value, _below(key, name))
        elif isinstance(part, type) and issubclass(part, Checked):
            values[name] = make(part, value, _below(key, name))
    try:
        kind.check_pairs(values)
        return kind(**values)
    except SceneError as error:
        raise error.within(key) from None
    except TypeError as error:
        raise SceneError(key, f"expected values of other kinds: {error}") from None


def make_rows(kind: Any, rows: Any, key: str) -> list[Any]:
    """Instances of `kind` from an array of tables."""
    if not isinstance(rows, list):
        raise SceneError(key, f"expected an array of tables [[{key.rpartition('.')[2]}]], got {shown(rows)}")
    return [make(kind, row, f"{key}.{index}") for index, row in enumerate(rows)]


def _below(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def check_known(name: str) -> None:
    """Raise SceneError for an unknown top-level key."""
    known = [each.name for each in fields(Scene) if each.name != "force"] + list(kinds(Force))
    if name not in known:
        raise SceneError(name, f"unknown key, expected one of {', '.join(known)}")


def changed(scene: Scene, path: Sequence[str], value: Any) -> Scene:
    """`override` with the key paths of files: `uniform_field.force` belongs to the scene's first uniform field, added
    if there is none, `uniform_field.1.force` to its second. A list of tables becomes a list of descriptions."""
    name, *rest = path
    kind = kinds(Force).get(name)
    if kind is None:
        if name != "force":
            check_known(name)
        owner: Any = scene
        for head in path[:-1]:
            index = isinstance(owner, tuple) and head.isdigit() and int(head) < len(owner)
            owner = owner[int(head)] if index else getattr(owner, head, None)
        part = getattr(owner, "parts", {}).get(path[-1])
        rows = make_rows(part, value, ".".join(path)) if part and isinstance(value, list) else value
        return override(scene, path, rows)
    own = [index for index, force in enumerate(scene.force) if isinstance(force, kind)]
    if not rest or not own:
        table = {rest[0]: value} if len(rest) == 1 else value
        kept = [force for force in scene.force if not isinstance(force, kind)]
        return replace(scene, force=[*kept, make(kind, table, name)])
    rest = rest if rest[0].isdigit() else ["0", *rest]
    same = override(tuple(scene.force[index] for index in own), rest, value, name)
    new = dict(zip(own, same, strict=True))
    return replace(scene, force=[new.get(index, force) for index, force in enumerate(scene.force)])


def scene_from(table: Mapping[str, Any]) -> Scene:
    """The Scene that a file's top-level table describes. Raises SceneError with the key of the first error."""
    for name in table:
        check_known(name)
    values, made = dict(table), []
    for name in table:
        if name in kinds(Force):
            rows = values.pop(name)
            kind = kinds(Force)[name]
            made += make_rows(kind, rows, name) if isinstance(rows, list) else [make(kind, rows, name)]
    return replace(make(Scene, values, ""), force=made)
