"""The trials of the motion study: how the cube and the ball start, and what is measured."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_jello.run.snapshot import Snapshot
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
States = Iterator[Snapshot]  # at the start and after each frame


def mean(bodies: CubeAndBall, particles: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(3,) The mass-weighted mean over these particles: of x the centre of mass, of v its velocity."""
    m = bodies.body.mass[particles]
    return np.asarray(m @ values[particles].astype(float) / m.sum())


def angular_momentum(bodies: CubeAndBall, state: Snapshot) -> float:
    """[kg·m²/s] Of the cube, about its centre of mass."""
    m, x, v = bodies.body.mass[bodies.cube], state.x[bodies.cube].astype(float), state.v[bodies.cube].astype(float)
    return float(np.linalg.norm(m @ np.cross(x - m @ x / m.sum(), v - m @ v / m.sum())))


def soft_energy(bodies: CubeAndBall, state: Snapshot) -> float:
    """[J] Kinetic and elastic energy of the soft cube."""
    body, v, x = bodies.body, state.v[bodies.cube].astype(float), state.x.astype(float)
    own = bodies.cube[body.springs[:, 0]]
    i, j = body.springs[own].T
    extension = np.linalg.norm(x[j] - x[i], axis=1) - body.rest_length[own]
    kinetic = 0.5 * body.mass[bodies.cube] @ np.sum(v**2, axis=1)
    return float(kinetic + 0.5 * SOFT * body.stiffness[own] @ extension**2)


def rebound(bodies: CubeAndBall, states: States) -> Figures:
    """The height of the rebound over the height of the drop, both of the cube's centre above that of a weightless cube
    on the plane. The apex follows from the highest frame after the first one that rises; 0 if none does."""
    highest = (0.5 * EDGE, 0.0)
    rises = False
    for state in states:
        x, v = (mean(bodies, bodies.cube, values) for values in (state.x, state.v))
        rises = rises or v[1] > 0.0
        if rises:
            highest = max(highest, (float(x[1]), float(v[1])))
            if x[1] < highest[0] - 0.1 * DROP:  # it falls again
                break
    y, speed = highest
    return {"rebound": (y + speed**2 / (2.0 * G) - 0.5 * EDGE) / DROP}


def spin(bodies: CubeAndBall, states: States) -> Figures:
    """|L|/|L₀| at the end; exactly 1 in theory, however the cube swings."""
    first, *_, last = states
    return {"spin": angular_momentum(bodies, last) / angular_momentum(bodies, first)}


def swing(bodies: CubeAndBall, states: States) -> Figures:
    """The amplitude √(q² + (q'/ω)²) of the cube's lowest mode, the mean from 0.9 to 1.1 s, over that at the start: 1 in
    theory, apart from some 0.2 % that go into other modes. And the relative error of the period 2π/ω, from the mean
    angle by which q - iq'/ω turns in a frame; None if the swing dies out within two frames."""
    omega, shape = bodies.lowest_mode(SOFT)
    rest = bodies.raised()[0][bodies.cube]
    places = []
    for state in states:
        x, v = state.x[bodies.cube].astype(float), state.v[bodies.cube].astype(float)
        places.append(complex(np.sum((x - rest) * shape), -np.sum(v * shape) / omega))
    sizes, turn = np.abs(places), omega * FRAME
    count = int(np.argmax(np.append(sizes, 0.0) < MIN_AMPLITUDE * sizes[0]))
    excess = (np.diff(np.angle(places[:count])) - turn + np.pi) % (2.0 * np.pi) - np.pi
    period = float(turn / (turn + excess.mean()) - 1.0) if len(excess) > 1 else None
    return {"swing": float(sizes[54:].mean() / sizes[0]), "period_off": period}


def energy(bodies: CubeAndBall, states: States) -> Figures:
    """E/E₀ at the end, of an undamped cube that was stretched; 1 in theory."""
    first, *_, last = states
    return {"energy": soft_energy(bodies, last) / soft_energy(bodies, first)}


def rolling(bodies: CubeAndBall, states: States) -> Figures:
    """[m/s²] The ball's acceleration down a slope: a line fitted to its speed from 0.5 to 1 s. Gravity is tilted, not
    the plane."""
    speeds = [mean(bodies, bodies.ball, state.v)[0] for state in states]
    times = np.arange(len(speeds)) * FRAME
    return {"rolling": float(np.polyfit(times[30:], speeds[30:], 1)[0])}


def fall(bodies: CubeAndBall, states: States) -> Figures:
    """[m] How much farther than g t²/2 = 4.905 m the cube falls in 1 s."""
    first, *_, last = (mean(bodies, bodies.cube, state.x)[1] for state in states)
    return {"fall_off": float(first - last - 0.5 * G)}


@dataclass(frozen=True)
class Trial:
    """One motion. tuning: the arguments of `Simulation.tune`; stiffness and damping are factors. measure: takes the
    states at the start and after each frame. figures: the keys of its result; the first one is drawn. seconds: how
    long the trial lasts; None: as long as the study says."""

    name: str
    tuning: dict[str, Any]
    start: Callable[[CubeAndBall], State]
    measure: Callable[[CubeAndBall, States], Figures]
    figures: tuple[str, ...]
    seconds: float | None


USUAL: dict[str, Any] = {"stiffness": 1.0, "damping": 1.0, "gravity": LEVEL, "friction": 0.3}
STIFF_AND_FREE = USUAL | {"stiffness": 10.0, "gravity": WEIGHTLESS}
UNDAMPED_AND_FREE = USUAL | {"stiffness": SOFT, "damping": 0.0, "gravity": WEIGHTLESS}
ON_SLOPE = USUAL | {"gravity": TILTED, "friction": 1.0}
TRIALS = (
    Trial("rebound", USUAL, lambda bodies: bodies.raised(DROP, HIGH + 2.0), rebound, ("rebound",), 1.5),
    Trial("spin", STIFF_AND_FREE, CubeAndBall.spinning, spin, ("spin",), None),
    Trial("swing", UNDAMPED_AND_FREE, CubeAndBall.in_lowest_mode, swing, ("swing", "period_off"), 1.1),
    Trial("energy", UNDAMPED_AND_FREE, CubeAndBall.stretched, energy, ("energy",), None),
    Trial("rolling", ON_SLOPE, lambda bodies: bodies.raised(HIGH, 0.0), rolling, ("rolling",), 1.0),
    Trial("fall", USUAL, lambda bodies: bodies.raised(HIGH, HIGH), fall, ("fall_off",), 1.0),
)
