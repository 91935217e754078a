"""Continuous collision detection: no particle passes through a thin solid within one step.

A thin solid has a core (see `core_entry` in physics/colliders) that no particle enters. Penalty contact acts in the
shell around it, towards the side that the particle came from; what is too fast or pressed too hard reaches the core.
There the impact is inelastic and the particle is put back to that side. An explicit step is so short that this hardly
strains its springs. In an implicit step a stiff jello may move far: then all of it is moved back by the same vector, so
that the springs gain no energy.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.particles import Particles

WAY_LEFT = 0.9  # of the way to the core that a particle keeps: later ones stop behind it, so none are squashed flat
GAP = 0.01  # of a core's depth: how near to it a particle may stop, so that rounding puts none into it
SAFE_WAY = 0.125  # of a core's depth: if no particle moves farther in one step, none can pass before the next frame


@ti.func
def widen(ranges: ti.template(), row, value):
    """Let rows `row`, the largest along each axis, and `row` + 1, the least, cover a vector."""
    for axis in ti.static(range(3)):
        ti.atomic_max(ranges[row][axis], value[axis])
        ti.atomic_min(ranges[row + 1][axis], value[axis])


@ti.data_oriented
class Sweep:
    """The cores of the surfaces of one contact force, for the particles `guarded` (N,) bool.

    `stop` only reads two flags while nothing is fast enough and nothing is pressed in deep. `whole`, for implicit
    steps: test in every step, since one may be a frame long, and move jellos back as wholes.
    """

    def __init__(self, contact: Any, particles: Particles, guarded: np.ndarray):
        memory, body = particles.memory, particles.body
        self.contact, self.particles, self.whole = contact, particles, False
        self.groups = tuple(group for group in contact.groups if group.solid)
        self.depth = 0.25 * min(collider.thickness for collider in contact.colliders)  # of the thinnest one's core
        self.picky, self.several = not bool(guarded.all()), bool(body.jello.any())
        if self.picky:
            padded = np.pad(guarded.astype(np.int32), (0, memory.padded - len(body)))
            self.guarded = memory.table("sweep", "guarded", padded)
        if self.several:
            self.jello_of = memory.table("sweep", "jello", body.jello)
        # Flags: particles are fast; a particle has met a core.
        self.fast, self.met = (memory.table("sweep", name, np.zeros(1, np.int32)) for name in ("fast", "met"))
        # Along each axis the largest correction of a particle of each jello: forwards, and backwards.
        self.jellos = int(body.jello.max()) + 1
        self.back = memory.table("sweep", "back", np.zeros((2 * self.jellos, 3)))
        self._fast = 0

    def check_speed(self, v: np.ndarray, dt: float) -> None:
        """Before steps of dt [s] from velocities v (N, 3) [m/s]: find whether any particle may pass a core in one."""
        speed = float(np.einsum("ij,ij->i", v, v).max()) ** 0.5 + self.contact.surface_speed
        fast = int(self.whole or not speed * dt <= SAFE_WAY * self.depth)
        if fast != self._fast:
            self.fast[0] = self._fast = fast

    @ti.func
    def jello(self, i):
        j = 0
        if ti.static(self.several):
            j = self.jello_of[i]
        return j

    @ti.func
    def first_entry(self, i, a, b, t, dt):
        """Of particle i on its way from a to b from t to t + dt: the normal of the first core that it enters, the
        fraction of the way until then (2 if it enters none) and the velocity of that surface."""
        found, u = ti.Vector([0.0, 0.0, 0.0, 2.0]), ti.Vector([0.0, 0.0, 0.0])
        guarded = 1
        if ti.static(self.picky):
            guarded = self.guarded[i]
        if guarded:
            for group in ti.static(self.groups):
                for r in range(group.start, group.stop):
                    row = self.contact.rows[r]
                    own = ti.Vector([row[3], row[4], row[5]])
                    place = ti.Vector([row[0], row[1], row[2]]) + t * own
                    shape = ti.Vector([row[6], row[7], row[8], row[9]])
                    entry = group.core_entry(a - place, b - place - dt * own, shape)
                    if entry[3] < found[3]:
                        found, u = entry, own
        return ti.Vector([found[0], found[1], found[2], found[3], u[0], u[1], u[2]])

    @ti.func
    def correction(self, hit, before, after, v, dt):
        """By which vector a point goes back to the core it has hit on its way, and how its velocity v changes."""
        n, u = ti.Vector([hit[0], hit[1], hit[2]]), ti.Vector([hit[4], hit[5], hit[6]])
        depth = -(after - before - dt * u).dot(n)
        back = ((1.0 - hit[3]) * depth + ti.max((1.0 - WAY_LEFT) * hit[3] * depth, GAP * self.depth)) * n
        push = -ti.min(0.0, (v - u).dot(n)) * n
        return back, push

    @ti.func
    def stop(self, system, first, last, x0, x, v, t, dt, drifted: ti.template()):
        """Correct the step that took the particles first … last - 1 from x0 to x and v, or, drifted, to x by dt v.
        Returns whether any met a core."""
        until = ti.select(self.fast[0] + self.contact.deep[0] > 0, last, first)
        for i in range(first, until):
            before = x[i] - dt * v[i] if ti.static(drifted) else x0[i]
            hit = self.first_entry(i, before, x[i], t, dt)
            if hit[3] <= 1.0:
                back, push = self.correction(hit, before, x[i], v[i], dt)
                if ti.static(system.books):
                    system.ledger.book_impact(i, self.particles.mass(i), v[i], push)
                v[i] = v[i] + push
                self.met[0] = 1
                if ti.static(self.whole):
                    widen(self.back, 2 * self.jello(i), back)
                else:
                    x[i] = x[i] + back
        system.wait_for_team()  # until all are tested
        met = self.met[0]
        if ti.static(self.whole):
            self.move_wholes(first, ti.select(met > 0, last, first), x)
        self.forget(system, first, last)
        return met

    @ti.func
    def move_wholes(self, first, last, x):
        """Move the particles first … last - 1 as their jellos are corrected."""
        for i in range(first, last):
            if self.particles.inverse_mass(i) > 0.0:
                x[i] = x[i] + self.back[2 * self.jello(i)] + self.back[2 * self.jello(i) + 1]

    @ti.func
    def forget(self, system, first, last):
        system.wait_for_team()  # until nobody needs the flags any more
        for _ in range(1):
            if first == 0 and last > 0:
                self.contact.deep[0] = self.met[0] = 0
                if ti.static(self.whole):
                    for j in range(2 * self.jellos):
                        self.back[j] = ti.Vector([0.0, 0.0, 0.0])
