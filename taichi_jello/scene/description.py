"""The scene description: frozen dataclasses in SI units, y up, checked when they are made; no Taichi.

An invalid value raises `SceneError`, which names the key and what was expected. Field names are the keys of scene files
and of `--set`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.colors import Color, color_or_none
from taichi_jello.scene.keyframes import GravityKeyframe, Keyframe, Move, offset
from taichi_jello.scene.look import COLORS as COLORS
from taichi_jello.scene.look import SHOWS as SHOWS
from taichi_jello.scene.look import Background, Camera, Ground
from taichi_jello.scene.region import Pin, Region
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
    shown,
    truth,
    vector,
    vectors,
    word,
)


@dataclass(frozen=True, kw_only=True)
class Solver(Checked):
    """The integration `method` by name, its step `dt` [s] or "auto", and the time between drawn frames `frame_dt`
    [s]."""

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
    jello's own springs, see contact_law.py. `touch`: whether jellos collide with each other."""

    stiffness: float | str = "auto"
    damping: float | str = "auto"
    friction: float = 0.3
    touch: bool = True

    def check(self) -> dict[str, Any]:
        springs = {name: number_or_auto(name, getattr(self, name), low=0.0) for name in ("stiffness", "damping")}
        return {"friction": number("friction", self.friction, low=0.0), "touch": truth("touch", self.touch)} | springs


