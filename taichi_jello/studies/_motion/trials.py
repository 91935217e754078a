"""The trials of the motion study: how the cube and the ball start, and what is measured."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_jello.run.simulation import Simulation
from taichi_jello.scene.description import Vector
from taichi_jello.studies._motion.bodies import EDGE, LEVEL, CubeAndBall, G, State

FRAME = 1.0 / 60.0  # s
DROP = 1.0  # m
HIGH = 6.0  # m; from here nothing reaches the ground within 1 s
SOFT = 0.1  # factor of the stiffness, which makes it 200 N/m
SLOPE = float(np.radians(10.0))
WEIGHTLESS: Vector = (0.0, 0.0, 0.0)
TILTED: Vector = (G * float(np.sin(SLOPE)), -G * float(np.cos(SLOPE)), 0.0)
MIN_AMPLITUDE = 0.1  # of the first, below which the period is not measured

Figures = dict[str, float | None]


class Run:
    """A running trial. seconds: the duration of the long trials; frames: how many are done."""

    def __init__(self, simulation: Simulation, bodies: CubeAndBall, seconds: float):
        self.simulation, self.bodies, self.seconds, self.frames = simulation, bodies, seconds, 0

    def frame_times(self, seconds: float) -> Iterator[float]:
        """Run for so long; yields the time [s] at the start and after every frame."""
        yield 0.0
        for _ in range(round(seconds / FRAME)):
            self.simulation.frame()
            self.frames += 1
            yield self.frames * FRAME

    def finish(self, seconds: float) -> None:
        for _ in self.frame_times(seconds):
            pass

    def state(self, particles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mass (N,), x and v (N, 3) of these particles now."""
        now = self.simulation.snapshot()
        return self.bodies.body.mass[particles], now.x[particles].astype(float), now.v[particles].astype(float)

    def centre(self, particles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Their centre of mass [m] and its velocity [m/s]."""
        m, x, v = self.state(particles)
        return m @ x / m.sum(), m @ v / m.sum()

    @property
    def angular_momentum(self) -> float:
        """[kg·m²/s] Of the cube, about its centre of mass."""
        m, x, v = self.state(self.bodies.cube)
        return float(np.linalg.norm(m @ np.cross(x - m @ x / m.sum(), v - m @ v / m.sum())))

    @property
    def energy(self) -> float:
        """[J] Kinetic and elastic energy of the soft cube."""
        body, (m, _, v) = self.bodies.body, self.state(self.bodies.cube)
        x, own = self.simulation.snapshot().x.astype(float), self.bodies.cube[body.springs[:, 0]]
        i, j = body.springs[own].T
        extension = np.linalg.norm(x[j] - x[i], axis=1) - body.rest_length[own]
        return float(0.5 * m @ np.sum(v**2, axis=1) + 0.5 * SOFT * body.stiffness[own] @ extension**2)


def rebound(run: Run) -> Figures:
    """The height of the rebound over the height of the drop, both of the cube's centre above that of a weightless cube
    on the plane. The apex follows from the highest frame after the first one that rises; 0 if none does."""
    highest = (0.5 * EDGE, 0.0)
    rises = False
    for _ in run.frame_times(1.5):
        x, v = run.centre(run.bodies.cube)
        rises = rises or v[1] > 0.0
        if rises:
            highest = max(highest, (float(x[1]), float(v[1])))
            if x[1] < highest[0] - 0.1 * DROP:  # it falls again
                break
    y, speed = highest
    return {"rebound": (y + speed**2 / (2.0 * G) - 0.5 * EDGE) / DROP}


def spin(run: Run) -> Figures:
    """|L|/|L₀| at the end; exactly 1 in theory, however the cube swings."""
    before = run.angular_momentum
    run.finish(run.seconds)
    return {"spin": run.angular_momentum / before}


def swing(run: Run) -> Figures:
    """The amplitude √(q² + (q'/ω)²) of the cube's lowest mode, the mean from 0.9 to 1.1 s, over that at the start: 1 in
    theory, apart from some 0.2 % that go into other modes. And the relative error of the period 2π/ω, from the mean
    angle by which q - iq'/ω turns in a frame; None if the swing dies out within two frames."""
    omega, shape = run.bodies.lowest_mode(SOFT)
    rest = run.bodies.raised()[0][run.bodies.cube]
    places = []
    for _ in run.frame_times(1.1):
        _, x, v = run.state(run.bodies.cube)
        places.append(complex(np.sum((x - rest) * shape), -np.sum(v * shape) / omega))
    sizes, turn = np.abs(places), omega * FRAME
    count = int(np.argmax(np.append(sizes, 0.0) < MIN_AMPLITUDE * sizes[0]))
    excess = (np.diff(np.angle(places[:count])) - turn + np.pi) % (2.0 * np.pi) - np.pi
    period = float(turn / (turn + excess.mean()) - 1.0) if len(excess) > 1 else None
    return {"swing": float(sizes[54:].mean() / sizes[0]), "period_off": period}


def energy(run: Run) -> Figures:
    """E/E₀ at the end, of an undamped cube that was stretched; 1 in theory."""
    before = run.energy
    run.finish(run.seconds)
    return {"energy": run.energy / before}


def rolling(run: Run) -> Figures:
    """[m/s²] The ball's acceleration down a slope: a line fitted to its speed from 0.5 to 1 s. Gravity is tilted, not
    the plane."""
    rows = np.array([(time, run.centre(run.bodies.ball)[1][0]) for time in run.frame_times(1.0)])[30:]
    return {"rolling": float(np.polyfit(rows[:, 0], rows[:, 1], 1)[0])}


def fall(run: Run) -> Figures:
    """[m] How much farther than g t²/2 = 4.905 m the cube falls in 1 s."""
    start = run.centre(run.bodies.cube)[0][1]
    run.finish(1.0)
    return {"fall_off": float(start - run.centre(run.bodies.cube)[0][1] - 0.5 * G)}


@dataclass(frozen=True)
class Trial:
    """One motion. tuning: the arguments of `Simulation.tune`; stiffness and damping are factors. figures: the keys of
    what `watch` returns; the first one is drawn."""

    name: str
    tuning: dict[str, Any]
    start: Callable[[CubeAndBall], State]
    watch: Callable[[Run], Figures]
    figures: tuple[str, ...]


USUAL: dict[str, Any] = {"stiffness": 1.0, "damping": 1.0, "gravity": LEVEL, "friction": 0.3}
STIFF_AND_FREE = USUAL | {"stiffness": 10.0, "gravity": WEIGHTLESS}
UNDAMPED_AND_FREE = USUAL | {"stiffness": SOFT, "damping": 0.0, "gravity": WEIGHTLESS}
TRIALS = (
    Trial("rebound", USUAL, lambda bodies: bodies.raised(DROP, HIGH + 2.0), rebound, ("rebound",)),
    Trial("spin", STIFF_AND_FREE, CubeAndBall.spinning, spin, ("spin",)),
    Trial("swing", UNDAMPED_AND_FREE, CubeAndBall.in_lowest_mode, swing, ("swing", "period_off")),
    Trial("energy", UNDAMPED_AND_FREE, CubeAndBall.stretched, energy, ("energy",)),
    Trial(
        "rolling",
        USUAL | {"gravity": TILTED, "friction": 1.0},
        lambda bodies: bodies.raised(HIGH, 0.0),
        rolling,
        ("rolling",),
    ),
    Trial("fall", USUAL, lambda bodies: bodies.raised(HIGH, HIGH), fall, ("fall_off",)),
)
