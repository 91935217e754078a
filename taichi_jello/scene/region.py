"""Parts of a jello: pinned points, and regions with a stiffness, damping or mass of their own."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.colors import Color, color_or_none
from taichi_jello.scene.keyframes import Move
from taichi_jello.scene.validation import FAMILIES, LARGEST, Checked, SceneError, Vector, box, by_family, number, vector


def places(rest: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 3) points relative to the bounding box of the particles at `rest` (N, 3): 0 to 1 along each axis, 0 along a
    flat one."""
    low, size = rest.min(0), np.ptp(rest, axis=0)
    return (points - low) / np.where(size > 0.0, size, 1.0)


def in_box(where: np.ndarray, low: Vector, high: Vector) -> np.ndarray:
    """(n,) bool: which places (n, 3) lie in a box."""
    return np.all((where >= np.array(low) - 1e-9) & (where <= np.array(high) + 1e-9), axis=1)


@dataclass(frozen=True, kw_only=True)
class Pin(Checked):
    """Holds the points whose rest position, 0 to 1 along each axis of the shape, lies in the box: still, or moved along
    the keyframes, straight within a frame."""

    min: Vector = (0.0, 0.0, 0.0)
    max: Vector = (1.0, 1.0, 1.0)
    keyframe: Sequence[Move] = ()
    parts: ClassVar[dict[str, type[Checked]]] = {"keyframe": Move}

    def check(self) -> dict[str, Any]:
        return box(self.min, self.max)

    def holds(self, where: np.ndarray) -> np.ndarray:
        """(n,) bool: which places (n, 3) it holds."""
        return in_box(where, self.min, self.max)


def checked_factor(key: str, value: Any) -> Any:
    """A factor: one number, numbers at the nodes of a grid, x by y by z, or a function of places (n, 3)."""
    if callable(value):
        return value
    if not isinstance(value, (list, tuple, np.ndarray)):
        return number(key, value, low=0.0)
    try:
        grid = np.array(value)
        if grid.dtype.kind not in "fiu" and grid.size:
            raise TypeError("not numbers")
        grid = grid.astype(float)
    except (ValueError, TypeError, OverflowError):
        raise SceneError(key, "expected a number or nested lists of numbers, x by y by z") from None
    if grid.ndim != 3 or 0 in grid.shape:
        raise SceneError(key, f"expected x by y by z numbers, got an array of shape {grid.shape}")
    if not np.isfinite(grid).all() or grid.min() < 0.0:
        raise SceneError(key, "expected finite numbers of at least 0")
    if grid.max() > LARGEST:
        raise SceneError(key, f"expected numbers of at most {LARGEST:g}, got {grid.max():g}")
    return tuple(tuple(tuple(row) for row in plane) for plane in grid.tolist())


