"""Classic Jello Cube world files (.w): a cube of 8×8×8 points of 1 m between the walls x, y, z = ±2 m.

One group a line, no empty lines: the integrator (Euler or RK4); dt [s] and n, the steps between shown ones; kElastic
dElastic kCollision dCollision [N/m, N·s/m]; the mass of one point [kg]; 0, or 1 and then the inclined plane's a b c d
(ax + by + cz + d = 0, the cube starts on its free side); the force field's resolution r and, unless that is 0, r³
forces on a point [N] at the nodes of a grid over the room, z fastest, then y; 512 positions [m] and 512 velocities
[m/s] in the same order. All springs share the elastic coefficients, walls and plane those of collision, without
friction; the only gravity is in the force field. Coordinates stay as they are in the file, where z often points up, so
that numbers can be compared.
"""

from collections.abc import Container
from math import isfinite
from pathlib import Path

import numpy as np

from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.physics.colliders.room import Room
from taichi_jello.physics.forces.field import GridField
from taichi_jello.scene.description import Collider, Contact, Scene, Solver
from taichi_jello.scene.validation import SceneError
from taichi_jello.shapes.lattice import Box

SUFFIX = ".w"
METHODS = ("euler", "rk4")
POINTS = 8
MAX_RESOLUTION = 256  # nodes along an edge of a force field


class Lines:
    """The lines of a file, read in order."""

    def __init__(self, text: str):
        self.rows, self.at = text.rstrip().splitlines(), 0

    def problem(self, expected: str) -> SceneError:
        """The error for the line read last."""
        got = repr(self.rows[self.at - 1][:60]) if self.at <= len(self.rows) else "the end of the file"
        return SceneError(f"line {self.at}", f"expected {expected}, got {got}")

    def next(self) -> str:
        self.at += 1
        return self.rows[self.at - 1].strip() if self.at <= len(self.rows) else ""

    def numbers(self, count: int, expected: str, low: float = -np.inf) -> list[float]:
        """The `count` finite numbers of the next line, each at least `low`."""
        try:
            found = [float(word) for word in self.next().split()]
        except ValueError:
            raise self.problem(expected) from None
        if len(found) != count or not all(isfinite(value) and value >= low for value in found):
            raise self.problem(expected)
        return found

    def whole(self, expected: str, allowed: Container[float]) -> int:
        value = self.numbers(1, expected)[0]
        if value not in allowed:
            raise self.problem(expected)
        return int(value)

    def vectors(self, count: int, of: str) -> np.ndarray:
        """(count, 3) from as many lines."""
        return np.array([self.numbers(3, f"three numbers, {of} {k + 1} of {count}") for k in range(count)])


def load(path: Path) -> Scene:
    try:
        lines = Lines(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError:
        raise SceneError("", "expected text, a Jello Cube world file") from None
    method = lines.next().lower()
    if method not in METHODS:
        raise lines.problem("an integrator, Euler or RK4")
    dt, every = lines.numbers(2, "the time step in seconds, greater than 0, and every how many steps are shown", 1e-12)
    if every % 1.0 or every < 1.0:
        raise lines.problem("the time step and a whole number of steps of at least 1")
    elastic = "four numbers of at least 0: kElastic dElastic kCollision dCollision"
    stiffness, damping, contact_stiffness, contact_damping = lines.numbers(4, elastic, 0.0)
    mass = lines.numbers(1, "the mass of one point, greater than 0", 1e-300)[0]
    has_plane = lines.whole("0, or 1 for an inclined plane", range(2))
    plane = lines.numbers(4, "four numbers a b c d of the inclined plane") if has_plane else []
    if has_plane and not any(plane[:3]):
        raise lines.problem("an inclined plane a b c d with a direction a b c other than 0 0 0")
    allowed = {0, *range(2, MAX_RESOLUTION + 1)}
    resolution = lines.whole(f"the force field's resolution, 0 or 2 to {MAX_RESOLUTION}", allowed)
    field = lines.vectors(resolution**3, "force")
    x, v = (lines.vectors(POINTS**3, of) for of in ("position", "velocity"))
    if lines.at < len(lines.rows):
        lines.next()
        raise lines.problem(f"the end of the file after {POINTS**3} velocities")

    low, high = (-2.0, -2.0, -2.0), (2.0, 2.0, 2.0)
    collider: list[Collider] = [Room(min=low, max=high)]
    return Scene(
        title=path.stem,
        gravity=(0.0, 0.0, 0.0),
        solver=Solver(method=method, dt=dt, frame_dt=dt * every),
        contact=Contact(stiffness=contact_stiffness, damping=contact_damping, friction=0.0),
        collider=collider + ([_inclined(plane, x.mean(0))] if has_plane else []),
        force=[GridField(values=field.reshape(*[resolution] * 3, 3), min=low, max=high)] if field.any() else [],
        jello=[Box(points=(POINTS,) * 3, mass=mass * POINTS**3, stiffness=stiffness, damping=damping, x=x, v=v)],
    )


def _inclined(plane: list[float], start: np.ndarray) -> Plane:
    """The plane, facing the side of `start` (3,) [m]."""
    normal = np.array(plane[:3])
    point = -plane[3] * normal / (normal @ normal)
    facing = normal if normal @ start + plane[3] >= 0.0 else -normal
    return Plane(point=tuple(point.tolist()), normal=tuple(facing.tolist()))
