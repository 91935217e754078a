"""The trials of the study of motion: what is done with its toys, and what is watched of it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_jello.run.simulation import Simulation
from taichi_jello.scene.description import Vector
from taichi_jello.studies._motion.toys import EDGE, LEVEL, G, State, Toys

FRAME = 1.0 / 60.0  # s
DROP = 1.0  # m
HIGH = 6.0  # m: what is up there falls on nothing within 1 s
SOFT = 0.1  # of the stiffness, which makes it 200 N/m
SLOPE = float(np.radians(10.0))
STILL: Vector = (0.0, 0.0, 0.0)
TILTED: Vector = (G * float(np.sin(SLOPE)), -G * float(np.cos(SLOPE)), 0.0)
LEAST = 0.1  # of a swing, below which its period is not looked at

Figures = dict[str, float | None]


class Run:
    """A trial that runs. `seconds`: how long what lasts is followed; `frames`: how many have been made."""

    def __init__(self, simulation: Simulation, toys: Toys, seconds: float):
        self.simulation, self.toys, self.seconds, self.frames = simulation, toys, seconds, 0

    def go(self, seconds: float) -> Iterator[float]:
        """The time [s] at the start and at the end of every frame."""
        yield 0.0
        for _ in range(round(seconds / FRAME)):
            self.simulation.frame()
            self.frames += 1
            yield self.frames * FRAME

    def to_end(self, seconds: float) -> None:
        for _ in self.go(seconds):
            pass

    def of(self, which: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mass (N,), x and v (N, 3) of these particles now."""
        now = self.simulation.snapshot()
        return self.toys.body.mass[which], now.x[which].astype(float), now.v[which].astype(float)

    def centre(self, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Their centre of mass [m], and how fast it moves [m/s]."""
        m, x, v = self.of(which)
        return m @ x / m.sum(), m @ v / m.sum()

    @property
    def angular_momentum(self) -> float:
        """[kg·m²/s] Of the cube, about its centre of mass."""
        m, x, v = self.of(self.toys.cube)
        return float(np.linalg.norm(m @ np.cross(x - m @ x / m.sum(), v - m @ v / m.sum())))

    @property
    def energy(self) -> float:
        """[J] Of the soft cube, apart from gravity: its motion's and its springs'."""
        body, (m, _, v) = self.toys.body, self.of(self.toys.cube)
        x, own = self.simulation.snapshot().x.astype(float), self.toys.cube[body.springs[:, 0]]
        i, j = body.springs[own].T
        longer = np.linalg.norm(x[j] - x[i], axis=1) - body.rest_length[own]
        return float(0.5 * m @ np.sum(v**2, axis=1) + 0.5 * SOFT * body.stiffness[own] @ longer**2)


def rebound(run: Run) -> Figures:
    """The height that the cube comes back to, of the height that it fell: its centre's, above where it would be on the
    plane without weight. The parabola through the highest frame after the first one that rises; 0 if none does."""
    highest = (0.5 * EDGE, 0.0)
    rises = False
    for _ in run.go(1.5):
        x, v = run.centre(run.toys.cube)
        rises = rises or v[1] > 0.0
        if rises:
            highest = max(highest, (float(x[1]), float(v[1])))
            if x[1] < highest[0] - 0.1 * DROP:  # it falls again
                break
    y, speed = highest
    return {"rebound": (y + speed**2 / (2.0 * G) - 0.5 * EDGE) / DROP}


def spin(run: Run) -> Figures:
    """|L|/|L₀| at the end. In truth it stays 1, however the cube swings."""
    before = run.angular_momentum
    run.to_end(run.seconds)
    return {"spin": run.angular_momentum / before}


def swing(run: Run) -> Figures:
    """The amplitude of the cube's lowest swing after 1 s, of that at the start: √(q² + (q'/ω)²) of the mode's
    coordinate q, its mean from 0.9 to 1.1 s. Nothing is damped: in truth it is 1 but for some 0.2 % that go into other
    swings. And by how much its period is too long, of the true one 2π/ω: from the mean angle that q - iq'/ω turns by in
    a frame, until the swing is over; None if that is sooner than two frames."""
    omega, shape = run.toys.lowest(SOFT)
    rest = run.toys.raised(1.0, 1.0)[0][run.toys.cube]
    places = []
    for _ in run.go(1.1):
        _, x, v = run.of(run.toys.cube)
        places.append(complex(np.sum((x - rest) * shape), -np.sum(v * shape) / omega))
    sizes, turn = np.abs(places), omega * FRAME
    lasts = int(np.argmax(np.append(sizes, 0.0) < LEAST * sizes[0]))
    more = (np.diff(np.angle(places[:lasts])) - turn + np.pi) % (2.0 * np.pi) - np.pi
    period = float(turn / (turn + more.mean()) - 1.0) if len(more) > 1 else None
    return {"swing": float(sizes[54:].mean() / sizes[0]), "period_off": period}


def energy(run: Run) -> Figures:
    """E/E₀ at the end, of an undamped cube that was stretched. In truth 1."""
    before = run.energy
    run.to_end(run.seconds)
    return {"energy": run.energy / before}


def rolling(run: Run) -> Figures:
    """[m/s²] How fast the ball gains speed down a slope from 0.5 to 1 s, by the line that fits its speed at every
    frame. It is gravity that is tilted, not the plane."""
    rows = np.array([(time, run.centre(run.toys.ball)[1][0]) for time in run.go(1.0)])[30:]
    return {"rolling": float(np.polyfit(rows[:, 0], rows[:, 1], 1)[0])}


def fall(run: Run) -> Figures:
    """[m] By how much the cube falls too far in 1 s; g t²/2 = 4.905 m is right."""
    start = run.centre(run.toys.cube)[0][1]
    run.to_end(1.0)
    return {"fall_off": float(start - run.centre(run.toys.cube)[0][1] - 0.5 * G)}


@dataclass(frozen=True)
class Trial:
    """One motion: `stiffness` and `damping`, of the toys' own, gravity [m/s²] and friction; x and v at its `start`;
    who watches it; and the figures that are found, the first of which is drawn."""

    name: str
    stiffness: float
    damping: float
    gravity: Vector
    friction: float
    start: Callable[[Toys], State]
    watch: Callable[[Run], Figures]
    finds: tuple[str, ...]

    @property
    def numbers(self) -> dict[str, Any]:
        """For `Simulation.tune`."""
        return {name: getattr(self, name) for name in ("stiffness", "damping", "gravity", "friction")}


TRIALS = (
    Trial("rebound", 1.0, 1.0, LEVEL, 0.3, lambda toys: toys.raised(DROP, HIGH + 2.0), rebound, ("rebound",)),
    Trial("spin", 10.0, 1.0, STILL, 0.3, Toys.spinning, spin, ("spin",)),
    Trial("swing", SOFT, 0.0, STILL, 0.3, Toys.swung, swing, ("swing", "period_off")),
    Trial("energy", SOFT, 0.0, STILL, 0.3, Toys.stretched, energy, ("energy",)),
    Trial("rolling", 1.0, 1.0, TILTED, 1.0, lambda toys: toys.raised(HIGH, 0.0), rolling, ("rolling",)),
    Trial("fall", 1.0, 1.0, LEVEL, 0.3, lambda toys: toys.raised(HIGH, HIGH), fall, ("fall_off",)),
)
