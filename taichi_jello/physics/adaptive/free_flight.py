"""Jellos that touch nothing: as wholes they move as free bodies do, exactly; a step is only for how they deform.

An implicit step slows down whatever turns, the more the farther it turns in one. So the motion of a free jello as a
whole is taken out of its velocities before the step, and the jello is moved on by it afterwards: with its momentum and
angular momentum kept to rounding, falling as g t²/2 says. In the frame that moves with it there are the centrifugal and
the Coriolis force, as they are where the step begins.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.adaptive.rigid_motion import Motion, RigidMotion, cross, turned
from taichi_jello.physics.forces._base import MutualForce
from taichi_jello.physics.forces.gravity import Gravity
from taichi_jello.physics.forces.soft_contact.surface.crossings import meet

LOOKS = 8  # at places on its way, at most, whether it touches something there
HALF = 0.5  # of what is thinnest, and of a radian, from one of these places to the next
MARGIN = 0.01  # of its size, by which a jello keeps away from others


@ti.data_oriented
class FreeFlight:
    """free (J,): the jellos that are not pinned."""

    def __init__(self, system: Any, body: Any, whole: RigidMotion):
        self.system, self.whole, self.owner = system, whole, body.jello
        self.count, self.number = system.count, system.memory.number
        self.free = np.bincount(body.jello, body.pinned) == 0.0
        contacts = [force for force in system.all_forces if force.energy_kind == "contact"]
        self.with_colliders = tuple(force for force in contacts if not isinstance(force, MutualForce))
        self.fall = next((force for force in system.all_forces if isinstance(force, Gravity)), None)
        self.mutual = [force for force in contacts if isinstance(force, MutualForce)]
        known = [*contacts, self.fall]
        self.others = [force for force in system.all_forces if not force.couples and force not in known]
        self.thinnest = min((c.thickness for force in self.with_colliders for c in force.colliders), default=np.inf)

    def gravity(self) -> np.ndarray:
        """(3,) [m/s²]."""
        return np.zeros(3) if self.fall is None else np.array(self.fall.acceleration)

    def may_fly(self, now: Any, t: float, length: float) -> np.ndarray:
        """(J,) which jellos touch nothing at `t` [s] after the frame began, where the state is `now`, and come near to
        no other jello within `length` [s]. None where other forces act than gravity."""
        self.far = self._far(now.whole, now.x, t, length)
        self.alone = self.free & ~self.presses(t)  # by nothing but other jellos, if by anything
        if any(force.acts for force in self.others):
            self.alone[:] = False
        self.near = self._meetings(now.x, now.v, length)
        return self.alone & (self.far | (self._looks(now.whole, length) <= LOOKS)) & ~self.near.any(1)

    def _looks(self, whole: Motion, length: float) -> np.ndarray:
        """(J,) at how many places on its way each must be looked at."""
        spin = np.linalg.norm(whole.spin, axis=1)
        return np.ceil(length * np.maximum(self.whole.speed(whole) / (HALF * self.thinnest), spin / HALF))

    def _far(self, whole: Motion, x: np.ndarray, t: float, length: float) -> np.ndarray:
        """(J,) which jellos no collider comes near to within `length` [s], by their distances from its surface and by
        how far the farthest of their particles are from their centres."""
        gap = np.full((len(self.free), 1), np.inf)
        if self.with_colliders:
            self._gaps(whole.centre.astype(self.number), t, gap)
        arm = np.sqrt(np.maximum.reduceat(((x - whole.centre[self.owner]) ** 2).sum(1), self.whole.first))
        surfaces = max((force.surface_speed for force in self.with_colliders), default=0.0)
        fast = np.linalg.norm(whole.velocity, axis=1) + length * np.linalg.norm(self.gravity()) + surfaces
        return gap[:, 0] > (1.0 + MARGIN) * arm + length * fast

    @ti.kernel
    def _gaps(self, centre: ti.types.ndarray(), t: float, gap: ti.types.ndarray()):
        for j in range(centre.shape[0]):
            p = ti.Vector([centre[j, 0], centre[j, 1], centre[j, 2]])
            for force in ti.static(self.with_colliders):
                gap[j, 0] = ti.min(gap[j, 0], force.gap(p, t))

    def _meetings(self, x: np.ndarray, v: np.ndarray, length: float) -> np.ndarray:
        """(J, J) which jellos' boxes, with the straight ways of their particles, meet; a jello meets itself where it
        can touch itself."""
        if not self.mutual:
            return np.zeros((len(self.free),) * 2, bool)
        surface, first = self.mutual[0].surface, self.whole.first
        there, keeps = x + length * v, surface.touching.shapes.radius + MARGIN * surface.touching.shapes.spacing
        low = np.minimum.reduceat(np.minimum(x, there), first) - keeps[:, None]
        high = np.maximum.reduceat(np.maximum(x, there), first) + keeps[:, None]
        found = meet(low[:, None], high[:, None], low, high)
        np.fill_diagonal(found, surface.itself)
        return found

    def presses(self, t: float) -> np.ndarray:
        """(J,) which jellos a collider presses on where they are, `t` [s] after the frame began."""
        if self.far.all():
            return np.zeros_like(self.free)
        energy = np.zeros(self.count, self.number)
        self._pressed(t, energy)
        return np.add.reduceat(energy, self.whole.first) > 0.0

    @ti.kernel
    def _pressed(self, t: float, energy: ti.types.ndarray()):
        for i in range(self.count):
            for force in ti.static(self.with_colliders):
                energy[i] += force.energy(i, self.system.state.x, t)

    def at_rest(self, x: np.ndarray, v: np.ndarray, whole: Motion, flies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) v without how the jellos that fly move as wholes; and [m/s²] the forces on a kilogram in a frame that
        turns with them, -ω × (ω × ρ) - 2 ω × u, without what would move a jello as a whole."""
        spin, arm = whole.spin[self.owner], x - whole.centre[self.owner]
        u = v - self.whole.field(whole, x)
        push = -cross(spin, cross(spin, arm)) - 2.0 * cross(spin, u)
        push -= self.whole.field(self.whole.of(x, push), x)
        own = flies[self.owner, None]
        return np.where(own, u, v), np.where(own, push, 0.0)

    def straight(self, x: np.ndarray, found: Any) -> Any:
        """What a step from x has found, without the little that the solve has turned it by."""
        slip = self.whole.of(x, found.x - x)
        arm = found.x - found.whole.centre[self.owner]
        return replace(found, x=found.x - cross(slip.spin[self.owner], arm))

    def moved_on(
        self, found: Any, now: Any, turns: np.ndarray, flies: np.ndarray, length: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """x and v, (N, 3) each, of what a step from `now` without that motion has found, with it; `turns` (J, 3, 3) is
        how the jellos turn meanwhile."""
        found = self.straight(now.x, found)
        x = self._place(found, now.whole, turns, flies, length)
        u = np.einsum("nij,nj->ni", turns[self.owner], found.v - self.whole.field(found.whole, found.x))
        new = self.whole.of(x, u)
        spin = np.linalg.solve(new.inertia, now.whole.momentum[..., None])[..., 0]
        velocity = now.whole.velocity + length * self.gravity()
        v = u + velocity[self.owner] + cross(spin[self.owner], x - new.centre[self.owner])
        return np.where(flies[self.owner, None], x, found.x), np.where(flies[self.owner, None], v, found.v)

    def _place(self, shape: Any, whole: Motion, turns: np.ndarray, flies: np.ndarray, time: float) -> np.ndarray:
        """(N, 3) where the particles of a shape are after `time` [s] of that motion, in which it has turned so."""
        centre = whole.centre + time * (whole.velocity + 0.5 * time * self.gravity())
        arm = shape.x - shape.whole.centre[self.owner]
        x = centre[self.owner] + np.einsum("nij,nj->ni", turns[self.owner], arm)
        return np.where(flies[self.owner, None], x, shape.x)

    def kept(self, now: Any, after: Any, flies: np.ndarray, t: float, length: float) -> np.ndarray:
        """(N, 3) the velocities after a step up to `t` [s] from `now`, so that jellos which only each other and gravity
        act on have together the momentum and the angular momentum that they must have: a solve ends at a tolerance."""
        alone, v = self.alone & ~flies, after.v
        if alone.any():
            alone &= ~self.presses(t)
        group, near = np.arange(len(alone)), self.near | np.eye(len(alone), dtype=bool)
        for _ in group:  # the least number of all that hang together
            group = np.where(near, group, len(group)).min(1)
        for g in np.unique(group):
            members = group == g
            if alone[members].all():
                v = self._with_momentum(now, after.x, v, members[self.owner], length)
        return v

    def _with_momentum(self, now: Any, x: np.ndarray, v: np.ndarray, own: np.ndarray, length: float) -> np.ndarray:
        """v with what the particles `own` (N,) had before a free fall of that length."""
        one = RigidMotion.of_one(self.whole.each[own])
        before, after = one.of(now.x[own], now.v[own]), one.of(x[own], v[own])
        faster = before.velocity + length * self.gravity() - after.velocity
        spin = np.linalg.solve(after.inertia, (before.momentum - after.momentum)[..., None])[..., 0]
        v = v.copy()
        v[own] += faster + cross(np.broadcast_to(spin, x[own].shape), x[own] - after.centre)
        return v

    def meets(self, write: Any, now: Any, flies: np.ndarray, t: float, length: float) -> np.ndarray:
        """(J,) which of those that fly come to touch a collider on their way from `t` [s] on, as shaped now.
        Leaves a place on that way in the fields."""
        met, close = np.zeros_like(flies), flies & ~self.far
        if not close.any():
            return met
        looks = max(1, int(self._looks(now.whole, length)[close].max()))
        for part in np.arange(1, looks + 1) / looks:
            write(self._place(now, now.whole, turned(now.whole, part * length), flies, part * length), now.v)
            met = close & self.presses(t + part * length)
            if met.any():
                break
        return met
