"""Checks of the values in a description. Every error names its key and what was expected."""

from collections.abc import Container, Sequence
from contextlib import suppress
from typing import Any, ClassVar

import numpy as np

FAMILIES = ("structural", "shear", "bend")
LARGEST, SMALLEST = 1e12, 1e-12  # SI units; float32 can hold products of numbers between these
FASTEST = 1e7  # m/s along an axis
Vector = tuple[float, float, float]


MAX_SHOWN, MAX_KEY = 60, 200  # characters of a value and of a key in a message


def printable(text: str) -> str:
    """The text with control characters and line breaks as escapes: it stays on a line and commands no terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def cut(text: str, most: int = MAX_SHOWN) -> str:
    """The text, printable, and cut after `most` characters."""
    text = printable(text[: most + 1])
    return text if len(text) <= most else f"{text[:most]}…"


def shown(value: Any) -> str:
    """A value of any kind in a message: its repr, on one line and cut if it is long."""
    try:
        return cut(repr(value))
    except Exception:  # of a class in a scene file, of an integer of more than 4300 digits
        return f"a value of type {type(value).__name__}"


class SceneError(ValueError):
    """An invalid scene: `key` says where, `problem` what was expected and what was found."""

    def __init__(self, key: str, problem: str):
        super().__init__((f"{cut(key, MAX_KEY)}: " if key else "") + printable(problem))
        self.key, self.problem = key, problem

    def within(self, prefix: str) -> "SceneError":
        """The same error with its key prefixed by the table that holds it."""
        return SceneError(".".join(filter(None, (prefix, self.key))), self.problem)


def number(key: str, value: Any, *, low: float = -np.inf, above: float = -np.inf, most: float = LARGEST) -> float:
    """`value` as a finite float, at least `low`, greater than `above` and of magnitude at most `most`."""
    expected = "expected a finite number"
    if above > -np.inf:
        expected += f" greater than {above:g}"
    elif low > -np.inf:
        expected += f" of at least {low:g}"
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        raise SceneError(key, f"{expected}, got {shown(value)}")
    with suppress(OverflowError):  # a huge integer stays one
        value = float(value)
    got = f"got {value:g}" if isinstance(value, float) else f"got one of {value.bit_length()} bits"
    if value != value or abs(value) == np.inf or value < low or value <= above:
        raise SceneError(key, f"{expected}, {got}")
    if abs(value) > most:
        raise SceneError(key, f"{expected}, at most {most:g}{' either way' * (low < 0.0 > above)}, {got}")
    if above == 0.0 and value < SMALLEST:
        raise SceneError(key, f"{expected}, at least {SMALLEST:g}, {got}")
    return float(value)


def field_of_view(value: Any) -> float:
    """An angle between 0 and 180 degrees, in the key `fov`."""
    fov = number("fov", value, above=0.0)
    if fov >= 180.0:
        raise SceneError("fov", f"expected less than 180 degrees, got {fov:g}")
    return fov


def number_or_auto(key: str, value: Any, unit: str = "a number", **limits: float) -> float | str:
    """A number, checked as in `number`, or the word "auto"."""
    if not isinstance(value, str):
        return number(key, value, **limits)
    if value != "auto":
        raise SceneError(key, f'expected "auto" or {unit}, got {shown(value)}')
    return value


def whole(key: str, value: Any, *, low: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < low:
        raise SceneError(key, f"expected a whole number of at least {low}, got {shown(value)}")
    return int(value)


def vector(key: str, value: Any, **limits: float) -> Vector:
    if isinstance(value, str) or not isinstance(value, (Sequence, np.ndarray)) or len(value) != 3:
        raise SceneError(key, f"expected three numbers [x, y, z], got {shown(value)}")
    x, y, z = (number(f"{key}.{axis}", part, **limits) for axis, part in enumerate(value))
    return (x, y, z)


def vectors(key: str, value: Any, *, most: float = LARGEST) -> tuple[Vector, ...]:
    """(N, 3) finite numbers of magnitude at most `most`, as tuples."""
    try:
        array = np.array(value, float)
    except (ValueError, TypeError, OverflowError):
        raise SceneError(key, "expected a list of [x, y, z]") from None
    if array.ndim != 2 or array.shape[1] != 3:
        raise SceneError(key, f"expected a list of [x, y, z], got an array of shape {array.shape}")
    if not np.isfinite(array).all():
        raise SceneError(key, "expected finite numbers")
    if array.size and np.abs(array).max() > most:
        raise SceneError(key, f"expected numbers of at most {most:g} either way, got {np.abs(array).max():g}")
    return tuple((x, y, z) for x, y, z in array.tolist())


def box(low: Any, high: Any) -> dict[str, Vector]:
    """The checked corners `min` and `max` of a box that may be flat."""
    low, high = vector("min", low), vector("max", high)
    if any(a > b for a, b in zip(low, high, strict=True)):
        raise SceneError("max", f"expected at least min {list(low)} on every axis, got {list(high)}")
    return {"min": low, "max": high}


def word(key: str, value: Any, allowed: Sequence[str] | None = None) -> str:
    if not isinstance(value, str):
        raise SceneError(key, f"expected text, got {shown(value)}")
    if allowed is not None and value not in allowed:
        raise SceneError(key, f"expected one of {', '.join(allowed)}, got {shown(value)}")
    return value


def truth(key: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise SceneError(key, f"expected true or false, got {shown(value)}")
    return value


def by_family(key: str, value: Any) -> float | dict[str, float]:
    """One number for all springs, or a table of numbers by family."""
    if not isinstance(value, dict):
        return number(key, value, low=0.0)
    return {word(key, family, FAMILIES): number(f"{key}.{family}", one, low=0.0) for family, one in value.items()}


def listed(key: str, rows: Any, kind: type) -> tuple[Any, ...]:
    """A list of descriptions of one kind, as a tuple."""
    if isinstance(rows, (str, dict)) or not isinstance(rows, Sequence):
        raise SceneError(key, f"expected a list of {kind.__name__}, got {shown(rows)}")
    for index, row in enumerate(rows):
        if not isinstance(row, kind):
            raise SceneError(f"{key}.{index}", f"expected a {kind.__name__}, got {shown(row)}")
    return tuple(rows)


class Checked:
    """A frozen dataclass whose `check` returns the normalised values of its fields by name.

    `parts`: the class of the descriptions in each field that is a list of them. `either`: pairs of fields that
    exclude each other.
    """

    parts: ClassVar[dict[str, type["Checked"]]] = {}
    either: ClassVar[tuple[tuple[str, str], ...]] = ()

    def check(self) -> dict[str, Any]:
        raise TypeError(f"{type(self).__name__} must define check()")

    @classmethod
    def check_rows(cls, key: str, rows: Sequence[Any]) -> None:
        """Raise SceneError, below `key`, for a list of this kind whose rows contradict each other."""

    @classmethod
    def check_pairs(cls, given: Container[str]) -> None:
        """Raise SceneError if both fields of a pair in `either` are given."""
        for one, other in cls.either:
            if one in given and other in given:
                raise SceneError(one, f"expected either {one} or {other}, got both")

    def __post_init__(self) -> None:
        for name, value in self.check().items():
            object.__setattr__(self, name, value)
        names = [name for pair in self.either for name in pair]
        self.check_pairs([name for name in names if getattr(self, name) != getattr(type(self), name)])
        for name, kind in self.parts.items():
            rows = listed(name, getattr(self, name), kind)
            kind.check_rows(name, rows)
            object.__setattr__(self, name, rows)
