"""One value of a description replaced by its key, as `--set` and the window ask."""

import dataclasses
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from taichi_jello.scene.validation import FAMILIES, SceneError


def override(part: Any, path: Sequence[str], value: Any, key: str = "") -> Any:
    """A copy of `part` with the value at `path` ("jello", "0", "stiffness") replaced and everything checked again. The
    other field of a pair in `either` goes back to its default."""
    head, *rest = path
    key = f"{key}.{head}" if key else head
    if dataclasses.is_dataclass(part) and not isinstance(part, type):
        names = [f.name for f in fields(part)]
        if head not in names:
            raise SceneError(key, f"unknown key, expected one of {', '.join(names)}")
        now = getattr(part, head)
        if rest and head == "position" and now is None:
            now = (0.0, 0.0, 0.0)
        new = override(now, rest, value, key) if rest else value
        pairs = [pair for pair in getattr(part, "either", ()) if head in pair]
        defaults = {name: getattr(type(part), name) for pair in pairs for name in pair}
        try:
            return dataclasses.replace(part, **(defaults | {head: new}))
        except SceneError as error:
            raise error.within(key.rpartition(".")[0]) from None
    if isinstance(part, tuple):
        if not head.isdigit() or int(head) >= len(part):
            problem = f"expected an index from 0 to {len(part) - 1}" if part else "the scene has none of these"
            raise SceneError(key, problem)
        new = override(part[int(head)], rest, value, key) if rest else value
        return (*part[: int(head)], new, *part[int(head) + 1 :])
    if isinstance(part, float) and head in FAMILIES:  # one number for all families
        part = dict.fromkeys(FAMILIES, part)
    if isinstance(part, dict) and not rest:
        return part | {head: value}
    raise SceneError(key, "unknown key")
