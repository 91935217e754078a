"""Which cells of other jellos hold a point: first by the boxes around them, then by the cells themselves."""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.search.box_tree import WIDE
from taichi_jello.physics.forces.soft_contact.search.boxes import put_box, which_meet
from taichi_jello.physics.forces.soft_contact.search.closest_point import cell_holds
from taichi_jello.physics.forces.soft_contact.search.neighbour_list import Neighbours
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import FAR
from taichi_jello.physics.state import Memory

AT_HAND = 16  # cells at most that are at hand for a point: if more hold it, the others are left out


@ti.data_oriented
class Inside:
    """Point q, at place[q], is inside the count[q] cells from cells[AT_HAND q] on, jello by jello, when these have been
    collected and sifted, for the particles at `there`. Each of the two is a short loop over the points of its own: with
    what comes of it all in one loop, they take longer."""

    def __init__(self, title: str, memory: Memory, near: Neighbours, there: ti.Field, place: ti.Field):
        self.near, self.there, self.place, self.solid = near, there, place, near.touching.solid
        tree = near.tree
        solid = (tree.skip == np.arange(len(tree.skip)) + 1) & (tree.order[tree.first] < self.solid)
        self.block = memory.table(title, "leaves of cells", np.where(solid, np.cumsum(solid) - 1, -1))
        self.boxes = memory.numbers(title, "boxes of cells", (solid.sum(), 6, WIDE))
        self.cells = memory.zeros(title, "cells at hand", (AT_HAND * near.count,), whole=True)
        self.count = memory.zeros(title, "how many cells", (near.count,), whole=True)

    @ti.func
    def fit(self, n):
        """The boxes of the cells of leaf n as they are now."""
        for k in range(WIDE):
            low, high, place = ti.Vector([FAR, FAR, FAR]), -ti.Vector([FAR, FAR, FAR]), self.near.tree_first[n] + k
            if place < self.near.tree_last[n]:
                nodes = self.near.nodes[self.near.tree_order[place]]
                for corner in ti.static(range(8)):
                    low, high = ti.min(low, self.there[nodes[corner]]), ti.max(high, self.there[nodes[corner]])
            put_box(self.boxes, self.block[n], k, low, high)

    @ti.func
    def collect(self, q):
        """List the cells whose boxes hold a point."""
        p, place, count = self.place[q], self.near.first_place(q), 0
        for _ in range(self.near.listed[q]):
            n, place = self.near.next(place)
            if self.block[n] >= 0:
                holding, cell = which_meet(self.boxes, self.block[n], p, p), self.near.tree_first[n]
                if holding != 0 and count > AT_HAND - WIDE:
                    count = self.sift(q, count)
                while holding != 0:
                    if holding & 1 and count < AT_HAND:
                        self.cells[q * AT_HAND + count] = self.near.tree_order[cell]
                        count += 1
                    holding >>= 1
                    cell += 1
        self.count[q] = count

    @ti.func
    def sift(self, q, count):
        """Keep of the first `count` cells of a point those that hold it. Returns how many."""
        kept = 0
        for c in range(q * AT_HAND, q * AT_HAND + count):
            e = self.cells[c]
            if cell_holds(self.near.nodes[e], self.there, self.place[q]):
                self.cells[q * AT_HAND + kept] = e
                kept += 1
        return kept
