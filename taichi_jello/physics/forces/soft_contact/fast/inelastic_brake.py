"""Jellos too weak for their own speed: what comes into the core of another one is braked as a whole.

Springs of contact, however hard, stop only what touches. Where the springs behind that hold less energy than what comes
has, the rest comes on through its own stopped front. So while points of one are in the core of another one, the two
lose the speed at which they come at each other, as in an impact that is almost inelastic, and turn together as much
as their momentum about each other then asks for: momentum and angular momentum stay as they are, energy only falls.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.search.boxes import TINY
from taichi_jello.physics.forces.soft_contact.search.neighbour_list import Neighbours
from taichi_jello.physics.state import Memory

BOUNCE = 0.1  # of the speed at which they came: with none, what was crushed may come apart on the other side
WHOLE = 4096.0  # times a side's normal is summed, in whole numbers: in whatever order, the sum is the same
AGREE = 0.5  # of a normal: what the mean of the sides is at least where they tell a way
INTO = 0.1  # the cosine of a speed that leads that way, at least
COMPACT, LONG = 1, 2  # what is firm and compact, or not
SLIM = 1e-4  # of a round body's inertia and mass: what has less does not turn


@ti.data_oriented
class Brake:
    """deep[J a + b]: whether one of the jellos a and b is in a core of the other one; any[0]: whether any is;
    sides[J a + b]: the way out of b for a, the sum of normals, but for two compact solids, whose middles tell that, and
    for a sheet with what is thin. What may melt or tear is not braked."""

    def __init__(self, title: str, memory: Memory, near: Neighbours):
        self.near, self.jellos = near, near.jellos
        J, touching = near.jellos, near.touching
        self.firm = memory.table(title, "firm jellos", np.where(touching.compact, COMPACT, ~touching.loose * LONG))
        self.deep = memory.zeros(title, "pairs in a core", (J * J,), whole=True)
        self.any = memory.zeros(title, "any in a core", (1,), whole=True)
        self.sided = 0 < touching.solid < len(touching.nodes) or near.has_lines or touching.has_slender
        if self.sided:
            self.sides = memory.zeros(title, "sides of cores", (J * J, 4), whole=True)
        names = ("centres", "speeds", "spins", "pushes", "turns")
        self.centre, self.speed, self.spin, self.push, self.turn = (
            memory.zeros(title, f"{name} of jellos", (J, 3)) for name in names
        )
        self.inertia = memory.zeros(title, "inertia of jellos", (J, 9))
        self.mass, self.pairs = (
            memory.zeros(title, f"{name} of jellos", (J,)) for name in ("free masses", "braked pairs")
        )

    @ti.func
    def reset(self):
        if self.any[0] == 1:
            for pair in range(self.jellos * self.jellos):
                self.deep[pair] = 0
                if ti.static(self.sided):
                    self.sides[pair] = ti.Vector([0, 0, 0, 0])
            self.any[0] = 0

    @ti.func
    def notice(self, a, b):
        """Jello a has a point in a core of jello b."""
        if self.minds(a, b):
            self.deep[a * self.jellos + b] = self.deep[b * self.jellos + a] = self.any[0] = 1

    @ti.func
    def notice_side(self, a, b, n):
        """The same, and that the point is to leave along n."""
        self.notice(a, b)
        if self.minds(a, b):
            for k in ti.static(range(3)):
                part = ti.cast(ti.round(WHOLE * n[k]), int)
                self.sides[a * self.jellos + b][k] += part
                self.sides[b * self.jellos + a][k] -= part
            self.sides[a * self.jellos + b][3] += 1
            self.sides[b * self.jellos + a][3] += 1

    @ti.func
    def minds(self, a, b):
        return a != b and ti.min(self.firm[a], self.firm[b]) > 0

    @ti.func
    def minds_sides(self, a, b):
        return ti.max(self.firm[a], self.firm[b]) == LONG

    @ti.func
    def brake(self, system, first, last, x, v):
        """At the end of a step, for the share of the particles first … last - 1."""
        any_deep = self.any[0]
        if any_deep:
            system.wait_for_team()  # until all particles are where they are at the end of the step
        from_ = system.share_of(first, self.jellos)
        to = ti.select(any_deep, system.share_of(last, self.jellos), from_)
        for j in range(from_, to):
            self.weigh(system, j, x, v)
        if any_deep:
            system.wait_for_team()
        for j in range(from_, to):
            self.push[j], self.turn[j] = self.all_pushes(j)
        if any_deep:
            system.wait_for_team()
        for i in range(first, ti.select(any_deep, last, first)):
            j, m = self.near.jello[i], self.free(system, i)
            push = self.push[j] + self.turn[j].cross(x[i] - self.centre[j])
            if m > 0.0 and push.norm_sqr() > 0.0:
                if ti.static(system.books):
                    system.ledger.book_impact(i, m, v[i], push)
                v[i] = v[i] + push

    @ti.func
    def free(self, system, i):
        """The mass [kg] of particle i if it can move, else 0."""
        return ti.select(system.particles.inverse_mass(i) > 0.0, system.particles.mass(i), 0.0)

    @ti.func
    def weigh(self, system, j, x, v):
        """The mass, centre, speed, inertia and angular momentum of what is free of jello j, and how many others brake
        it."""
        mass, centre, speed, pairs = ti.cast(0.0, float), 0.0 * x[0], 0.0 * v[0], ti.cast(0.0, float)
        for k in range(self.jellos):
            pairs += ti.cast(self.deep[j * self.jellos + k], float)
        if pairs > 0.0:
            for i in range(self.near.first[j], self.near.first[j + 1]):
                m = self.free(system, i)
                mass += m
                centre += m * x[i]
                speed += m * v[i]
            centre, speed = centre / ti.max(mass, TINY), speed / ti.max(mass, TINY)
            inertia, spin = ti.Matrix.zero(float, 3, 3), 0.0 * v[0]
            for i in range(self.near.first[j], self.near.first[j + 1]):
                arm, m = x[i] - centre, self.free(system, i)
                inertia += m * lever(arm)
                spin += m * arm.cross(v[i] - speed)
            for k in ti.static(range(9)):
                self.inertia[j][k] = inertia[k // 3, k % 3]
            self.centre[j], self.speed[j], self.spin[j] = centre, speed, spin
        self.mass[j], self.pairs[j] = mass, pairs

    @ti.func
    def all_pushes(self, j):
        """By how much [m/s] the centre of jello j, and [rad/s] its turning, is braked by all others in whose core it
        is, or they in its own. Each pair has its share of what both stand."""
        push, turn = 0.0 * self.speed[j], 0.0 * self.speed[j]
        for k in range(self.jellos):
            if self.deep[j * self.jellos + k] == 1 and ti.min(self.mass[j], self.mass[k]) > 0.0:
                way, speed = self.centre[j] - self.centre[k], self.speed[j] - self.speed[k]
                d = speed
                if way.dot(speed) >= 0.0:
                    d = self.deeper(j, k, speed)
                if d.any():
                    lost, whirl = self.lost(j, k, way, speed, d / ti.max(d.norm(), TINY))
                    share = 1.0 / ti.max(self.pairs[j], self.pairs[k])
                    other = self.mass[k] / (self.mass[j] + self.mass[k])
                    push += share * (lost + whirl.cross(other * way))
                    turn += share * whirl
        return push, turn

    @ti.func
    def deeper(self, j, k, speed):
        """The way into jello k that j, beside it at `speed`, goes on by the sides on which they touch, if these agree;
        else zero: the middle of what is thin and drawn round a bar, or through a ring, may have passed the other's."""
        way = 0.0 * speed
        if ti.static(self.sided):
            side = self.sides[j * self.jellos + k]
            for axis in ti.static(range(3)):
                way[axis] = -ti.cast(side[axis], float) / WHOLE
            size = way.norm()
            if size < AGREE * ti.cast(side[3], float) or way.dot(speed) < INTO * size * speed.norm():
                way *= 0.0
        return way

    @ti.func
    def lost(self, j, k, way, speed, d):
        """The impulse that takes from jellos j and k, at `way` from each other, what it can of the energy of the
        `speed` between them: along d, and with a turning of both about their common centre, so that their
        angular momentum stays. Returns what it adds to the speed of j, and that turning."""
        a, b = self.mass[j], self.mass[k]
        reduced = a * b / (a + b)
        inertia = reduced * lever(way)
        for r in ti.static(range(3)):
            for c in ti.static(range(3)):
                inertia[r, c] += self.inertia[j][3 * r + c] + self.inertia[k][3 * r + c]
        arm = reduced * way.cross(d)
        whirl = ti.Vector([0.0, 0.0, 0.0])
        size = ti.max(inertia.trace(), TINY)
        inertia /= size
        if inertia.determinant() > SLIM:
            whirl = -(inertia.inverse() @ arm) / size
        momentum = self.spin[j] + self.spin[k] + reduced * way.cross(speed)
        along = reduced * speed.dot(d) + whirl.dot(momentum)
        weight = reduced + whirl.dot(arm)
        amount = -(1.0 + BOUNCE) * ti.max(0.0, along) / ti.max(weight, SLIM * reduced)
        return amount * b / (a + b) * d, amount * whirl


@ti.func
def lever(arm):
    """The inertia of a unit of mass on an arm."""
    return arm.norm_sqr() * ti.Matrix.identity(float, 3) - arm.outer_product(arm)
