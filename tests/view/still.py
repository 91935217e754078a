"""A stand-in for a simulation, so that pictures are tested on shapes that are known exactly."""

import numpy as np

from taichi_jello.body import join
from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.scene import Camera, Scene
from taichi_jello.shapes.lattice import Box


class Still:
    """A body that is where the test puts it; frame() lifts it by 5 cm."""

    def __init__(self, scene: Scene):
        self.scene, self.frame_dt, self.time, self.resets = scene, scene.solver.frame_dt, 0.0, 0
        self.body = join([jello.body() for jello in scene.jello])
        self.put(self.body.x)

    def put(self, x: np.ndarray, v: np.ndarray | None = None) -> "Still":
        self.x = np.array(x, float)
        self.v = np.zeros_like(self.x) if v is None else np.array(v, float)
        return self

    def snapshot(self) -> "Still":
        """Its own moment: it has x, v and time."""
        return self

    def frame(self) -> None:
        self.time += self.frame_dt
        self.put(self.x + np.array([0.0, 0.05, 0.0]))

    def reset(self) -> None:
        self.time, self.resets = 0.0, self.resets + 1
        self.put(self.body.x)


def cube_scene(height: float = 0.5, points: int = 4, **jello) -> Scene:
    """A cube of 1 m whose middle is `height` above a floor, seen slightly from above."""
    cube = Box(position=(0.0, height, 0.0), points=(points,) * 3, **jello)
    return Scene(jello=(cube,), collider=(Plane(),), camera=Camera(eye=(0.0, 1.6, 5.0), target=(0.0, 0.6, 0.0)))
