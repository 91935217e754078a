"""Nested tables, as scene files hold them, to a Scene; every mistake named by its key."""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, replace
from functools import cache
from typing import Any

from taichi_jello import shapes
from taichi_jello.physics import colliders, forces
from taichi_jello.scene.description import Camera, Collider, Contact, Force, Jello, Scene, Solver, override
from taichi_jello.scene.validation import SceneError, word
from taichi_jello.support.plugins import classes


@cache
def kinds(base: type, name: str) -> dict[str, type]:
    """The subclasses of Jello, Collider or Force that there are, by their class attribute `name`."""
    folder = {Jello: shapes, Collider: colliders, Force: forces}[base]
    return {getattr(found, name): found for found in classes(folder, base)}


def make(kind: Any, table: Any, key: str) -> Any:
    """An instance of the dataclass `kind` from a table of its fields."""
    if not isinstance(table, Mapping):
        raise SceneError(key, f"expected a table, got {table!r}")
    names = [each.name for each in fields(kind)]
    for name in table:
        if name not in names:
            raise SceneError(f"{key}.{name}" if key else name, f"unknown key, expected one of {', '.join(names)}")
    needed = [each.name for each in fields(kind) if each.default is MISSING and each.default_factory is MISSING]
    missing = [name for name in needed if name not in table]
    if missing:
        raise SceneError(key, f"expected {' and '.join(missing)} too, which is missing")
    try:
        kind.one_of_both(table)
    except SceneError as error:
        raise error.within(key) from None
    for name, part in kind.parts.items():
        if name in table:
            below = f"{key}.{name}" if key else name
            table = {**table, name: [make(part, row, f"{below}.{i}") for i, row in enumerate(rows(table, name, key))]}
    try:
        return kind(**table)
    except SceneError as error:
        raise error.within(key) if key else error from None
    except TypeError as error:
        raise SceneError(key, f"expected values of other kinds: {error}") from None


def make_chosen(base: type, choice: str, table: Any, key: str) -> Any:
    """Like `make`, for the subclass of `base` that the table's key `choice` names."""
    if not isinstance(table, Mapping):
        raise SceneError(key, f"expected a table, got {table!r}")
    found = kinds(base, choice)
    if choice not in table:
        raise SceneError(f"{key}.{choice}", f"expected one of {', '.join(found)}, it is missing")
    try:
        chosen = found[word(choice, table[choice], tuple(found))]
    except SceneError as error:
        raise error.within(key) from None
    return make(chosen, {name: value for name, value in table.items() if name != choice}, key)


def rows(table: Mapping[str, Any], name: str, key: str) -> list[Any]:
    """The array of tables `name`, empty if there is none."""
    value = table.get(name, [])
    if not isinstance(value, list):
        raise SceneError(f"{key}.{name}" if key else name, f"expected an array of tables [[{name}]], got {value!r}")
    return value


def check_known(name: str) -> None:
    """Raise SceneError unless a scene file may have `name` at its top."""
    known = [each.name for each in fields(Scene) if each.name != "force"] + list(kinds(Force, "key"))
    if name not in known:
        raise SceneError(name, f"unknown key, expected one of {', '.join(known)}")


def made_rows(scene: Scene, path: Sequence[str], value: Any) -> Any:
    """What an array of tables at `path` describes, such as a jello's keyframes; any other value as it is."""
    if not isinstance(value, list):
        return value
    owner: Any = scene
    for head in path[:-1]:
        index = isinstance(owner, tuple) and head.isdigit() and int(head) < len(owner)
        owner = owner[int(head)] if index else getattr(owner, head, None)
    chosen = {"collider": (Collider, "type"), "jello": (Jello, "shape")}.get(".".join(path))
    if chosen:
        return [make_chosen(*chosen, row, f"{path[0]}.{index}") for index, row in enumerate(value)]
    kind = getattr(owner, "parts", {}).get(path[-1])
    return value if kind is None else [make(kind, row, f"{'.'.join(path)}.{i}") for i, row in enumerate(value)]


def changed(scene: Scene, path: Sequence[str], value: Any) -> Scene:
    """`override` by the names that files have: `uniform_field.force` is that of the scene's one uniform field, which is
    made if there is none, and `uniform_field.1.force` that of its second."""
    name, *rest = path
    kind = kinds(Force, "key").get(name)
    if kind is None:
        if name != "force":
            check_known(name)
        return override(scene, path, made_rows(scene, path, value))
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
    """The Scene that a file's top-level table describes; raises SceneError with the key of the first mistake."""
    parts, forces = dict(table), kinds(Force, "key")
    for name in parts:
        check_known(name)
    for name, kind in (("solver", Solver), ("contact", Contact), ("camera", Camera)):
        if name in parts:
            parts[name] = make(kind, parts[name], name)
    parts["collider"] = [
        make_chosen(Collider, "type", one, f"collider.{i}") for i, one in enumerate(rows(table, "collider", ""))
    ]
    parts["jello"] = [make_chosen(Jello, "shape", one, f"jello.{i}") for i, one in enumerate(rows(table, "jello", ""))]
    parts["force"] = []
    for name in [name for name in table if name in forces]:
        tables = parts.pop(name)
        for i, one in enumerate(tables if isinstance(tables, list) else [tables]):
            key = f"{name}.{i}" if isinstance(tables, list) else name
            parts["force"].append(make(forces[name], one, key))
    return make(Scene, parts, "")
