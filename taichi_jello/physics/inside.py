"""Which cells of other jellos hold a point: first by the boxes around them, then by the cells themselves."""

import taichi as ti

from taichi_jello.physics.boxes import box_around, meet
from taichi_jello.physics.boxtree import WIDE
from taichi_jello.physics.elements import cell_holds
from taichi_jello.physics.neighbours import Neighbours
from taichi_jello.physics.state import Memory
from taichi_jello.physics.touching import FAR

AT_HAND = 16  # cells at most that are at hand for a point: if more hold it, the others are left out


@ti.data_oriented
class Inside:
    """Point q, at place[q], is inside the count[q] cells from cells[AT_HAND q] on, jello by jello, when these have been
    collected and sifted, for the particles at `there`. Each of the two is a short loop over the points of its own: with
    what comes of it all in one loop, they take longer."""

    def __init__(self, title: str, memory: Memory, near: Neighbours, there: ti.Field, place: ti.Field):
        self.near, self.there, self.place, self.solid = near, there, place, near.touching.solid
        self.boxes = memory.zeros(title, "boxes of cells", (len(near.touching.nodes) + WIDE, 6))
        self.leaf_boxes = memory.zeros(title, "boxes of leaves", (near.boxes_of_nodes, 6))
        self.cells = memory.zeros(title, "cells at hand", (AT_HAND * near.count,), whole=True)
        self.count = memory.zeros(title, "how many cells", (near.count,), whole=True)

    @ti.func
    def fit(self, n):
        """The boxes of leaf n and of its cells as they are now."""
        all_low, all_high = ti.Vector([FAR, FAR, FAR]), -ti.Vector([FAR, FAR, FAR])
        for at in range(self.near.tree_first[n], self.near.tree_last[n]):
            nodes = self.near.nodes[self.near.tree_order[at]]
            low = self.there[nodes[0]]
            high = low
            for k in ti.static(range(1, 8)):
                low, high = ti.min(low, self.there[nodes[k]]), ti.max(high, self.there[nodes[k]])
            self.boxes[at] = box_around(low, high)
            all_low, all_high = ti.min(all_low, low), ti.max(all_high, high)
        self.leaf_boxes[n] = box_around(all_low, all_high)

    @ti.func
    def collect(self, q):
        """List the cells whose boxes hold a point."""
        p, place, count = self.place[q], self.near.start[q], 0
        for _ in range(self.near.listed[q]):
            n, place = self.near.next(place)
            if meet(self.leaf_boxes[n], p, p) and self.near.tree_order[self.near.tree_first[n]] < self.solid:
                if count > AT_HAND - WIDE:
                    count = self.sift(q, count)
                first, last, inside = self.near.tree_first[n], self.near.tree_last[n], 0
                for lane in ti.static(range(WIDE)):
                    holds = (first + lane < last) & meet(self.boxes[first + lane], p, p)
                    inside |= ti.cast(holds, int) << lane
                while inside != 0:
                    if inside & 1 and count < AT_HAND:
                        self.cells[q * AT_HAND + count] = self.near.tree_order[first]
                        count += 1
                    inside >>= 1
                    first += 1
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
