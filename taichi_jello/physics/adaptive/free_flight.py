"""Jellos that touch nothing: their rigid motion is that of a free body, exactly; a step solves for their deformation.

An implicit step slows down rotation, the more the larger its angle. So the rigid motion of a free jello is subtracted
from its velocities before the step and applied after it: momentum and angular momentum are kept to rounding, and the
fall is g t²/2. The deformation is solved for in a frame that moves with the jello, under the centrifugal and Coriolis
forces at the start of the step.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.adaptive.rigid_motion import Instant, Motion, RigidMotion, cross, spin_of, turned
from taichi_jello.physics.forces._base import MutualForce
from taichi_jello.physics.forces.gravity import Gravity
from taichi_jello.physics.forces.soft_contact.surface.crossings import meet
from taichi_jello.scene.body import Body

MAX_CHECKS = 8  # for contact along the path of a step
PITCH = 0.5  # from one check to the next, of the thinnest collider, and in radians
MARGIN = 0.01  # of its size, by which a jello keeps away from others


@ti.data_oriented
class FreeFlight:
    """free (J,): the jellos without pins. `may_fly` decides which of them fly in a step; the others use its results."""

    def __init__(self, system: Any, body: Body, whole: RigidMotion):
        self.system, self.whole, self.owner = system, whole, body.jello
        self.count, self.number = system.count, system.memory.number
        self.free = np.bincount(body.jello, body.pinned) == 0.0
        contacts = [force for force in system.all_forces if force.energy_kind == "contact"]
        self.with_colliders = tuple(force for force in contacts if not isinstance(force, MutualForce))
        self.mutual = [force for force in contacts if isinstance(force, MutualForce)]
        self.fall = next((force for force in system.all_forces if isinstance(force, Gravity)), None)
        known = [*contacts, self.fall]
        self.others = [force for force in system.all_forces if not force.internal and force not in known]
        self.thinnest = min((c.thickness for force in self.with_colliders for c in force.colliders), default=np.inf)

    def gravity(self) -> np.ndarray:
        """(3,) [m/s²]."""
        return np.zeros(3) if self.fall is None else np.array(self.fall.acceleration)

    def may_fly(self, now: Instant, t: float, length: float) -> np.ndarray:
        """(J,) which jellos touch nothing `t` [s] after the frame began and approach no other jello within `length`
        [s]; none where a force other than gravity acts."""
        self.far = self._far(now, t, length)
        self.alone = self.free & ~self.presses(t)  # jellos that touch at most other jellos
        if any(force.acts for force in self.others):
            self.alone[:] = False
        self.near = self._meetings(now, length)
        return self.alone & (self.far | (self._checks(now.whole, length) <= MAX_CHECKS)) & ~self.near.any(1)

    def _checks(self, whole: Motion, length: float) -> np.ndarray:
        """(J,) how many checks for contact the path of each needs."""
        spin = np.linalg.norm(whole.spin, axis=1)
        return np.ceil(length * np.maximum(self.whole.speed(whole) / (PITCH * self.thinnest), spin / PITCH))

    def _far(self, now: Instant, t: float, length: float) -> np.ndarray:
        """(J,) which jellos cannot reach a collider within `length` [s]: by its distance from their centres, the
        distance of their farthest particle, and their speeds."""
        whole, gap = now.whole, np.full((len(self.free), 1), np.inf)
        if self.with_colliders:
            self._gaps(whole.centre.astype(self.number), t, gap)
        arm = np.sqrt(np.maximum.reduceat(((now.x - whole.centre[self.owner]) ** 2).sum(1), self.whole.first))
        surface_speed = max((force.surface_speed for force in self.with_colliders), default=0.0)
        speed = np.linalg.norm(whole.velocity, axis=1) + length * np.linalg.norm(self.gravity()) + surface_speed
        return gap[:, 0] > (1.0 + MARGIN) * arm + length * speed

    @ti.kernel
    def _gaps(self, centre: ti.types.ndarray(), t: float, gap: ti.types.ndarray()):
        for j in range(centre.shape[0]):
            p = ti.Vector([centre[j, 0], centre[j, 1], centre[j, 2]])
            for force in ti.static(self.with_colliders):
                gap[j, 0] = ti.min(gap[j, 0], force.gap(p, t))

    def _meetings(self, now: Instant, length: float) -> np.ndarray:
        """(J, J) which jellos' boxes around the straight paths of their particles overlap. A jello meets itself if it
        has self-contact."""
        if not self.mutual:
            return np.zeros((len(self.free),) * 2, bool)
        surface, first = self.mutual[0].surface, self.whole.first
        end, keeps = now.x + length * now.v, surface.touching.shapes.radius + MARGIN * surface.touching.shapes.spacing
        low = np.minimum.reduceat(np.minimum(now.x, end), first) - keeps[:, None]
        high = np.maximum.reduceat(np.maximum(now.x, end), first) + keeps[:, None]
        found = meet(low[:, None], high[:, None], low, high)
        np.fill_diagonal(found, surface.itself)
        return found

    def presses(self, t: float) -> np.ndarray:
        """(J,) which jellos touch a collider in the present state, `t` [s] after the frame began."""
        if self.far.all():
            return np.zeros_like(self.free)
        energy = np.zeros(self.count, self.number)
        self._contact_energy(t, energy)
        return np.add.reduceat(energy, self.whole.first) > 0.0

    @ti.kernel
    def _contact_energy(self, t: float, energy: ti.types.ndarray()):
        for i in range(self.count):
            for force in ti.static(self.with_colliders):
                energy[i] += force.energy(i, self.system.state.x, t)

    def at_rest(self, now: Instant, flies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) v without the rigid motion of the jellos that fly; and (N, 3) [m/s²] the centrifugal and Coriolis
        accelerations in their frames, -ω × (ω × ρ) - 2 ω × u, without their rigid part."""
        spin, arm = now.whole.spin[self.owner], now.x - now.whole.centre[self.owner]
        u = now.v - self.whole.field(now.whole, now.x)
        push = -cross(spin, cross(spin, arm)) - 2.0 * cross(spin, u)
        push -= self.whole.field(self.whole.of(now.x, push), now.x)
        own = flies[self.owner, None]
        return np.where(own, u, now.v), np.where(own, push, 0.0)

    def moved_on(
        self, found: Instant, now: Instant, turns: np.ndarray, flies: np.ndarray, length: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) x and v after a step from `now` of the jellos that fly: the shape that the step has `found`, and the
        rigid motion, with its rotation `turns` (J, 3, 3)."""
        own = flies[self.owner, None]
        slip = self.whole.of(now.x, found.x - now.x)  # the small rotation that the solve has made
        shape = found.x - cross(slip.spin[self.owner], found.x - found.whole.centre[self.owner])
        x = np.where(own, self._place(shape, found.whole.centre, now.whole, turns, length), shape)
        u = np.einsum("nij,nj->ni", turns[self.owner], found.v - self.whole.field(found.whole, shape))
        new = self.whole.of(x, u)
        spin = spin_of(new.inertia, now.whole.momentum)
        velocity = now.whole.velocity + length * self.gravity()
        v = u + velocity[self.owner] + cross(spin[self.owner], x - new.centre[self.owner])
        return x, np.where(own, v, found.v)

    def _place(self, x: np.ndarray, centre: np.ndarray, whole: Motion, turns: np.ndarray, time: float) -> np.ndarray:
        """(N, 3) particles of a shape x with that centre after `time` [s] of free rigid motion with this rotation."""
        moved = whole.centre + time * (whole.velocity + 0.5 * time * self.gravity())
        return moved[self.owner] + np.einsum("nij,nj->ni", turns[self.owner], x - centre[self.owner])

    def kept(self, now: Instant, after: Instant, flies: np.ndarray, t: float, length: float) -> np.ndarray:
        """(N, 3) velocities after a step from `now` to `t` [s], with the exact momentum and angular momentum of jellos
        that touch only each other, together: a solve keeps them to its tolerance only."""
        alone, v = self.alone & ~flies, after.v
        if alone.any():
            alone &= ~self.presses(t)
        group, near = np.arange(len(alone)), self.near | np.eye(len(alone), dtype=bool)
        for _ in group:  # connected components, by their smallest index
            group = np.where(near, group, len(group)).min(1)
        for g in np.unique(group):
            members = group == g
            if alone[members].all():
                v = self._with_momentum(now, after.x, v, members[self.owner], length)
        return v

    def _with_momentum(self, now: Instant, x: np.ndarray, v: np.ndarray, own: np.ndarray, length: float) -> np.ndarray:
        """v with the momenta that the particles `own` (N,) have after a free fall of that length [s] from `now`."""
        one = RigidMotion.of_one(self.whole.each[own])
        before, after = one.of(now.x[own], now.v[own]), one.of(x[own], v[own])
        faster = before.velocity + length * self.gravity() - after.velocity
        spin = spin_of(after.inertia, before.momentum - after.momentum)
        v = v.copy()
        v[own] += faster + cross(np.broadcast_to(spin, x[own].shape), x[own] - after.centre)
        return v

    def meets(
        self, write: Callable[[np.ndarray, np.ndarray], None], now: Instant, flies: np.ndarray, t: float, length: float
    ) -> np.ndarray:
        """(J,) which jellos that fly touch a collider on their path from `t` [s] on, undeformed. Leaves a state on that
        path in the fields."""
        met, close = np.zeros_like(flies), flies & ~self.far
        if not close.any():
            return met
        checks = max(1, int(self._checks(now.whole, length)[close].max()))
        for part in np.arange(1, checks + 1) / checks:
            turns = turned(now.whole, part * length)
            x = self._place(now.x, now.whole.centre, now.whole, turns, part * length)
            write(np.where(flies[self.owner, None], x, now.x), now.v)
            met = close & self.presses(t + part * length)
            if met.any():
                break
        return met
