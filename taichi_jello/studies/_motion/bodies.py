"""The scene of the motion study: a cube and a ball on a plane. A trial watches one of them while the other rests or
falls far away, so that a method is compiled once for all trials."""

from functools import cached_property

import numpy as np

from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.run.assembly import assembled
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Contact, Scene, Vector
from taichi_jello.shapes.ball import Ball
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies.stability import modes

CUBE, BALL = 0, 1  # jellos of the scene
RESOLUTION = {False: 5, True: 4}  # points along the cube and cells across the ball, by --quick
STIFFNESS, BALL_STIFFNESS = 2000.0, 1000.0  # N/m; the fastest modes of both are about as fast
DAMPING = 0.25  # N·s/m
EDGE, RADIUS, DISTANCE = 1.0, 0.5, 5.0  # m; DISTANCE: between the centres of both
G = 9.81  # m/s²
LEVEL: Vector = (0.0, -G, 0.0)
SPIN, STRETCH, AMPLITUDE = 15.0, 0.02, 3e-3  # rad/s; fraction of the edge; m, the largest displacement in a mode

State = tuple[np.ndarray, np.ndarray]  # x [m] and v [m/s], (N, 3)


class CubeAndBall:
    """The cube and the ball beside each other on a plane."""

    def __init__(self, quick: bool):
        self.resolution = RESOLUTION[quick]
        self.body: Body = assembled(self.scene())
        self.cube, self.ball = (self.body.jello == jello for jello in (CUBE, BALL))

    def scene(
        self, stiffness: float = 1.0, damping: float = 1.0, gravity: Vector = LEVEL, friction: float = 0.3
    ) -> Scene:
        """stiffness, damping: factors, as in `Simulation.tune`."""
        n, c = self.resolution, damping * DAMPING
        cube = Box(points=(n, n, n), position=(0.0, 0.5 * EDGE, 0.0), stiffness=stiffness * STIFFNESS, damping=c)
        k, centre = stiffness * BALL_STIFFNESS, (DISTANCE, RADIUS, 0.0)
        ball = Ball(resolution=n, radius=RADIUS, position=centre, stiffness=k, damping=c)
        contact = Contact(touch=False, friction=friction)
        return Scene(gravity=gravity, contact=contact, jello=[cube, ball], collider=[Plane()])

    @cached_property
    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """ω [1/s] of the untuned cube's modes, the slowest first, and their shapes as columns."""
        values, shapes = modes(self.scene().jello[CUBE].body())
        return np.sqrt(np.maximum(values, 0.0) * STIFFNESS / self.body.mass[0]), shapes

    def lowest_mode(self, stiffness: float) -> tuple[float, np.ndarray]:
        """ω [1/s] and shape (N, 3) of the first mode of the cube that is no rigid motion. stiffness: a factor."""
        rates, shapes = self.modes
        return float(rates[6] * np.sqrt(stiffness)), shapes[:, 6].reshape(-1, 3)

    def rolling(self, slope: float) -> float:
        """[m/s²] The acceleration of a rigid ball that rolls down a slope [rad] without slipping,
        g sin θ / (1 + I/m r²): 5/7 g sin θ if it is solid and uniform. The mass of this one is in its points."""
        m, x = self.body.mass[self.ball], self.body.rest[self.ball]
        inertia = m @ np.sum((x - m @ x / m.sum())[:, :2] ** 2, axis=1)
        return float(G * np.sin(slope) / (1.0 + inertia / (m.sum() * RADIUS**2)))

    def raised(self, cube: float = 1.0, ball: float = 1.0) -> State:
        """Both at rest and lifted by so much [m]."""
        x = self.body.x.copy()
        x[self.cube, 1] += cube
        x[self.ball, 1] += ball
        return x, np.zeros_like(x)

    def spinning(self) -> State:
        """The cube spins about the vertical axis."""
        x, v = self.raised()
        v[self.cube] = np.cross((0.0, SPIN, 0.0), x[self.cube] - x[self.cube].mean(0))
        return x, v

    def in_lowest_mode(self) -> State:
        """The cube at the turning point of its lowest mode."""
        x, v = self.raised()
        shape = self.lowest_mode(1.0)[1]
        x[self.cube] += AMPLITUDE / np.linalg.norm(shape, axis=1).max() * shape
        return x, v

    def stretched(self) -> State:
        """The cube stretched along x."""
        x, v = self.raised()
        x[self.cube, 0] *= 1.0 + STRETCH
        return x, v
