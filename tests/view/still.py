"""A stand-in for a simulation, so that pictures are tested on shapes that are known exactly."""

from types import SimpleNamespace

import numpy as np

from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.run.assembly import assembled
from taichi_jello.scene.description import Camera, Scene
from taichi_jello.shapes.lattice import Box


class Still:
    """A body that is where the test puts it; frame() lifts it by 5 cm. `calls` are what it was asked while it ran."""

    method_told = ""
    method, substeps, dt, safe_dt = "rk4", 10, 1.0 / 600.0, 1.0 / 500.0

    def __init__(self, scene: Scene):
        self.scene, self.frame_dt, self.time, self.resets = scene, scene.solver.frame_dt, 0.0, 0
        self.body = assembled(scene)
        self.tuning = {"stiffness": 1.0, "damping": 1.0, "gravity": (0.0, -9.81, 0.0), "friction": 0.3}
        self.tuning["wind"] = (0.0, 0.0, 0.0)
        self.first_tuning = dict(self.tuning)
        self.held, self.calls, self.memory = None, [], {}
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

    keeps_ledger = False

    def energies(self) -> dict[str, float]:
        return {"kinetic": 1.0 + self.time, "elastic": 2.0, "gravity": -3.0, "contact": 0.0}

    def tune(self, **numbers) -> None:
        unknown = set(numbers) - set(self.tuning)
        if unknown:
            raise ValueError(f"{unknown.pop()}: the scene has none")
        self.tuning |= numbers

    def push(self, velocity) -> None:
        self.calls.append(("push", tuple(np.round(velocity, 6))))

    def grab(self, particles, weights, target) -> None:
        point = np.asarray(weights) @ self.x[list(particles)]
        self.held = SimpleNamespace(
            particles=particles, weights=weights, point=point, target=np.array(target, float), force=np.full(3, 2.0)
        )

    def move_grab(self, target) -> None:
        self.held.target = np.array(target, float)

    def release(self) -> None:
        self.held = None

    def change_method(self, name: str) -> None:
        self.method = name


def cube_scene(height: float = 0.5, points: int = 4, **jello) -> Scene:
    """A cube of 1 m whose middle is `height` above a floor, seen slightly from above."""
    cube = Box(position=(0.0, height, 0.0), points=(points,) * 3, **jello)
    return Scene(jello=(cube,), collider=(Plane(),), camera=Camera(eye=(0.0, 1.6, 5.0), target=(0.0, 0.6, 0.0)))


def grab_at(viewer, point=(0.0, 0.5, 0.5)):
    """Press the left button on a point of the front side; where on the screen."""
    at = viewer.viewpoint.project(np.array([point]), viewer.size)[0]
    viewer.press("left", tuple(at))
    return at