@dataclass(frozen=True, kw_only=True)
class Region(Checked):
    """The springs whose middle lies in the box from `min` to `max` or, with a radius, in the ball around `center`, by
    default the middle; coordinates are 0 to 1 along each axis of the rest shape.

    stiffness [N/m] and damping [N·s/m] of these springs, or tables by family; unchanged if left out. stiffness_factor
    and damping_factor multiply the springs' own values: one number, an x by y by z array that is linear between its
    nodes, which span the box, or a function of the places (n, 3). mass_factor likewise multiplies the masses of the
    points that lie there. color: of the skin there.
    """

    min: Vector = (0.0, 0.0, 0.0)
    max: Vector = (1.0, 1.0, 1.0)
    center: Vector | None = None
    radius: float | None = None
    stiffness: Any = None
    damping: Any = None
    stiffness_factor: Any = 1.0
    damping_factor: Any = 1.0
    mass_factor: Any = 1.0
    color: Color | None = None

    def check(self) -> dict[str, Any]:
        corners = box(self.min, self.max)
        checked: dict[str, Any] = {"color": color_or_none("color", self.color)}
        if self.radius is not None:
            checked["radius"] = number("radius", self.radius, above=0.0)
            checked["center"] = vector("center", (0.5, 0.5, 0.5) if self.center is None else self.center)
        elif self.center is not None:
            raise SceneError("center", "expected a radius beside it")
        for name in ("stiffness", "damping"):
            if getattr(self, name) is not None:
                checked[name] = by_family(name, getattr(self, name))
        names = ("stiffness_factor", "damping_factor", "mass_factor")
        factors = {name: checked_factor(name, getattr(self, name)) for name in names}
        has_grid = any(isinstance(value, tuple) for value in factors.values())
        if self.radius is not None and corners != {"min": Region.min, "max": Region.max} and not has_grid:
            raise SceneError("radius", "expected either a box, min and max, or a ball, center and radius; got both")
        return corners | checked | factors

    def holds(self, where: np.ndarray) -> np.ndarray:
        """(n,) bool: which places (n, 3) lie inside."""
        if self.radius is not None:
            return np.linalg.norm(where - self.center, axis=1) <= self.radius + 1e-9
        return in_box(where, self.min, self.max)

    def share(self, where: np.ndarray, soft: float) -> np.ndarray:
        """(n,) 0 to 1: how far inside the places (n, 3) are, a half on its boundary, over a width of `soft`."""
        if self.radius is not None:
            beyond = np.linalg.norm(where - self.center, axis=1) - self.radius
        else:  # a side at the body's own side bounds nothing
            low, high = (
                np.where(np.array(self.min) > 0.0, self.min, -np.inf),
                np.where(np.array(self.max) < 1.0, self.max, np.inf),
            )
            beyond = np.maximum(low - where, where - high).max(1)
        return np.clip(0.5 - beyond / soft, 0.0, 1.0)

    def factor(self, name: str, where: np.ndarray) -> np.ndarray:
        """(n,) values of the factor `name` at the places (n, 3)."""
        value = getattr(self, name)
        if callable(value):
            return _called(name, value, where)
        return np.full(len(where), value) if isinstance(value, float) else self._interpolated(value, where)

    def _interpolated(self, grid: Any, where: np.ndarray) -> np.ndarray:
        nodes = np.array(grid)
        extent = np.array(self.max) - self.min
        place = np.clip((where - self.min) / np.where(extent > 0.0, extent, 1.0), 0.0, 1.0)
        for axis, count in enumerate(nodes.shape):  # nodes becomes (n, y, z), then (n, z), then (n,)
            at = place[:, axis] * (count - 1)
            left = np.minimum(at.astype(int), max(count - 2, 0))
            right, part = np.minimum(left + 1, count - 1), at - left
            row = () if axis == 0 else (np.arange(len(where)),)
            part = part.reshape(-1, *[1] * (2 - axis))
            nodes = (1.0 - part) * nodes[*row, left] + part * nodes[*row, right]
        return nodes


def _called(name: str, function: Callable[[np.ndarray], Any], where: np.ndarray) -> np.ndarray:
    try:
        value = np.asarray(function(where), float)
    except Exception as error:  # the user's code may raise anything
        line = (str(error).splitlines() or [""])[0]
        raise SceneError(name, f"the function of places failed: {type(error).__name__}: {line}") from error
    if value.shape not in ((), (len(where),)):
        raise SceneError(name, f"expected a function of (n, 3) places that gives (n,) numbers, got shape {value.shape}")
    if not np.isfinite(value).all() or np.any(value < 0.0):
        raise SceneError(name, "expected a function that gives finite numbers of at least 0")
    return np.broadcast_to(value, len(where))


def with_regions(body: Body, regions: tuple[Region, ...]) -> dict[str, np.ndarray]:
    """stiffness [N/m] and damping [N·s/m] (S,) of the springs and mass [kg] (N,) of the points of `body`, changed by
    its regions in order. Raises SceneError for a region that changes nothing, and for a mass of 0."""
    middle = places(body.rest, body.rest[body.springs].mean(1)) if len(body.springs) else np.zeros((0, 3))
    point, mass = places(body.rest, body.rest), body.mass.copy()
    springs = {"stiffness": body.stiffness.copy(), "damping": body.damping.copy()}
    for index, region in enumerate(regions):
        inside, weighs = region.holds(middle), region.holds(point) & (region.mass_factor != 1.0)
        if not (inside.any() or weighs.any()):
            raise SceneError(
                f"region.{index}", "expected a part of the body, 0 to 1 along each axis; no spring's middle lies in it"
            )
        try:
            for name, values in springs.items():
                given = getattr(region, name)
                if isinstance(given, dict):
                    for family, value in given.items():
                        values[inside & (body.family == FAMILIES.index(family))] = value
                elif given is not None:
                    values[inside] = given
                values[inside] *= region.factor(f"{name}_factor", middle[inside])
            mass[weighs] *= region.factor("mass_factor", point[weighs])
            if not (mass > 0.0).all():
                raise SceneError("mass_factor", "expected factors above 0, for every point has a mass")
        except SceneError as error:
            raise error.within(f"region.{index}") from None
    return springs | {"mass": mass}
