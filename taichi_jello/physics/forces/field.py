"""External force fields: one force everywhere, forces on a 3-D grid, or any function of place, speed and time."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce, Rates
from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Force, Scene, SceneError, Vector, vector
from taichi_jello.scene.validation import LARGEST, shown


@dataclass(frozen=True, kw_only=True)
class UniformField(Force):
    """The same `force` [N] on every particle."""

    key: ClassVar[str] = "uniform_field"
    force: Vector

    def check(self) -> dict[str, Any]:
        return {"force": vector("force", self.force)}


@dataclass(frozen=True, kw_only=True)
class GridField(Force):
    """Forces [N] on every particle, given at the nodes of a grid over the box `min` to `max` [m] and interpolated
    linearly along each axis; outside the box the nearest face's value holds. values: (nx, ny, nz, 3), nx ≥ 2 …"""

    key: ClassVar[str] = "grid_field"
    values: Any
    min: Vector = (-2.0, -2.0, -2.0)
    max: Vector = (2.0, 2.0, 2.0)

    def check(self) -> dict[str, Any]:
        try:
            values = np.array(self.values, float)
        except (ValueError, TypeError, OverflowError):
            raise SceneError("values", "expected nested lists of numbers, x by y by z by 3") from None
        if values.ndim != 4 or values.shape[3] != 3 or min(values.shape[:3]) < 2:
            raise SceneError(
                "values", f"expected x by y by z by 3 numbers, at least 2 nodes each way, got {values.shape}"
            )
        if not np.isfinite(values).all():
            raise SceneError("values", "expected finite numbers")
        if np.abs(values).max() > LARGEST:
            raise SceneError("values", f"expected numbers of at most {LARGEST:g} either way")
        low, high = vector("min", self.min), vector("max", self.max)
        if any(a >= b for a, b in zip(low, high, strict=True)):
            raise SceneError("max", f"expected more than min {list(low)} on every axis, got {list(high)}")
        return {"values": values, "min": low, "max": high}


@dataclass(frozen=True, kw_only=True)
class CallableField(Force):
    """`function(x, v, t)`: the force [N] on a particle at x [m] with velocity v [m/s] at time t [s], in the Python
    that Taichi compiles (3-vectors in, a 3-vector out)."""

    key: ClassVar[str] = "callable_field"
    function: Callable[..., Any]

    def check(self) -> dict[str, Any]:
        if not callable(self.function):
            raise SceneError("function", f"expected a Python function, got {shown(self.function)}")
        if getattr(self.function, "__name__", "") == "<lambda>":
            raise SceneError("function", "expected a function defined with def, Taichi compiles no lambda")
        try:
            inspect.signature(self.function).bind("x", "v", "t")
        except TypeError as error:
            raise SceneError("function", f"expected a function of x, v and t: {error}") from None
        except ValueError:  # a builtin without a signature
            pass
        return {}


@ti.data_oriented
class UniformForce(ParticleForce):
    title = "uniform field"

    def __init__(self, field: UniformField):
        self.force = ti.Vector(list(field.force))

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list["UniformForce"]:
        return [cls(field) for field in scene.force if isinstance(field, UniformField) and any(field.force)]

    @ti.func
    def on(self, i, x, v, t):
        return ti.cast(self.force, float)


@ti.data_oriented
class GridForce(ParticleForce):
    title = "grid field"

    def __init__(self, field: GridField, particles: Particles):
        self.shape = field.values.shape[:3]
        self.low = ti.Vector(list(field.min))
        per_metre = [(n - 1) / (b - a) for n, a, b in zip(self.shape, field.min, field.max, strict=True)]
        self.per_metre = ti.Vector(per_metre)
        self.nodes = particles.memory.table(self.title, "nodes", field.values.reshape(-1, 3))
        slopes = [np.diff(field.values, axis=axis) * per_metre[axis] for axis in range(3)]
        steepest = sum(float(np.linalg.norm(s, axis=-1).max()) for s in slopes)
        self.squared_frequency = steepest / float(particles.body.mass.min())

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list["GridForce"]:
        return [cls(field, particles) for field in scene.force if isinstance(field, GridField)]

    @ti.func
    def on(self, i, x, v, t):
        return self.at(x[i])

    @ti.func
    def at(self, p):
        """The force at the point p [m], trilinear between the eight nodes around it."""
        cell = ti.Vector([0, 0, 0])
        part = ti.Vector([0.0, 0.0, 0.0])
        for axis in ti.static(range(3)):
            place = (p[axis] - self.low[axis]) * self.per_metre[axis]
            place = ti.min(ti.max(place, 0.0), self.shape[axis] - 1.0)
            cell[axis] = ti.min(int(place), self.shape[axis] - 2)
            part[axis] = place - cell[axis]
        force = ti.Vector([0.0, 0.0, 0.0])
        for corner in ti.static(ti.ndrange(2, 2, 2)):
            weight = ti.cast(1.0, float)
            for axis in ti.static(range(3)):
                weight *= part[axis] if ti.static(corner[axis] == 1) else 1.0 - part[axis]
            node = ((cell[0] + corner[0]) * self.shape[1] + cell[1] + corner[1]) * self.shape[2] + cell[2] + corner[2]
            force += weight * self.nodes[node]
        return force

    def rates(self) -> Rates:
        return Rates(squared_frequency=self.squared_frequency)


def check_vector(key: str, function: Any) -> None:
    """Raise SceneError unless Taichi compiles the function and finds that it returns a 3-vector: any other value would
    end the process where the force is added to others."""
    shapes: list[tuple[int, ...]] = []

    def note(force: Any) -> int:
        try:
            shapes.append((len(force),) if isinstance(force, (list, tuple)) else tuple(force.get_shape()))
        except (AttributeError, ti.TaichiCompilationError):
            shapes.append(())
        return len(shapes)

    @ti.kernel
    def probe(run: ti.i32):
        if run == 1:
            force = function(ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0]), 0.0)
            ti.static(note(force))

    try:
        probe(0)
    except ti.TaichiCompilationError as error:
        if "Cannot find source" in str(error):
            problem = (
                "expected a function in a file or a notebook: Taichi compiles its source, which Python keeps there"
            )
            raise SceneError(key, problem) from None
        raise SceneError(key, f"expected what Taichi compiles: {str(error).splitlines()[-1]}") from error
    if shapes != [(3,)]:
        found = f"an array of shape {shapes[0]}" if shapes and shapes[0] else "none"
        raise SceneError(key, f"expected a function that returns a 3-vector, got {found}")


@ti.data_oriented
class CallableForce(ParticleForce):
    title = "callable field"
    reads_velocity = True

    def __init__(self, function: Any, particles: Particles, key: str):
        self.frame_start = particles.memory.table(self.title, "frame start", np.zeros(1))
        self.function = function if getattr(function, "_is_taichi_function", False) else ti.func(function)
        check_vector(key, self.function)

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list["CallableForce"]:
        fields = [(n, field) for n, field in enumerate(scene.force) if isinstance(field, CallableField)]
        return [cls(field.function, particles, f"force.{n}.function") for n, field in fields]

    def begin_frame(self, start: float, end: float) -> None:
        self.frame_start[0] = start

    @ti.func
    def on(self, i, x, v, t):
        return self.function(x[i], v[i], self.frame_start[0] + t)
