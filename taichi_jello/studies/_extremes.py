"""The stiff and extreme cases that every method has to stand: data, one entry each."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.scene import Scene
from taichi_jello.shapes.lattice import Box
from taichi_jello.simulation import Simulation

STILL = (0.0, 0.0, 0.0)
SHAPE = 1e-3  # of the body's size by which a recovered shape may differ


def shape_error(body: Any, x: np.ndarray) -> float:
    """RMS distance [m] of x (N, 3) from the rest shape, after the rigid motion or reflection that fits best, over the
    diagonal of the body."""
    a, b = body.rest - body.rest.mean(0), x - x.mean(0)
    u, _, vt = np.linalg.svd(b.T @ a)
    away = b - a @ (u @ vt).T
    return float(np.sqrt((away**2).sum(1).mean()) / (np.linalg.norm(np.ptp(a, 0)) or 1.0))


@dataclass(frozen=True)
class Extreme:
    """A scene, the state it begins in as a function of the points (N, 3), its length [s], and what it must show in the
    end: a function of the simulation that returns what is wrong, or nothing."""

    name: str
    box: dict[str, Any]
    begin: Callable[[np.ndarray], np.ndarray] = lambda x: x
    scene: dict[str, Any] = field(default_factory=lambda: {"gravity": STILL})
    seconds: float = 0.5
    demand: Callable[[Simulation, np.ndarray], str] = lambda simulation, start: ""

    def simulation(self, **options: Any) -> Simulation:
        box: dict[str, Any] = {"points": (4, 4, 4), "mass": 0.125, "damping": 0.25} | self.box
        return Simulation(Scene(jello=[Box(**box)], **self.scene), **options)


def recovered(simulation: Simulation, start: np.ndarray) -> str:
    error = shape_error(simulation.body, simulation.x)
    return "" if error < SHAPE else f"shape off by {error:.1e}"


def unmoved(simulation: Simulation, start: np.ndarray) -> str:
    moved = float(np.abs(simulation.x - start).max())
    return "" if moved < 1e-4 else f"moved {moved:.1e} m"


def fallen(simulation: Simulation, start: np.ndarray) -> str:
    """Free fall, to the first order in the step that backward Euler is late by."""
    t = simulation.time
    late = 0.5 * 9.81 * t * simulation.dt + 1e-5
    away = float(np.abs(simulation.x - start - [0.0, -0.5 * 9.81 * t * t, 0.0]).max())
    return "" if away <= late * 1.001 else f"{away:.1e} m from free fall"


def above(simulation: Simulation, start: np.ndarray) -> str:
    """No deeper than all its speed could drive one point in, and coming back."""
    speed = np.linalg.norm(simulation.start.v, axis=1).max()
    deepest = speed * np.sqrt(simulation.body.mass.max() / simulation.scene.contact.stiffness) + 0.01
    low = float(simulation.x[:, 1].min())
    return "" if low > -deepest else f"{-low:.2g} m below the ground"


def undisturbed(simulation: Simulation, start: np.ndarray) -> str:
    error = shape_error(simulation.body, simulation.x)
    return "" if error < 1e-5 else f"shape off by {error:.1e}: --precision f64"


def random(x: np.ndarray) -> np.ndarray:
    return np.random.default_rng(5).uniform(-0.5, 0.5, x.shape)


def twisted(x: np.ndarray) -> np.ndarray:
    angle = 2.0 * np.pi * x[:, 1]
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x[:, 0] + s * x[:, 2], x[:, 1], c * x[:, 2] - s * x[:, 0]], 1)


def falling(speed: float) -> dict[str, Any]:
    return {"position": (0.0, 0.6, 0.0), "velocity": (0.0, -speed, 0.0)}


GROUND = {"collider": [Plane()]}
CASES = (
    Extreme("all points on one point", {}, lambda x: 0.0 * x),
    Extreme("flat", {}, lambda x: x * [1.0, 0.0, 1.0]),
    Extreme("flat, 1 % thick", {"damping": 1.0}, lambda x: x * [1.0, 0.01, 1.0], seconds=2.0, demand=recovered),
    Extreme("random points", {}, random),
    Extreme("mirrored", {}, lambda x: x * [-1.0, 1.0, 1.0], demand=unmoved),
    Extreme("stretched 10 times", {"damping": 1.0}, lambda x: x * [1.0, 10.0, 1.0], seconds=2.0, demand=recovered),
    Extreme("twisted by 360°", {}, twisted),
    Extreme("k = 1e-6 N/m", {"stiffness": 1e-6, "damping": 0.0, **falling(0.0)}, scene=GROUND),
    Extreme("k = 1e8 N/m", {"stiffness": 1e8, **falling(5.0)}, scene=GROUND, seconds=0.25, demand=above),
    Extreme("melted, k = 0", {"stiffness": 0.0, "damping": 0.0}, scene={}, demand=fallen),
    Extreme("hits the ground at 100 m/s", falling(100.0), scene=GROUND, demand=above),
    Extreme("hits the ground at 1000 m/s", falling(1000.0), scene=GROUND, demand=above),
    Extreme("one point", {"points": (1, 1, 1), **falling(1.0)}, scene=GROUND, demand=above),
    Extreme("a row of points", {"points": (1, 6, 1), **falling(1.0)}, scene=GROUND),
    Extreme("a sheet of points", {"points": (5, 1, 5), **falling(1.0)}, scene=GROUND, demand=above),
    Extreme("10 km from the origin", {"position": (1e4, 0.0, 0.0), "stiffness": 1e4}, demand=undisturbed),
)
