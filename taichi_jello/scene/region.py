"""Parts of a jello that are stiffer, softer, more damped, heavier or lighter than the rest."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.validation import FAMILIES, LARGEST, Checked, SceneError, Vector, by_family, number, vector


def places(rest: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 3) points of the shape with particles at `rest` (N, 3), 0 to 1 along each axis; 0 along an axis in which it
    has no extent."""
    low, size = rest.min(0), np.ptp(rest, axis=0)
    return (points - low) / np.where(size > 0.0, size, 1.0)


def painted(key: str, value: Any) -> Any:
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
    except (ValueError, TypeError):
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
    """The springs whose middle lies, in the rest shape with 0 to 1 along each axis, in the box from `min` to `max` or,
    where a radius is given, in the ball around `center`, by default the middle.

    stiffness [N/m] and damping [N·s/m] of these springs, or tables by family; where left out they stay as they are.
    stiffness_factor and damping_factor multiply what the springs have: one number, or an x by y by z array of them that
    is linear between its nodes, which span the box `min` to `max`, or a function of the places (n, 3). mass_factor, in
    the same ways, multiplies the masses of the points that lie there.
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

    def check(self) -> dict[str, Any]:
        low, high = vector("min", self.min), vector("max", self.max)
        if any(a > b for a, b in zip(low, high, strict=True)):
            raise SceneError("max", f"expected at least min {list(low)} on every axis, got {list(high)}")
        checked: dict[str, Any] = {"min": low, "max": high}
        if self.radius is None and self.center is not None:
            raise SceneError("center", "expected a radius beside it")
        if self.radius is not None:
            checked["radius"] = number("radius", self.radius, above=0.0)
            checked["center"] = vector("center", (0.5, 0.5, 0.5) if self.center is None else self.center)
        for name in ("stiffness", "damping"):
            if getattr(self, name) is not None:
                checked[name] = by_family(name, getattr(self, name))
        factors = {
            name: painted(name, getattr(self, name)) for name in ("stiffness_factor", "damping_factor", "mass_factor")
        }
        grids = any(isinstance(value, tuple) for value in factors.values())  # span the box
        if self.radius is not None and (low, high) != (Region.min, Region.max) and not grids:
            raise SceneError("radius", "expected either a box, min and max, or a ball, center and radius; got both")
        return checked | factors

    def holds(self, where: np.ndarray) -> np.ndarray:
        """(n,) whether the places (n, 3) lie inside."""
        if self.radius is not None:
            return np.linalg.norm(where - self.center, axis=1) <= self.radius + 1e-9
        return np.all((where >= np.array(self.min) - 1e-9) & (where <= np.array(self.max) + 1e-9), axis=1)

    def factor(self, name: str, where: np.ndarray) -> np.ndarray:
        """(n,) by how much the springs or points at the places (n, 3) are multiplied."""
        value = getattr(self, name)
        if not callable(value):
            return np.full(len(where), value) if isinstance(value, float) else self._between_nodes(value, where)
        return _called(name, value, where)

    def _between_nodes(self, grid: Any, where: np.ndarray) -> np.ndarray:
        nodes = np.array(grid)
        extent = np.array(self.max) - self.min
        place = np.clip((where - self.min) / np.where(extent > 0.0, extent, 1.0), 0.0, 1.0)
        for axis, count in enumerate(nodes.shape):  # the first axis goes first: (x, y, z), then (n, y, z), (n, z), (n,)
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
    except Exception as error:  # whatever a person's function does
        told = str(error).splitlines() or [""]
        raise SceneError(name, f"the function of places failed: {type(error).__name__}: {told[0]}") from error
    if value.shape not in ((), (len(where),)):
        raise SceneError(name, f"expected a function of (n, 3) places that gives (n,) numbers, got shape {value.shape}")
    if not np.isfinite(value).all() or np.any(value < 0.0):
        raise SceneError(name, "expected a function that gives finite numbers of at least 0")
    return np.broadcast_to(value, len(where))


def divided(body: Body, regions: tuple[Region, ...]) -> dict[str, np.ndarray]:
    """stiffness [N/m] and damping [N·s/m] (S,) of the springs of `body` and mass [kg] (N,) of its points; a later
    region goes over an earlier one. Raises SceneError for a region that nothing lies in which it is about, and for a
    mass of 0."""
    middle = places(body.rest, body.rest[body.springs].mean(1)) if len(body.springs) else np.zeros((0, 3))
    point, mass = places(body.rest, body.rest), body.mass.copy()
    made = {"stiffness": body.stiffness.copy(), "damping": body.damping.copy()}
    for index, region in enumerate(regions):
        inside, weighs = region.holds(middle), region.holds(point) & (region.mass_factor != 1.0)
        if not (inside.any() or weighs.any()):
            raise SceneError(
                f"region.{index}", "expected a part of the body, 0 to 1 along each axis; no spring's middle lies in it"
            )
        for name, values in made.items():
            given = getattr(region, name)
            if given is not None:
                table = given if isinstance(given, dict) else {}
                values[inside] = values[inside] if table else given
                for family in table:
                    values[inside & (body.family == FAMILIES.index(family))] = table[family]
        try:
            for name, values in made.items():
                values[inside] *= region.factor(f"{name}_factor", middle[inside])
            mass[weighs] *= region.factor("mass_factor", point[weighs])
            if not (mass > 0.0).all():
                raise SceneError("mass_factor", "expected factors above 0, for every point has a mass")
        except SceneError as error:
            raise error.within(f"region.{index}") from None
    return made | {"mass": mass}
