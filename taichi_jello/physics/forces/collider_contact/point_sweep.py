"""Continuous collision detection for points between particles; corrections are distributed to their corners."""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.collider_contact.continuous_collision import Sweep, widen
from taichi_jello.physics.particles import Particles


@ti.data_oriented
class PointSweep(Sweep):
    """Like Sweep, for the points of a SkinContact. To move a point by b, its corners move by b w/Σw², the least-squares
    smallest displacements that do. On each axis a particle takes the largest correction that its points request in
    either direction, and adds the two."""

    def __init__(self, contact: Any, particles: Particles):
        super().__init__(contact, particles, np.ones(len(particles.body), bool))
        # Per particle: the largest and the least displacement, and the largest and the least change of velocity.
        self.wanted = particles.memory.table(contact.title, "corrections", np.zeros((4 * len(particles.body), 3)))

    @ti.func
    def stop(self, system, first, last, x0, x, v, t, dt, drifted: ti.template()):
        system.wait_for_team()  # until x and v of all particles are up to date
        begin, end = system.share_of(first, self.contact.points), system.share_of(last, self.contact.points)
        for cell in range(begin, ti.select(self.fast[0] + self.contact.deep[0] > 0, end, begin)):
            for q in range(self.contact.start[cell], self.contact.start[cell + 1]):
                after, u = self.contact.at_point(q, cell, x), self.contact.at_point(q, cell, v)
                before = after - dt * u if ti.static(drifted) else self.contact.at_point(q, cell, x0)
                hit, time = self.first_entry(0, before, after, t, dt), dt
                if hit[3] > 1.0:
                    before, time = self.way_in(after, t + dt), 0.0
                    hit = self.first_entry(0, before, after, t + dt, 0.0)
                if hit[3] <= 1.0:
                    back, push = self.correction(hit, before, after, u, time)
                    self.share_out(q, cell, back, push)
        system.wait_for_team()  # until all points are tested
        met = self.met[0]
        until = ti.select(met > 0, last, first)
        for i in range(first, until):
            if self.particles.inverse_mass(i) > 0.0:
                push = self.wanted[4 * i + 2] + self.wanted[4 * i + 3]
                if ti.static(system.books):
                    system.ledger.book_impact(i, self.particles.mass(i), v[i], push)
                v[i] = v[i] + push
                x[i] = x[i] + self.wanted[4 * i] + self.wanted[4 * i + 1]
            for row in ti.static(range(4)):
                self.wanted[4 * i + row] = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.whole):
            self.move_wholes(first, until, x)
        self.forget(system, first, last)
        return met

    @ti.func
    def way_in(self, p, t):
        """The nearest surface point if p is deep inside a collider, else p. A point may still be in the core if its
        corners moved by less than it requested."""
        nearest = p
        for group in ti.static(self.groups):
            for r in range(group.start, group.stop):
                touch = self.contact.touch(group.signed_distance, r, p, t)
                if -touch[3] > self.depth:
                    nearest = p - touch[3] * ti.Vector([touch[0], touch[1], touch[2]])
        return nearest

    @ti.func
    def share_out(self, q, cell, back, push):
        """Distribute a point's correction to its corners; in long steps the displacement goes to its whole jello."""
        squares = ti.cast(0.0, float)
        for k in ti.static(range(self.contact.width)):
            squares += self.contact.weight(k, self.contact.skin[q]) ** 2
        for k in ti.static(range(self.contact.width)):
            i, part = self.contact.corners[cell][k], self.contact.weight(k, self.contact.skin[q]) / squares
            if part > 0.0:
                widen(self.wanted, 4 * i + 2, part * push)
                if ti.static(not self.whole):
                    widen(self.wanted, 4 * i, part * back)
        if ti.static(self.whole):
            widen(self.back, 2 * self.jello(self.contact.corners[cell][0]), back)
        self.met[0] = 1
