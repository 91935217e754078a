"""The stiff and extreme cases of the stress study, one entry each, and the checks of their ends."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from taichi_jello.physics.colliders.block import Block
from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.physics.colliders.sphere import Sphere
from taichi_jello.run.simulation import Simulation
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene, Solver
from taichi_jello.scene.keyframes import Move
from taichi_jello.scene.region import Region
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies._reference import twisted

STILL = (0.0, 0.0, 0.0)
SOLVER_SHARE = 50  # a method that solves for each step takes one in so many of the steps
MAX_DRIFT, MAX_TREND = 1e-4, 1e-2  # of Σ m |v| and of the energy of a body that turns freely
SHAPE = 1e-3  # of the body's size, by which a recovered shape may differ


def shape_error(body: Body, x: np.ndarray) -> float:
    """RMS distance of x (N, 3) [m] from the rest shape, after the best rigid motion or reflection, over the diagonal of
    the body."""
    a, b = body.rest - body.rest.mean(0), x - x.mean(0)
    u, _, vt = np.linalg.svd(b.T @ a)
    away = b - a @ (u @ vt).T
    return float(np.sqrt((away**2).sum(1).mean()) / (np.linalg.norm(np.ptp(a, 0)) or 1.0))


@dataclass(frozen=True)
class Extreme:
    """A box in a scene whose points x (N, 3) start at `start(x)`. It runs for `seconds`, or so many `steps`. `check`
    gets the simulation at its end and the points at the start, and returns what is wrong, or "". driven: something does
    work on the box, which the energy ledger records."""

    name: str
    box: dict[str, Any]
    start: Callable[[np.ndarray], np.ndarray] = lambda x: x
    scene: dict[str, Any] = field(default_factory=lambda: {"gravity": STILL})
    seconds: float = 0.5
    steps: int = 0
    check: Callable[[Simulation, np.ndarray], str] = lambda simulation, start: ""
    driven: bool = False

    def frames(self, simulation: Simulation) -> int:
        if not self.steps:
            return round(self.seconds / simulation.frame_dt)
        return -(-self.steps // (simulation.substeps * (SOLVER_SHARE if simulation.system.integrator.solves else 1)))

    def simulation(self, **options: Any) -> Simulation:
        box: dict[str, Any] = {"points": (4, 4, 4), "mass": 0.125, "damping": 0.25} | self.box
        return Simulation(Scene(jello=[Box(**box)], **self.scene), ledger=self.driven, **options)


def recovered(simulation: Simulation, start: np.ndarray) -> str:
    error = shape_error(simulation.body, simulation.x)
    return "" if error < SHAPE else f"shape off by {error:.1e}"


def unmoved(simulation: Simulation, start: np.ndarray) -> str:
    moved = float(np.abs(simulation.x - start).max())
    return "" if moved < 1e-4 else f"moved {moved:.1e} m"


def fallen(simulation: Simulation, start: np.ndarray) -> str:
    """In free fall, up to the error of backward Euler, of first order in the step."""
    t = simulation.time
    error = 0.5 * 9.81 * t * simulation.dt + 1e-5
    away = float(np.abs(simulation.x - start - [0.0, -0.5 * 9.81 * t * t, 0.0]).max())
    return "" if away <= error * 1.001 else f"{away:.1e} m from free fall"


def above(simulation: Simulation, start: np.ndarray) -> str:
    """No deeper in the ground than where a contact spring stops a single point of that speed."""
    speed = np.linalg.norm(simulation.start.v, axis=1).max()
    deepest = speed * np.sqrt(simulation.body.mass.max() / simulation.tuning["contact_stiffness"]) + 0.01
    low = float(simulation.x[:, 1].min())
    return "" if low > -deepest else f"{-low:.2g} m below the ground"


def undisturbed(simulation: Simulation, start: np.ndarray) -> str:
    error = shape_error(simulation.body, simulation.x)
    return "" if error < 1e-5 else f"shape off by {error:.1e}: --precision f64"


def not_through(simulation: Simulation, start: np.ndarray) -> str:
    """No point is inside the core of the solid, and the centre is still above it."""
    (solid,) = simulation.scene.collider
    away = np.abs(simulation.x - solid.place(simulation.time))
    if isinstance(solid, Block):
        half = np.array(solid.size) / 2.0
        inside = np.all(away < half - half.min() / 2.0, axis=1)
    else:
        inside = np.linalg.norm(away, axis=1) < solid.thickness / 4.0
    height = simulation.x[:, 1].mean()
    if not inside.any() and height >= solid.place(0.0)[1]:
        return ""
    return f"{inside.sum()} points in a core, the middle at y = {height:.2g} m"


def symmetric(simulation: Simulation, start: np.ndarray) -> str:
    """The upper half mirrors the lower one, and there is no more energy than the work done. XPBD solves one spring
    after the other, and is symmetric only up to its own error, 1 % of the edge here."""
    n = len(start) // 2
    order = np.lexsort((start[:, 2], start[:, 0], np.sign(start[:, 1]), np.abs(start[:, 1]).round(6)))
    pairs = simulation.x[order].reshape(2, 2, n // 2, 3)
    skew = float(np.abs(pairs[:, 0] - pairs[:, 1] * [1.0, -1.0, 1.0]).max())
    gained = sum(simulation.energies().values())  # from none
    if skew > (0.02 if simulation.method == "xpbd" else 1e-3):
        return f"not symmetric: by {skew:.1e} m"
    over = gained - simulation.work["moving colliders"]
    return "" if over <= 0.0 else f"{over:.2g} J more than the work done"


def steady(simulation: Simulation, start: np.ndarray) -> str:
    """Momentum is kept, and with methods of second order and higher energy does not rise. The error of first-order
    methods adds up in a turning body. (So does that of RK2, slowly: at its automatic step a body that turns at ω gains
    6e-4 ω² s of its energy a second, 0.5 % in all here.)"""
    mass, v = simulation.body.mass[:, None], simulation.v.astype(float)
    drift = float(np.linalg.norm((mass * v).sum(0)) / np.sum(mass * np.abs(simulation.start.v)))
    if drift > MAX_DRIFT:
        return f"momentum off by {drift:.1e}"
    now = sum(simulation.energies().values())
    simulation.restore(replace(simulation.start, x=start))
    trend = now / sum(simulation.energies().values()) - 1.0
    return f"energy up by {trend:.1e}" if trend > MAX_TREND and simulation.system.integrator.order > 1 else ""


def falling(speed: float) -> dict[str, Any]:
    return {"position": (0.0, 0.6, 0.0), "velocity": (0.0, -speed, 0.0)}


def closing(side: float) -> Plane:
    """A plane that moves from above (1) or below (-1) to 0.32 m from the centre and back."""
    way = [Move(time=t, offset=(0.0, -side * far, 0.0)) for t, far in ((0.0, 0.0), (0.2, 0.2), (0.3, 0.2), (0.4, 0.0))]
    return Plane(point=(0.0, 0.52 * side, 0.0), normal=(0.0, -side, 0.0), keyframe=way)


GROUND: dict[str, Any] = {"scene": {"collider": [Plane()]}}
SLAB: dict[str, Any] = {
    "scene": {"collider": [Block(center=(0.0, 0.0, 0.0), size=(4.0, 0.05, 4.0))], "gravity": STILL},
    "check": not_through,
}
BALL = {"collider": [Sphere(center=(0.0, 0.0, 0.0), radius=0.03)], "gravity": STILL}
PRESS = {"collider": [closing(1.0), closing(-1.0)], "gravity": STILL}
MIXED = {"stiffness": 1.0, "region": [Region(max=(1.0, 0.5, 1.0), stiffness_factor=1e6)]}
POINT = {"points": (1, 1, 1)}
TURNING = {"points": (2, 2, 2), "spin": (0.01, 0.02, 0.04)}
FREE = {"gravity": STILL, "solver": Solver(frame_dt=0.25)}
CASES = (
    Extreme("all points on one point", {}, lambda x: 0.0 * x),
    Extreme("flat", {}, lambda x: x * [1.0, 0.0, 1.0]),
    Extreme("flat, 1 % thick", {"damping": 1.0}, lambda x: x * [1.0, 0.01, 1.0], seconds=2.0, check=recovered),
    Extreme("random points", {}, lambda x: np.random.default_rng(5).uniform(-0.5, 0.5, x.shape)),
    Extreme("mirrored", {}, lambda x: x * [-1.0, 1.0, 1.0], check=unmoved),
    Extreme("stretched 10 times", {"damping": 1.0}, lambda x: x * [1.0, 10.0, 1.0], seconds=2.0, check=recovered),
    Extreme("twisted by 360°", {}, lambda x: twisted(x, 360.0, 0.0)),
    Extreme("k = 1e-6 N/m", {"stiffness": 1e-6, "damping": 0.0, **falling(0.0)}, **GROUND),
    Extreme("k = 1e8 N/m", {"stiffness": 1e8, **falling(5.0)}, **GROUND, seconds=0.25, check=above),
    Extreme("k = 1e6 N/m", {"stiffness": 1e6, **falling(5.0)}, **GROUND, seconds=0.25, check=above),
    Extreme("k from 1 to 1e6 N/m", {**MIXED, **falling(5.0)}, **GROUND, seconds=0.25),
    Extreme("melted, k = 0", {"stiffness": 0.0, "damping": 0.0}, scene={}, check=fallen),
    Extreme("hits the ground at 100 m/s", falling(100.0), **GROUND, check=above),
    Extreme("hits the ground at 1000 m/s", falling(1000.0), **GROUND, check=above),
    Extreme("hits a slab of 5 cm at 100 m/s", falling(100.0), **SLAB),
    Extreme("hits a slab of 5 cm at 1000 m/s", falling(1000.0), **SLAB),
    Extreme("stiff, hits a slab at 1000 m/s", {"stiffness": 1e6, **falling(1000.0)}, **SLAB, seconds=0.1),
    Extreme("one point hits a ball at 1000 m/s", POINT | falling(1000.0), scene=BALL, seconds=0.1, check=not_through),
    Extreme("crushed between two planes", {}, scene=PRESS, check=symmetric, driven=True),
    Extreme("one point", POINT | falling(1.0), **GROUND, check=above),
    Extreme("a row of points", {"points": (1, 6, 1), **falling(1.0)}, **GROUND),
    Extreme("a sheet of points", {"points": (5, 1, 5), **falling(1.0)}, **GROUND, check=above),
    Extreme("turns for 1e6 steps", TURNING, scene=FREE, steps=1_000_000, check=steady),
    Extreme("10 km from the origin", {"position": (1e4, 0.0, 0.0), "stiffness": 1e4}, check=undisturbed),
)
