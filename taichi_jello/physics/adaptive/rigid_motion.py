"""How each jello moves as a whole: its centre, velocity, spin and inertia; and how a free one turns (NumPy only)."""

from dataclasses import dataclass

import numpy as np

from taichi_jello.scene.body import Body

LEAST = 1e-9  # of a jello's inertia: what a rope has about itself
EVEN = 1e-4  # of its inertia, by which it may differ between axes
PART, MOST = 0.05, 200  # radians in one step of a turn, and steps


@dataclass(frozen=True)
class Motion:
    """Of J jellos: centre [m], velocity [m/s], spin [rad/s], momentum about the centre [kg m²/s], (J, 3) each;
    inertia (J, 3, 3) [kg m²]."""

    centre: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    momentum: np.ndarray
    inertia: np.ndarray


class RigidMotion:
    """Sums over the particles of each jello, in float64."""

    def __init__(self, owner: np.ndarray, each: np.ndarray):
        """owner (N,): which jello each particle belongs to, in ascending order; each (N, 1): its mass [kg]."""
        self.owner, self.each = owner, each
        self.first = np.searchsorted(owner, np.arange(int(owner[-1]) + 1))
        self.mass = np.add.reduceat(self.each, self.first)

    @classmethod
    def of_body(cls, body: Body) -> "RigidMotion":
        return cls(body.jello, body.mass[:, None])

    @classmethod
    def of_one(cls, each: np.ndarray) -> "RigidMotion":
        """Of particles that are taken together."""
        return cls(np.zeros(len(each), int), each)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """(J, n) of values (N, n), by mass."""
        return np.add.reduceat(self.each * values, self.first) / self.mass

    def of(self, x: np.ndarray, v: np.ndarray) -> Motion:
        """Of particles at x with velocities v, (N, 3) each."""
        centre, velocity = np.split(self.mean(np.hstack([x, v])), 2, axis=1)
        arm = x - centre[self.owner]
        sums = self.mean(np.hstack([cross(arm, v), (arm[:, :, None] * arm[:, None]).reshape(-1, 9)])) * self.mass
        momentum, products = sums[:, :3], sums[:, 3:].reshape(-1, 3, 3)
        trace = np.trace(products, axis1=1, axis2=2)
        inertia = (1.0 + LEAST) * trace[:, None, None] * np.eye(3) - products + 1e-300 * np.eye(3)
        spin = np.linalg.solve(inertia, momentum[..., None])[..., 0]
        return Motion(centre, velocity, spin, momentum, inertia)

    def field(self, motion: Motion, x: np.ndarray) -> np.ndarray:
        """(N, 3) [m/s] the velocities of particles at x that move as a whole."""
        arm = x - motion.centre[self.owner]
        return motion.velocity[self.owner] + cross(motion.spin[self.owner], arm)

    def speed(self, motion: Motion) -> np.ndarray:
        """(J,) [m/s] of the whole: the root of the mean square over its particles."""
        turning = np.einsum("ji,jik,jk->j", motion.spin, motion.inertia, motion.spin) / self.mass[:, 0]
        return np.sqrt((motion.velocity**2).sum(1) + turning)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n, 3) a × b of rows; np.cross takes five times as long for a few hundred."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], 1)


def rotation(vector: np.ndarray) -> np.ndarray:
    """(J, 3, 3) exp([vector]) for vectors (J, 3) [rad], Rodrigues' formula."""
    half = 0.5 * np.linalg.norm(vector, axis=1)[:, None, None]
    a = np.sinc(half / np.pi)
    W = np.zeros((len(vector), 3, 3))
    for axis in range(3):
        y, z = (axis + 1) % 3, (axis + 2) % 3
        W[:, z, y], W[:, y, z] = vector[:, axis], -vector[:, axis]
    return np.eye(3) + a * np.cos(half) * W + 0.5 * a * a * (W @ W)


def turned(motion: Motion, seconds: float) -> np.ndarray:
    """(J, 3, 3) how jellos without a torque turn in that time: by the midpoint rule, in parts of PART where some do not
    turn evenly as a cube does."""
    trace = np.trace(motion.inertia, axis1=1, axis2=2)[:, None, None]
    even = np.abs(motion.inertia - trace / 3.0 * np.eye(3)).max((1, 2)) <= EVEN * trace[:, 0, 0]
    angle = np.linalg.norm(motion.spin, axis=1)[~even].max(initial=0.0) * seconds
    parts = max(1, min(MOST, int(np.ceil(angle / PART))))
    inertia, spin, turns = motion.inertia, motion.spin, np.broadcast_to(np.eye(3), motion.inertia.shape)
    for _ in range(parts):
        half = rotation(0.5 * seconds / parts * spin)
        midway = half @ inertia @ np.swapaxes(half, 1, 2)
        turn = rotation(seconds / parts * np.linalg.solve(midway, motion.momentum[..., None])[..., 0])
        turns, inertia = turn @ turns, turn @ inertia @ np.swapaxes(turn, 1, 2)
        spin = np.linalg.solve(inertia, motion.momentum[..., None])[..., 0]
    return turns