@dataclass(frozen=True, kw_only=True)
class Collider(Checked):
    """A rigid obstacle. A subclass in `physics/colliders` names its `type` and defines its geometry; the keyframes move
    it as a whole. color: of its surface; of a floor, unless the ground has one."""

    type: ClassVar[str]
    parts: ClassVar[dict[str, type[Checked]]] = {"keyframe": Move}
    core_entry: ClassVar[Any] = None  # of a solid that one step could cross: see continuous_collision.py
    color: Color | None = None
    keyframe: Sequence[Move] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "color", color_or_none("color", self.color))

    @property
    def thickness(self) -> float:
        """[m] The shortest way through it."""
        return float("inf")

    def moved_rows(self, start: float, end: float) -> np.ndarray:
        """Its `rows`, displaced by its keyframes."""
        rows, here = self.rows(start, end).copy(), offset(self.keyframe, start)
        rows[:, :3] += here
        rows[:, 3:6] += (offset(self.keyframe, end) - here) / (end - start)
        return rows

    def place(self, time: float) -> np.ndarray:
        """Its `origin` (3,), displaced by its keyframes."""
        return self.origin(time) + offset(self.keyframe, time)

    def rows(self, start: float, end: float) -> np.ndarray:
        """(n, 10), for each of its surfaces: the origin at time `start` [m], the velocity that moves it to its place
        at time `end` [m/s], and four parameters of `signed_distance`."""
        raise TypeError(f"{type(self).__name__} must define rows()")

    def mesh(self, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) [m] relative to its origin and triangles (T, 3) to draw; `reach` [m] bounds infinite ones."""
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)

    def edges(self, reach: float) -> np.ndarray:
        """Line segments (E, 2, 3) [m] relative to its origin to draw."""
        return np.zeros((0, 2, 3))

    def origin(self, time: float) -> np.ndarray:
        """(3,) [m] the origin of `mesh` and `edges` at `time` [s], without keyframes."""
        return np.zeros(3)

    def floor(self) -> float | None:
        """The height [m] of a level floor that receives shadows, if any."""
        return None

    def distance(self, points: np.ndarray) -> np.ndarray:
        """(n,) [m] signed distances of `points` (n, 3) relative to its origin, negative inside: `signed_distance` in
        NumPy."""
        return np.full(len(points), np.inf)

    def top(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """(n,) [m] the height of its upper side at (x, z), all relative to its origin; -inf where nothing can stand."""
        return np.full(len(x), -np.inf)

    def extent(self) -> np.ndarray | None:
        """(2, 3) [m] opposite corners of its bounding box, relative to its origin; None if it is infinite."""
        points = np.concatenate([self.mesh(1.0)[0], self.edges(1.0).reshape(-1, 3)])
        return np.stack([points.min(0), points.max(0)]) if len(points) else None


@dataclass(frozen=True, kw_only=True)
class Force(Checked):
    """An external force with a table of its own. A subclass in `physics/forces` names its `key`."""

    key: ClassVar[str]


@dataclass(frozen=True, kw_only=True)
class Jello(Checked):
    """One soft body. A subclass in `shapes` names its `shape` and builds the points and springs.

    position [m] of its centre: without it, just above the collider that carries it, beside others without a position,
    and at the origin if nothing carries it. rotation [degrees about x, then y, then z], velocity [m/s], spin [rad/s],
    mass [kg] of the whole, stiffness [N/m] and damping [N·s/m] of each spring or a table by family. Instead of these a
    solid may have a Young's modulus young [Pa], a density [kg/m³] and a damping_ratio: see material.py. Giving both of
    a pair is an error (in Python only if the one replaced differs from its default).
    creep [1/s]: the rate at which rest lengths relax to the springs' lengths; yield_strain: beyond it they follow at
    once; tear_strain, relative to the initial or frozen length: at it a spring breaks; 0: never.
    volume: how a solid resists a change of its volume, over Young's modulus of its springs; 0: by the springs alone, 1:
    as hard again, which also turns cells right that are inside out; 20: nearly incompressible.
    x [m], v [m/s]: (N, 3) initial positions and velocities of the points, in place of the above.
    color: of its skin; without it one of a palette, by its number in the scene.
    """

    shape: ClassVar[str]
    position: Vector | None = field(default=None, metadata={"guide": "just above what carries it"})
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
    volume: float = 0.0
    pin: Sequence[Pin] = ()
    self_contact: bool = False
    x: Any = None
    v: Any = None
    color: Color | None = None
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
            raise SceneError("springs", f"expected a list of {', '.join(FAMILIES)}, got {shown(self.springs)}")
        optional = ("position", "young", "density", "damping_ratio", "x", "v")
        absent = [name for name in optional if getattr(self, name) is None]
        checked: dict[str, Any] = {
            "springs": tuple(word("springs", family, FAMILIES) for family in self.springs),
            "self_contact": truth("self_contact", self.self_contact),
            "color": color_or_none("color", self.color),
        }
        for name in ("mass", "young", "density"):
            if name not in absent:
                checked[name] = number(name, getattr(self, name), above=0.0)
        for name in ("creep", "yield_strain", "tear_strain", "volume", "damping_ratio"):
            if name not in absent:
                checked[name] = number(name, getattr(self, name), low=0.0)
        for name in ("stiffness", "damping"):
            checked[name] = by_family(name, getattr(self, name))
        for name, most in (("position", LARGEST), ("rotation", LARGEST), ("velocity", FASTEST), ("spin", LARGEST)):
            if name not in absent:
                checked[name] = vector(name, getattr(self, name), most=most)
        for name, most in (("x", LARGEST), ("v", FASTEST)):
            if name not in absent:
                checked[name] = vectors(name, getattr(self, name), most=most)
        return checked

    def body(self) -> Body:
        """Its points, springs and skin."""
        raise SceneError("", f"expected {type(self).__name__} to define body()")

    def with_files_in(self, folder: Path) -> "Jello":
        """The same jello with the paths of its files relative to `folder` resolved."""
        return self

    def with_files_relative_to(self, folder: Path) -> "Jello":
        """The same jello with the paths of its files as a scene file in `folder` names them."""
        return self

    @property
    def changes(self) -> bool:
        """Whether its springs change with time."""
        return bool(self.keyframe) or self.takes_its_own_shape

    @property
    def takes_its_own_shape(self) -> bool:
        """Whether its springs change individually."""
        return max(self.creep, self.yield_strain, self.tear_strain) > 0.0 or any(row.freeze for row in self.keyframe)


@dataclass(frozen=True, kw_only=True)
class Scene(Checked):
    """A scene: gravity [m/s²] (keyframes of its own replace it), drag [1/s], headless length `seconds`, jellos,
    colliders and external forces. A TOML file that does not mention `collider` has a level plane at y = 0, one with
    `collider = []` none; in Python there is none without it."""

    title: str = ""
    gravity: Vector = (0.0, -9.81, 0.0)
    drag: float = 0.0
    seconds: float = 4.0
    solver: Solver = field(default_factory=Solver)
    contact: Contact = field(default_factory=Contact)
    camera: Camera = field(default_factory=Camera)
    ground: Ground = field(default_factory=Ground)
    background: Background = field(default_factory=Background)
    collider: Sequence[Collider] = field(default=(), metadata={"guide": "a level plane at y = 0"})
    jello: Sequence[Jello] = ()
    force: Sequence[Force] = ()
    keyframe: Sequence[GravityKeyframe] = ()
    parts: ClassVar[dict[str, type[Checked]]] = {"collider": Collider, "jello": Jello, "keyframe": GravityKeyframe}

    def check(self) -> dict[str, Any]:
        for table in (Solver, Contact, Camera, Ground, Background):
            name = table.__name__.lower()
            if not isinstance(getattr(self, name), table):
                raise SceneError(name, f"expected a {table.__name__}, got {shown(getattr(self, name))}")
        if not listed("jello", self.jello, Jello):
            raise SceneError("jello", "expected at least one jello, the scene is empty")
        if self.camera.follow is not None and self.camera.follow >= len(self.jello):
            raise SceneError("camera.follow", f"expected a jello, 0 to {len(self.jello) - 1}, got {self.camera.follow}")
        return {
            "title": word("title", self.title),
            "gravity": vector("gravity", self.gravity),
            "drag": number("drag", self.drag, low=0.0),
            "seconds": number("seconds", self.seconds, low=0.0),
            "force": listed("force", self.force, Force),
        }
