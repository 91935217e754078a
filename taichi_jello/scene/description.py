"""What a person asks for: frozen descriptions in SI units, y up, checked when they are made.

Nothing here knows Taichi. A wrong value raises `SceneError`, which names the key and what was expected.
The names are those of the TOML format, so that one description serves Python, files and `--set`.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.keyframes import GravityKeyframe, Keyframe, Move, offset
from taichi_jello.scene.region import Region
from taichi_jello.scene.validation import (
    FAMILIES,
    FASTEST,
    LARGEST,
    Checked,
    SceneError,
    Vector,
    by_family,
    listed,
    number,
    number_or_auto,
    truth,
    vector,
    vectors,
    word,
)
from taichi_jello.scene.validation import whole as whole

SHOWS = ("skin and springs", "all springs", "skin", "particles")
COLORS = ("force", "strain", "stiffness", "family", "plain")


@dataclass(frozen=True, kw_only=True)
class Solver(Checked):
    """How time is cut: `method` by name, `dt` [s] or "auto", one drawn frame every `frame_dt` [s]."""

    method: str = "auto"
    dt: float | str = "auto"
    frame_dt: float = 1.0 / 60.0

    def check(self) -> dict[str, Any]:
        return {
            "method": word("method", self.method),
            "dt": number_or_auto("dt", self.dt, "seconds", above=0.0),
            "frame_dt": number("frame_dt", self.frame_dt, above=0.0),
        }


@dataclass(frozen=True, kw_only=True)
class Contact(Checked):
    """The penalty spring [N/m], dashpot [N·s/m] and Coulomb coefficient of every touching point; "auto": from each
    jello's own springs, see contact_law.py. `touch`: whether jellos feel each other."""

    stiffness: float | str = "auto"
    damping: float | str = "auto"
    friction: float = 0.3
    touch: bool = True

    def check(self) -> dict[str, Any]:
        checked: dict[str, Any] = {"friction": number("friction", self.friction, low=0.0)}
        for name in ("stiffness", "damping"):
            checked[name] = number_or_auto(name, getattr(self, name), low=0.0)
        return checked | {"touch": truth("touch", self.touch)}


@dataclass(frozen=True, kw_only=True)
class Camera(Checked):
    """Where a picture is taken from: the eye, the point looked at [m] and the vertical field of view [degrees] of a
    picture of 16:9, as wide as which narrower ones see; and what is shown of jellos, and by the springs' colour."""

    eye: Vector = (2.6, 1.9, 3.6)
    target: Vector = (0.0, 0.6, 0.0)
    fov: float = 40.0
    color: str = "force"
    show: str = SHOWS[0]

    def check(self) -> dict[str, Any]:
        checked = {"eye": vector("eye", self.eye), "target": vector("target", self.target)}
        if checked["eye"] == checked["target"]:
            raise SceneError("eye", "expected a point away from the target")
        fov = number("fov", self.fov, above=0.0)
        if fov >= 180.0:
            raise SceneError("fov", f"expected less than 180 degrees, got {fov:g}")
        words = {"color": word("color", self.color, COLORS), "show": word("show", self.show, SHOWS)}
        return checked | {"fov": fov} | words


