"""The toys of the study of motion: a cube and a ball in one scene. One moves and is watched while the other one rests
or falls far away, so that a method is compiled once for all that is done with them."""

from functools import cached_property
from typing import Any

import numpy as np

from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.run.assembly import assembled
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Contact, Scene, Vector
from taichi_jello.shapes.ball import Ball
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies.stability import swings

CUBE, BALL = 0, 1  # jellos of the scene
ACROSS = {False: 5, True: 4}  # points along the cube and cells across the ball, by --quick
STIFF, BALL_STIFF = 2000.0, 1000.0  # N/m; the fastest motions of both are about as fast
DAMPING = 0.25  # N·s/m
EDGE, RADIUS, FAR = 1.0, 0.5, 5.0  # m; the last between the middles of both
G = 9.81  # m/s²
LEVEL: Vector = (0.0, -G, 0.0)
SPIN, STRETCH, SWING = 15.0, 0.02, 3e-3  # rad/s; of the edge; m that a point is moved by at most

State = tuple[np.ndarray, np.ndarray]


class Toys:
    """The cube and the ball, beside each other on a plane."""

    def __init__(self, quick: bool):
        self.across = ACROSS[quick]
        self.body: Body = assembled(self.scene())
        self.cube, self.ball = (self.body.jello == jello for jello in (CUBE, BALL))

    def scene(
        self, stiffness: float = 1.0, damping: float = 1.0, gravity: Vector = LEVEL, friction: float = 0.3
    ) -> Scene:
        """As `Simulation.tune` would make it: stiffness and damping are factors."""
        n, c = self.across, damping * DAMPING
        cube = Box(points=(n, n, n), position=(0.0, 0.5 * EDGE, 0.0), stiffness=stiffness * STIFF, damping=c)
        k = stiffness * BALL_STIFF
        ball = Ball(resolution=n, radius=RADIUS, position=(FAR, RADIUS, 0.0), stiffness=k, damping=c)
        contact = Contact(touch=False, friction=friction)
        return Scene(gravity=gravity, contact=contact, jello=[cube, ball], collider=[Plane()])

    @cached_property
    def swings(self) -> tuple[np.ndarray, np.ndarray]:
        """ω [1/s] of the cube's swings where nothing is tuned, the slowest first, and their shapes as columns."""
        values, shapes = swings(self.scene().jello[CUBE].body())
        return np.sqrt(np.maximum(values, 0.0) * STIFF / self.body.mass[0]), shapes

    def lowest(self, stiffness: float) -> tuple[float, np.ndarray]:
        """ω [1/s] and shape (N, 3) of the cube's lowest swing with its springs so many times as stiff: the first after
        the six modes of a rigid body."""
        rates, shapes = self.swings
        return float(rates[6] * np.sqrt(stiffness)), shapes[:, 6].reshape(-1, 3)

    def rolling(self, slope: float) -> float:
        """[m/s²] How fast a rigid ball gains speed down a slope [rad] on which it does not slip,
        g sin θ / (1 + I/m r²): 5/7 g sin θ where it is solid and even. This one's mass is in its points."""
        m, x = self.body.mass[self.ball], self.body.rest[self.ball]
        inertia = m @ np.sum((x - m @ x / m.sum())[:, :2] ** 2, axis=1)
        return float(G * np.sin(slope) / (1.0 + inertia / (m.sum() * RADIUS**2)))

    def raised(self, cube: float, ball: float) -> State:
        """x and v at rest, both lifted by so much [m]."""
        x = self.body.x.copy()
        x[self.cube, 1] += cube
        x[self.ball, 1] += ball
        return x, np.zeros_like(x)

    def spinning(self) -> State:
        """The cube spins about the vertical."""
        x, v = self.raised(1.0, 1.0)
        v[self.cube] = np.cross((0.0, SPIN, 0.0), x[self.cube] - x[self.cube].mean(0))
        return x, v

    def swung(self) -> State:
        """The cube in its lowest mode, at the end of its swing."""
        x, v = self.raised(1.0, 1.0)
        shape = self.lowest(1.0)[1]
        x[self.cube] += SWING / np.linalg.norm(shape, axis=1).max() * shape
        return x, v

    def stretched(self) -> State:
        """The cube longer along x."""
        x, v = self.raised(1.0, 1.0)
        x[self.cube, 0] *= 1.0 + STRETCH
        return x, v

    def numbers(self) -> dict[str, Any]:
        return {"particles": len(self.body), "springs": len(self.body.springs)}
