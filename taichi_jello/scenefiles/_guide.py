"""All keys of scene files as Markdown, from the dataclasses: `python -m taichi_jello.scenefiles._guide` prints them."""

import re
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields
from typing import Any

from taichi_jello.scene.description import Collider, Contact, Force, Jello, Pin, Scene, Solver
from taichi_jello.scene.keyframes import CameraKeyframe, GravityKeyframe, Keyframe, Move
from taichi_jello.scene.look import Background, Camera, Ground
from taichi_jello.scene.region import Region
from taichi_jello.scenefiles._table import CHOICES, kinds


def tables() -> Iterator[tuple[str, Any, Any]]:
    """The heading of each table, its class, and a base class whose keys have a table of their own."""
    yield "the scene itself", Scene, None
    for table in (Solver, Contact, Camera, Ground, Background):
        yield f"[{table.__name__.lower()}]", table, None
    yield "[[camera.keyframe]]", CameraKeyframe, None
    yield "[[keyframe]]", GravityKeyframe, None
    for name, base in (("jello", Jello), ("collider", Collider)):
        yield f"[[{name}]], whatever its `{CHOICES[base]}`", base, None
        for word, kind in kinds(base).items():
            yield f'[[{name}]] with {CHOICES[base]} = "{word}"', kind, base
    for name, part in (("pin", Pin), ("region", Region), ("keyframe", Keyframe)):
        yield f"[[jello.{name}]]", part, None
    yield "[[jello.pin.keyframe]] and [[collider.keyframe]]", Move, None
    for word, kind in kinds(Force).items():
        yield f"[{word}]", kind, Force


def default(key: Field[Any]) -> str:
    """The default of a key, in words."""
    if "guide" in key.metadata:
        return str(key.metadata["guide"])
    if key.default is MISSING:
        return "required" if key.default_factory is MISSING else "see below"
    if key.default in ((), None):
        return "none"
    if isinstance(key.default, tuple):
        return f"`{list(key.default)}`".replace("'", '"')
    if isinstance(key.default, float):
        return f"`{key.default:.6g}`"
    return f'`"{key.default}"`' if isinstance(key.default, str) else f"`{str(key.default).lower()}`"


def text() -> str:
    parts = []
    for heading, kind, base in tables():
        elsewhere = {key.name for key in fields(base)} if base else set()
        rows = [f"| `{key.name}` | {default(key)} |" for key in fields(kind) if key.name not in elsewhere]
        table = ["", "| key | default |", "|---|---|", *rows] if rows else []
        words = re.sub(r"\s+", " ", (kind.__doc__ or "").strip())
        parts.append("\n".join([f"**{heading}**. {words}", *table, ""]))
    return "\n".join(parts)


if __name__ == "__main__":
    print(text())
