"""All keys of scene files as Markdown, from the dataclasses: `python -m taichi_jello.scenefiles._guide` prints them."""

import re
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields
from typing import Any

from taichi_jello.scene.description import Camera, Collider, Contact, Force, Jello, Pin, Scene, Solver
from taichi_jello.scene.keyframes import GravityKeyframe, Keyframe, Move
from taichi_jello.scene.region import Region
from taichi_jello.scenefiles._table import kinds


def tables() -> Iterator[tuple[str, type, type]]:
    """The heading of each table, its class, and the class whose keys are told elsewhere."""
    yield "the scene itself", Scene, object
    for name, table in (("solver", Solver), ("contact", Contact), ("camera", Camera)):
        yield f"[{name}]", table, object
    yield "[[keyframe]]", GravityKeyframe, object
    for name, base, choice in (("jello", Jello, "shape"), ("collider", Collider, "type")):
        yield f"[[{name}]], whatever its `{choice}`", base, object
        for word, kind in kinds(base, choice).items():
            yield f'[[{name}]] with {choice} = "{word}"', kind, base
    for name, part in (("pin", Pin), ("region", Region), ("keyframe", Keyframe)):
        yield f"[[jello.{name}]]", part, object
    yield "[[jello.pin.keyframe]] and [[collider.keyframe]]", Move, object
    for word, kind in kinds(Force, "key").items():
        yield f"[{word}]", kind, Force


def default(key: Field[Any], kind: type) -> str:
    """What a key is where it is not given."""
    value = getattr(kind, key.name, None) if key.default is MISSING else key.default
    if key.default is MISSING and key.default_factory is MISSING:
        return "needed"
    if key.default is MISSING:
        return "see below"
    if value in ((), None):
        return "none"
    if isinstance(value, tuple):
        return f"`{list(value)}`".replace("'", '"')
    if isinstance(value, float):
        return f"`{value:.6g}`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{str(value).lower()}`"


def text() -> str:
    parts = []
    for heading, kind, told in tables():
        known = {key.name for key in fields(told)} if told is not object else set()
        keys = [key for key in fields(kind) if key.name not in known]
        words = re.sub(r"\s+", " ", (kind.__doc__ or "").strip())
        rows = [f"| `{key.name}` | {default(key, kind)} |" for key in keys]
        table = ["", "| key | default |", "|---|---|", *rows] if rows else []
        parts.append("\n".join([f"**{heading}**. {words}", *table, ""]))
    return "\n".join(parts)


if __name__ == "__main__":
    print(text())