@dataclass(frozen=True, kw_only=True)
class Collider(Checked):
    """A rigid obstacle. A subclass in `physics/colliders` names its `type` and says how it is touched and drawn, as if
    it had no keyframes: these move all of it."""

    type: ClassVar[str]
    parts: ClassVar[dict[str, type[Checked]]] = {"keyframe": Move}
    core_entry: ClassVar[Any] = None  # of a solid that could be passed through in one step: see continuous_collision.py
    keyframe: Sequence[Move] = ()

    @property
    def thickness(self) -> float:
        """[m] The least way through it."""
        return float("inf")

    def moved_rows(self, start: float, end: float) -> np.ndarray:
        """Its `rows` where its keyframes have moved it."""
        rows, here = self.rows(start, end).copy(), offset(self.keyframe, start)
        rows[:, :3] += here
        rows[:, 3:6] += (offset(self.keyframe, end) - here) / (end - start)
        return rows

    def place(self, time: float) -> np.ndarray:
        """Its `origin` (3,) where its keyframes have moved it."""
        return self.origin(time) + offset(self.keyframe, time)

    def rows(self, start: float, end: float) -> np.ndarray:
        """(n, 10): for each of its surfaces the origin at time `start` [m], the velocity that carries it to its
        place at time `end` [m/s], and four numbers for `signed_distance`."""
        raise TypeError(f"{type(self).__name__} must define rows()")

    def mesh(self, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) [m] relative to its origin and triangles (T, 3) to draw; `reach` [m] bounds endless ones."""
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)

    def edges(self, reach: float) -> np.ndarray:
        """Line segments (E, 2, 3) [m] relative to its origin to draw."""
        return np.zeros((0, 2, 3))

    def origin(self, time: float) -> np.ndarray:
        """(3,) what `mesh` and `edges` are relative to at `time` [s]."""
        return np.zeros(3)

    def floor(self) -> float | None:
        """The height [m] of a level floor that shadows fall on, if it has one."""
        return None


@dataclass(frozen=True, kw_only=True)
class Force(Checked):
    """An external force of its own table in the scene. A subclass in `physics/forces` names its `key`."""

    key: ClassVar[str]


@dataclass(frozen=True, kw_only=True)
class Pin(Checked):
    """Points held: those whose rest position, 0 to 1 along each axis of the shape, lies in the box; still or, as a
    handle, moved along its keyframes, straight within a frame."""

    min: Vector = (0.0, 0.0, 0.0)
    max: Vector = (1.0, 1.0, 1.0)
    keyframe: Sequence[Move] = ()
    parts: ClassVar[dict[str, type[Checked]]] = {"keyframe": Move}

    def check(self) -> dict[str, Any]:
        low, high = vector("min", self.min), vector("max", self.max)
        if any(a > b for a, b in zip(low, high, strict=True)):
            raise SceneError("max", f"expected at least min {list(low)} on every axis, got {list(high)}")
        return {"min": low, "max": high}

    def holds(self, where: np.ndarray) -> np.ndarray:
        """(n,) whether it holds points at the places (n, 3)."""
        return np.all((where >= np.array(self.min) - 1e-9) & (where <= np.array(self.max) + 1e-9), axis=1)


@dataclass(frozen=True, kw_only=True)
class Jello(Checked):
    """One soft body. A subclass in `shapes` names its `shape` and builds the points and springs.

    position [m] of its centre, rotation [degrees about x, then y, then z], velocity [m/s], spin [rad/s],
    mass [kg] of the whole, stiffness [N/m] and damping [N·s/m] of each spring or a table by family. In their places a
    solid may have a Young's modulus young [Pa], a density [kg/m³] and a damping_ratio: see material.py. Both
    of a pair are refused (in Python only if what is replaced differs from its default).
    creep [1/s]: the rate at which its springs' rest lengths follow their lengths; yield_strain: the strain beyond which
    the rest lengths follow at once; tear_strain: that at which a spring breaks, of the length it was made or frozen
    with; 0: never.
    x [m], v [m/s]: (N, 3) where each point starts and how fast, instead of all that.
    """

    shape: ClassVar[str]
    position: Vector = (0.0, 0.0, 0.0)
    rotation: Vector = (0.0, 0.0, 0.0)
    velocity: Vector = (0.0, 0.0, 0.0)
    spin: Vector = (0.0, 0.0, 0.0)
    mass: float = 1.0
    springs: Sequence[str] = FAMILIES
    stiffness: Any = 200.0
    damping: Any = 0.25
    young: float | None = None
    density: float | None = None
    damping_ratio: float | None = None
    creep: float = 0.0
    yield_strain: float = 0.0
    tear_strain: float = 0.0
    pin: Sequence[Pin] = ()
    self_contact: bool = False
    x: Any = None
    v: Any = None
    region: Sequence[Region] = ()
    keyframe: Sequence[Keyframe] = ()
    parts: ClassVar[dict[str, type[Checked]]] = {"pin": Pin, "region": Region, "keyframe": Keyframe}
    either: ClassVar[tuple[tuple[str, str], ...]] = (
        ("young", "stiffness"),
        ("density", "mass"),
        ("damping_ratio", "damping"),
    )

    def check(self) -> dict[str, Any]:
        if isinstance(self.springs, str) or not isinstance(self.springs, Sequence):
            raise SceneError("springs", f"expected a list of {', '.join(FAMILIES)}, got {self.springs!r}")
        checked: dict[str, Any] = {
            "mass": number("mass", self.mass, above=0.0),
            "springs": tuple(word("springs", family, FAMILIES) for family in self.springs),
            "stiffness": by_family("stiffness", self.stiffness),
            "damping": by_family("damping", self.damping),
            "self_contact": truth("self_contact", self.self_contact),
        }
        for name, most in (("position", LARGEST), ("rotation", LARGEST), ("velocity", FASTEST), ("spin", LARGEST)):
            checked[name] = vector(name, getattr(self, name), most=most)
        for name in ("creep", "yield_strain", "tear_strain"):
            checked[name] = number(name, getattr(self, name), low=0.0)
        if self.damping_ratio is not None:
            checked["damping_ratio"] = number("damping_ratio", self.damping_ratio, low=0.0)
        for name in ("young", "density"):
            if getattr(self, name) is not None:
                checked[name] = number(name, getattr(self, name), above=0.0)
        for name, most in (("x", LARGEST), ("v", FASTEST)):
            if getattr(self, name) is not None:
                checked[name] = vectors(name, getattr(self, name), most=most)
        return checked

    def body(self) -> Body:
        """Its points, springs and skin."""
        raise TypeError(f"{type(self).__name__} must define body()")

    def beside(self, folder: Path) -> "Jello":
        """The same jello with the files that it names looked for in `folder`."""
        return self

    def seen_from(self, folder: Path) -> "Jello":
        """The same jello with the files that it names as a scene file in `folder` is to name them."""
        return self

    @property
    def changes(self) -> bool:
        """Whether its springs change with time."""
        return bool(self.keyframe) or self.takes_its_own_shape

    @property
    def takes_its_own_shape(self) -> bool:
        """Whether its springs change one by one."""
        lasting = self.creep > 0.0 or self.yield_strain > 0.0 or self.tear_strain > 0.0
        return lasting or any(row.freeze for row in self.keyframe)

    def coefficient(self, name: str, family: str) -> float:
        """`stiffness` or `damping` of one family; a family missing from a table has none."""
        value = getattr(self, name)
        return value.get(family, 0.0) if isinstance(value, dict) else value


@dataclass(frozen=True, kw_only=True)
class Scene(Checked):
    """A whole world: gravity [m/s²], drag [1/s], headless length `seconds`, jellos, colliders and external forces.
    Keyframes of its own, if it has any, say what gravity is."""

    title: str = ""
    gravity: Vector = (0.0, -9.81, 0.0)
    drag: float = 0.0
    seconds: float = 4.0
    solver: Solver = field(default_factory=Solver)
    contact: Contact = field(default_factory=Contact)
    camera: Camera = field(default_factory=Camera)
    collider: Sequence[Collider] = ()
    jello: Sequence[Jello] = ()
    force: Sequence[Force] = ()
    keyframe: Sequence[GravityKeyframe] = ()
    parts: ClassVar[dict[str, type[Checked]]] = {"keyframe": GravityKeyframe}

    def check(self) -> dict[str, Any]:
        kinds: dict[str, type] = {"collider": Collider, "jello": Jello, "force": Force}
        lists = {name: listed(name, getattr(self, name), kind) for name, kind in kinds.items()}
        if not self.jello:
            raise SceneError("jello", "expected at least one jello, the scene is empty")
        for name, table in (("solver", Solver), ("contact", Contact), ("camera", Camera)):
            if not isinstance(getattr(self, name), table):
                raise SceneError(name, f"expected a {table.__name__}, got {getattr(self, name)!r}")
        return lists | {
            "title": word("title", self.title),
            "gravity": vector("gravity", self.gravity),
            "drag": number("drag", self.drag, low=0.0),
            "seconds": number("seconds", self.seconds, low=0.0),
        }


def override(part: Any, path: Sequence[str], value: Any, key: str = "") -> Any:
    """A copy of `part` with the value at `path` ("jello", "0", "stiffness") replaced and everything checked again. What
    said the same in another way is left out."""
    head, *rest = path
    key = f"{key}.{head}" if key else head
    if dataclasses.is_dataclass(part) and not isinstance(part, type):
        names = [f.name for f in fields(part)]
        if head not in names:
            raise SceneError(key, f"unknown key, expected one of {', '.join(names)}")
        new = override(getattr(part, head), rest, value, key) if rest else value
        try:
            pairs = [pair for pair in getattr(part, "either", ()) if head in pair]
            others = {name: getattr(type(part), name) for pair in pairs for name in pair}
            return dataclasses.replace(part, **(others | {head: new}))
        except SceneError as error:
            raise error.within(key.rpartition(".")[0]) if "." in key else error from None
    if isinstance(part, tuple):
        if not head.isdigit() or int(head) >= len(part):
            there = f"expected an index from 0 to {len(part) - 1}" if part else "the scene has none of these"
            raise SceneError(key, there)
        new = override(part[int(head)], rest, value, key) if rest else value
        return (*part[: int(head)], new, *part[int(head) + 1 :])
    if isinstance(part, dict) and not rest:
        return part | {head: value}
    if isinstance(part, float) and head in FAMILIES and not rest:  # one number for all families
        return dict.fromkeys(FAMILIES, part) | {head: value}
    raise SceneError(key, "unknown key")
