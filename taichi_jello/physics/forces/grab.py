"""A hand that holds one point of a jello's surface by a damped spring and pulls it along.

A spring firm enough to hold a jello's weight without a visible sag would shorten the safe step, since it acts on a
few light particles. So the hand has a mass, which makes them heavier and the spring's frequency at most FREQUENCY.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import AddedMass, ParticleForce, Rates, even_block
from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Force, Scene, Vector, number

FREQUENCY = 250.0  # 1/s: the held point settles at the hand's place within a frame
FIRMNESS = 2.0  # of the hand's spring, in typical springs of the body
REACH = 0.5  # of the body's size by which typical springs must stretch to pull as hard as the hand can
SAG = 0.002  # of the body's size: how far below the hand the held point hangs under the weight of all, at most
LIFT = 20.0  # the hand can hold at least this many times the weight of all
CALM = 4.0  # 1/s
MOST = 24  # particles that a hand can hold: the corners of the cells of a triangle of an embedded skin


@dataclass(frozen=True, kw_only=True)
class Grab(Force):
    """Lets a hand take hold of the scene's jellos: see Simulation.grab. stiffness [N/m] of the hand's spring and the
    `limit` [N] of its pull; zero: chosen to suit the body. calm [1/s]: the rate at which the held jello loses its
    motion relative to the hand, so that it comes to rest where the hand holds it."""

    key: ClassVar[str] = "grab"
    stiffness: float = 0.0
    limit: float = 0.0
    calm: float = CALM

    def check(self) -> dict[str, Any]:
        return {name: number(name, getattr(self, name), low=0.0) for name in ("stiffness", "limit", "calm")}


def with_hand(scene: Scene, grab: Grab | None = None) -> Scene:
    """The scene with a hand that can grab its jellos: its own if it has one, else `grab`, by default a Grab()."""
    own = any(isinstance(force, Grab) for force in scene.force)
    return scene if own else replace(scene, force=(*scene.force, grab or Grab()))


@dataclass(frozen=True)
class Held:
    """What the hand holds: the point Σ weights[k] x[particles[k]], which is at `point` (3,) [m]; `target` (3,) [m],
    where the hand is; `force` (3,) [N] of its pull."""

    particles: np.ndarray
    weights: np.ndarray
    target: np.ndarray
    point: np.ndarray
    force: np.ndarray


Grip = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]


@ti.data_oriented
class Hand(ParticleForce):
    """F = k e + c (w - u) on the held point, which moves at u and is e away from the hand that moves at w, never more
    than the limit. Beyond `near` the spring's force is k √(near (2|e| - near)): the point comes in at the speed
    u² = 2a (|e| - near/2), near = 4a/ω², from which a, half the limit over the hand's mass, stops it. Each of up to
    MOST particles gets F, and the hand's mass, times its weight. c is critical for a single particle. All particles of
    the jello also get -m γ (v - w), γ being `calm`."""

    title = "grab"
    works = ("grab",)
    reads_velocity = True
    has_curvature = True
    adds_mass = True

    def __init__(self, grab: Grab, particles: Particles, gravity: Vector, frame_dt: float):
        body = particles.body
        typical = float(np.median(body.stiffness)) if len(body.springs) else 100.0 * float(body.mass.sum())
        size = float(np.ptp(body.x, axis=0).max()) or 1.0
        weight = float(body.mass.sum()) * (float(np.linalg.norm(gravity)) or 9.81)
        self.least_mass = float(body.mass.min())
        self.stiffness = grab.stiffness or max(FIRMNESS * typical, weight / (SAG * size))
        self.own_mass = self.stiffness / FREQUENCY**2
        self.damping = 2.0 * float(np.sqrt(self.stiffness * (self.own_mass + self.least_mass)))
        self.limit = grab.limit or max(REACH * typical * size, LIFT * weight)
        self.near = 2.0 * self.limit / self.stiffness  # 4 a/FREQUENCY², a = limit/(2 own_mass)
        self.number, self.calm, self.particle = particles.memory.number, grab.calm, particles
        self.jello, self.origin = body.jello, particles.origin
        self.several = bool(body.jello.any())
        if self.several:
            self.jello_of = particles.memory.table(self.title, "jello", body.jello)
        # How many particles are held, then which.
        self.held = particles.memory.table(self.title, "particles", np.zeros(1 + MOST, np.int32))
        self.weights_held = particles.memory.table(self.title, "weights", np.zeros(MOST))
        # Rows: the hand's place when the frame begins [m], its velocity [m/s]; the rate of calming and which jello.
        self.hand = particles.memory.table(self.title, "hand", np.zeros((3, 3)))
        self.particles, self.weights = np.zeros(0, np.int32), np.zeros(0)
        self.target = self._from = self._to = np.zeros(3)
        self._frame, self._frame_dt, self._changed = -1.0, frame_dt, True
        self._rows = np.zeros((3, 3), self.number)

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list["Hand"]:
        grabs = [force for force in scene.force if isinstance(force, Grab)]
        return [cls(grab, particles, scene.gravity, scene.solver.frame_dt) for grab in grabs]

    @property
    def holds(self) -> bool:
        return len(self.particles) > 0

    @property
    def acts(self) -> bool:
        return self.holds

    def take(self, particles: np.ndarray, weights: np.ndarray, target: Sequence[float]) -> None:
        """Hold Σ weights x of the given particles from the next frame on."""
        place = np.array(target, float)
        self.grip = np.array(particles, np.int32), np.array(weights, float), place, place, place, self._frame

    @property
    def grip(self) -> Grip:
        """All that begin_frame depends on."""
        return self.particles, self.weights, self.target, self._from, self._to, self._frame

    @grip.setter
    def grip(self, grip: Grip) -> None:
        self.particles, self.weights, self.target, self._from, self._to, self._frame = grip
        self._changed = True

    def let_go(self) -> None:
        self.particles, self.weights, self._changed = np.zeros(0, np.int32), np.zeros(0), True

    def begin_frame(self, start: float, end: float) -> None:
        """The hand moves evenly from its target of the frame before to that of this one."""
        if start != self._frame:
            self._from, self._frame = self._to, start
        self._to = self.target
        if self._changed:
            spare = MOST - len(self.particles)
            self.held.from_numpy(np.pad(np.append(np.int32(len(self.particles)), self.particles), (0, spare)))
            self.weights_held.from_numpy(np.pad(self.weights, (0, spare)).astype(self.number))
            self._rows[2] = (self.calm, self.jello[self.particles[0]], 0.0) if self.holds else (0.0, -1.0, 0.0)
        if self._changed or self.holds:
            self._rows[0], self._rows[1] = self._from - self.origin, (self._to - self._from) / (end - start)
            self._write(self._rows)
            self._changed = False

    @ti.kernel
    def _write(self, rows: ti.types.ndarray()):
        """Ten times faster than from_numpy."""
        for row, column in ti.static(ti.ndrange(3, 3)):
            self.hand[row][column] = rows[row, column]

    @ti.func
    def pull(self, x, v, t):
        """The force [N] on the held point."""
        p, u = ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0])
        for k in range(self.held[0]):
            p += self.weights_held[k] * x[self.held[1 + k]]
            u += self.weights_held[k] * v[self.held[1 + k]]
        place, velocity = self.hand[0] + t * self.hand[1], self.hand[1]
        e = place - p
        far = ti.max(self.near, e.norm())
        force = self.stiffness * ti.sqrt(self.near * (2.0 * far - self.near)) / far * e + self.damping * (velocity - u)
        return force * ti.min(1.0, self.limit / (force.norm() + 1e-20))

    @ti.func
    def share(self, i):
        """The weight of particle i in the held point."""
        share = ti.cast(0.0, float)
        for k in range(self.held[0]):
            if i == self.held[1 + k]:
                share += self.weights_held[k]
        return share

    @ti.func
    def calming(self, i):
        """m γ of particle i [kg/s], zero if it is not of the held jello."""
        rate = self.hand[2][0]
        if ti.static(self.several):
            if self.jello_of[i] != int(self.hand[2][1]):
                rate = 0.0
        return rate * self.particle.mass(i)

    @ti.func
    def curvature(self, i, x, v, t, h):
        """The weights sum to one, so the matrix k w wᵀ is at most the diagonal one with k w."""
        pull = self.share(i) * (self.stiffness + self.damping / h)
        return even_block(pull + self.calming(i) / h)

    @ti.func
    def on(self, i, x, v, t):
        return self.calming(i) * (self.hand[1] - v[i])

    @ti.func
    def added_mass(self, i):
        return self.share(i) * self.own_mass

    @ti.func
    def on_held(self, i, x, v, t):
        return self.share(i) * self.pull(x, v, t)

    @ti.func
    def accelerate(self, first, last, x, v, t, a):
        """(m a + w F) / (m + w M) for a particle of weight w; nothing moves a pinned one."""
        for k in range(MOST):
            i = self.held[1 + k]
            if k < self.held[0] and first <= i and i < last:
                weight = self.weights_held[k] * self.particle.inverse_mass(i)
                a[i] = (a[i] + weight * self.pull(x, v, t)) / (1.0 + weight * self.own_mass)

    @ti.func
    def powers(self, i, x, v, t):
        return ti.Vector([(self.on(i, x, v, t) + self.on_held(i, x, v, t)).dot(v[i])])

    def rates(self) -> Rates:
        """The weights sum to one, so k w wᵀ is at most the diagonal matrix k w, as the hand's mass is M w."""
        if not self.holds:
            return Rates()
        added = AddedMass(self.stiffness, self.damping, self.own_mass, self.least_mass)
        return Rates(damping=self.calm, damping_time=self.damping / self.stiffness, added_mass=added)

    def now(self, x: np.ndarray, v: np.ndarray) -> Held:
        """What is held, with the particles at x (N, 3) [m] and moving at v (N, 3) [m/s]."""
        who, weights = self.particles, self.weights
        point, speed = weights @ x[who], (self._to - self._from) / self._frame_dt - weights @ v[who]
        e = self.target - point
        far = max(self.near, float(np.linalg.norm(e)))
        force = self.stiffness * np.sqrt(self.near * (2.0 * far - self.near)) / far * e + self.damping * speed
        return Held(who, weights, self.target, point, force * min(1.0, self.limit / (np.linalg.norm(force) + 1e-20)))
