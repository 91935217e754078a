"""What presses on each point, in all: its own contacts and those that it is a corner of the touched triangle of."""

import taichi as ti

from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import AT_ONCE
from taichi_jello.physics.state import Memory

SLOTS = 16  # contacts of a point that are listed; if it has more, all contacts are looked through
LOAD = 2.0  # whole contacts that press on one point with full stiffness: its own and one that it is a corner of


@ti.data_oriented
class Loads:
    """For Contacts, which knows what is near and has their corners, weights and shares: list and weight_in, from SLOTS
    q on: the listed[q] contacts that press on point q, in ascending order, and its weight in each: that of its own
    place less that of the place which it touches, own_weight in its own. load: how many, in whole contacts, a corner
    has its share of one."""

    def __init__(self, title: str, memory: Memory, points: int):
        self.load = memory.zeros(title, "loads", (points,))
        self.listed = memory.zeros(title, "listed contacts", (points,), whole=True)
        self.list = memory.zeros(title, "lists", (points * SLOTS,), whole=True)
        self.weight_in = memory.zeros(title, "weights in them", (points * SLOTS,))

    @ti.func
    def enter(self, q, from_, to):
        """List the contacts of point q with those of the points from_ … to - 1 that they press on. (Members of a team
        go through all contacts, each for its own points: what two write to makes both wait.)"""
        for contact in range(q * AT_ONCE, q * AT_ONCE + self.own[q]):
            self.enlist(contact, q, self.own_weight(self.weights[contact]), from_, to)
            for k in ti.static(range(3)):
                if self.weights[contact][k] != 0.0:
                    self.enlist(contact, self.corners[contact][k], -self.weights[contact][k], from_, to)

    @ti.func
    def enlist(self, contact, q, weight, from_, to):
        if from_ <= q < to:
            place = ti.atomic_add(self.listed[q], 1)
            if place < SLOTS:
                self.list[q * SLOTS + place], self.weight_in[q * SLOTS + place] = contact, weight

    @ti.func
    def sort(self, q):
        """Contacts were listed in any order; they are to be gone through in that of their numbers."""
        if self.listed[q] <= SLOTS:
            first = q * SLOTS
            for k in range(first + 1, first + self.listed[q]):
                contact, weight, place = self.list[k], self.weight_in[k], k
                while place > first and self.list[place - 1] > contact:
                    self.list[place], self.weight_in[place] = self.list[place - 1], self.weight_in[place - 1]
                    place -= 1
                self.list[place], self.weight_in[place] = contact, weight
        load = ti.cast(0.0, float)
        for k in range(self.rounds_of(q)):
            contact, g = self.pressing(q, k)
            if g != 0.0:
                load += ti.abs(g) * self.part(contact // AT_ONCE) * self.whole(contact)
        self.load[q] = load / self.part(q)

    @ti.func
    def settle(self, q):
        """A contact counts for less where more press on one of its points than may with full stiffness."""
        for contact in range(q * AT_ONCE, q * AT_ONCE + self.own[q]):
            most = ti.max(self.load[q], LOAD)
            for k in ti.static(range(3)):
                if self.weights[contact][k] != 0.0:
                    most = ti.max(most, self.load[self.corners[contact][k]])
            self.share[contact] = self.share[contact] * (LOAD / most)

    @ti.func
    def weight(self, contact, q):
        g = ti.cast(0.0, float)
        if contact % AT_ONCE < self.own[contact // AT_ONCE]:
            if contact // AT_ONCE == q:
                g += self.own_weight(self.weights[contact])
            for k in ti.static(range(3)):
                if self.corners[contact][k] == q:
                    g -= self.weights[contact][k]
        return g

    @ti.func
    def rounds_of(self, q):
        """How many contacts to go through for point q, see `pressing`."""
        return ti.select(self.listed[q] > SLOTS, AT_ONCE * self.points, self.listed[q])

    @ti.func
    def pressing(self, q, k):
        """The k-th contact that presses on point q, and the point's weight in it, which may be 0."""
        contact, g = k, ti.cast(0.0, float)
        if self.listed[q] <= SLOTS:
            contact, g = self.list[q * SLOTS + k], self.weight_in[q * SLOTS + k]
        else:
            g = self.weight(k, q)
        return contact, g

    @ti.func
    def part(self, q):
        """How much of a particle of the surface the point stands for."""
        part = ti.cast(1.0, float)
        if ti.static(self.near.skinned):
            part = self.parts[q]
        return part
