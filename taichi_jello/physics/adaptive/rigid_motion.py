"""The rigid motion of each jello: its centre of mass, velocity, spin and inertia; and free rotation (NumPy only)."""

from dataclasses import dataclass

import numpy as np

MIN_INERTIA = 1e-9  # of a jello's inertia: what a rope gets about itself
ISOTROPIC = 1e-4  # of the trace of the inertia: an inertia that deviates less is that of a cube
MAX_TURN, MAX_PARTS = 0.05, 200  # radians in a part of a free rotation, and parts


@dataclass(frozen=True)
class Motion:
    """Of J jellos: centre of mass [m], velocity [m/s], spin [rad/s], angular momentum about the centre [kg m²/s],
    (J, 3) each; inertia (J, 3, 3) [kg m²]."""

    centre: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    momentum: np.ndarray
    inertia: np.ndarray


@dataclass(frozen=True)
class Instant:
    """Particles at x [m] with velocities v [m/s], (N, 3) float64 each, and the rigid motion of each jello."""

    x: np.ndarray
    v: np.ndarray
    whole: Motion


class RigidMotion:
    """Sums over the particles of each jello, in float64."""

    def __init__(self, owner: np.ndarray, each: np.ndarray):
        """owner (N,): the jello of each particle, in ascending order; each (N, 1): its mass [kg]."""
        self.owner, self.each = owner, each
        self.first = np.searchsorted(owner, np.arange(int(owner[-1]) + 1))
        self.mass = np.add.reduceat(self.each, self.first)

    @classmethod
    def of_one(cls, each: np.ndarray) -> "RigidMotion":
        """Of particles that are treated as one jello."""
        return cls(np.zeros(len(each), int), each)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """(J, n) means of values (N, n), weighted by mass."""
        return np.add.reduceat(self.each * values, self.first) / self.mass

    def of(self, x: np.ndarray, v: np.ndarray) -> Motion:
        """The motion of particles at x with velocities v, (N, 3) each."""
        centre, velocity = np.split(self.mean(np.hstack([x, v])), 2, axis=1)
        arm = x - centre[self.owner]
        sums = self.mean(np.hstack([cross(arm, v), (arm[:, :, None] * arm[:, None]).reshape(-1, 9)])) * self.mass
        momentum, products = sums[:, :3], sums[:, 3:].reshape(-1, 3, 3)
        trace = np.trace(products, axis1=1, axis2=2)
        inertia = (1.0 + MIN_INERTIA) * trace[:, None, None] * np.eye(3) - products + 1e-300 * np.eye(3)
        return Motion(centre, velocity, spin_of(inertia, momentum), momentum, inertia)

    def field(self, motion: Motion, x: np.ndarray) -> np.ndarray:
        """(N, 3) [m/s] the velocities that this rigid motion gives particles at x."""
        arm = x - motion.centre[self.owner]
        return motion.velocity[self.owner] + cross(motion.spin[self.owner], arm)

    def speed(self, motion: Motion) -> np.ndarray:
        """(J,) [m/s] root mean square of these velocities."""
        turning = np.einsum("ji,jik,jk->j", motion.spin, motion.inertia, motion.spin) / self.mass[:, 0]
        return np.sqrt((motion.velocity**2).sum(1) + turning)


def spin_of(inertia: np.ndarray, momentum: np.ndarray) -> np.ndarray:
    """(J, 3) ω = I⁻¹ L."""
    return np.linalg.solve(inertia, momentum[..., None])[..., 0]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n, 3) a × b of rows; np.cross takes five times as long for a few hundred."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], 1)


def rotation(vector: np.ndarray) -> np.ndarray:
    """(J, 3, 3) exp([vector]) for rotation vectors (J, 3) [rad], by Rodrigues' formula."""
    half = 0.5 * np.linalg.norm(vector, axis=1)[:, None, None]
    a = np.sinc(half / np.pi)
    W = np.zeros((len(vector), 3, 3))
    for axis in range(3):
        y, z = (axis + 1) % 3, (axis + 2) % 3
        W[:, z, y], W[:, y, z] = vector[:, axis], -vector[:, axis]
    return np.eye(3) + a * np.cos(half) * W + 0.5 * a * a * (W @ W)


def turned(motion: Motion, seconds: float) -> np.ndarray:
    """(J, 3, 3) the rotation of free jellos in that time, by the midpoint rule, in several parts if any inertia is not
    isotropic."""
    trace = np.trace(motion.inertia, axis1=1, axis2=2)[:, None, None]
    isotropic = np.abs(motion.inertia - trace / 3.0 * np.eye(3)).max((1, 2)) <= ISOTROPIC * trace[:, 0, 0]
    angle = np.linalg.norm(motion.spin, axis=1)[~isotropic].max(initial=0.0) * seconds
    parts = max(1, min(MAX_PARTS, int(np.ceil(angle / MAX_TURN))))
    inertia, spin, turns = motion.inertia, motion.spin, np.broadcast_to(np.eye(3), motion.inertia.shape)
    for _ in range(parts):
        half = rotation(0.5 * seconds / parts * spin)
        midway = half @ inertia @ np.swapaxes(half, 1, 2)
        turn = rotation(seconds / parts * spin_of(midway, motion.momentum))
        turns, inertia = turn @ turns, turn @ inertia @ np.swapaxes(turn, 1, 2)
        spin = spin_of(inertia, motion.momentum)
    return turns
