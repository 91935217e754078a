"""Broad phase: which points are near which leaves of the box trees, found again only when something moved too far.

A list made with a margin stays right until something has left it, as in molecular dynamics (Verlet 1967); see
verlet_margin.py. Boxes lie along the axes of the jello, which fit it however it has turned. What a list holds beyond
the points that touch adds nothing, so no number depends on when it was made.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.search.box_tree import WIDE, BoxTree
from taichi_jello.physics.forces.soft_contact.search.boxes import box_around, meet, put_box, which_meet
from taichi_jello.physics.forces.soft_contact.search.verlet_margin import Margins
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import FAR
from taichi_jello.physics.forces.soft_contact.surface.surface_fields import SurfaceFields
from taichi_jello.physics.state import Memory
from taichi_jello.scene.body import Body

SLOTS_PER_POINT = 40  # leaves that a list has room for
ROUNDS = 7  # of a search
ONE_STEP = 1.001  # steps that lists last at least
MIN_MARGIN, MAX_MARGIN = 0.4, 0.6  # usual margins, in point spacings
NARROWEST = 0.01  # part of these
STALE, FULL, BUSY = range(3)  # places in NeighbourList.state


@ti.data_oriented
class NeighbourList:
    """Point q has listed[q] leaves near it, leaf(q, 0) and so on, jello by jello. Leaf n is a block of cells, or one
    triangle or segment: the elements tree_order[tree_first[n]] … tree_order[tree_last[n] - 1]. A point whose list is
    full has all leaves. Points that have any: busy[0] … busy[state[BUSY] - 1]. state[STALE]: whether the lists must be
    made again before the next step; state[FULL]: whether a list is full."""

    def __init__(self, title: str, body: Body, memory: Memory, surface: SurfaceFields, frame_dt: float):
        def table(name: str, values: np.ndarray) -> ti.Field:
            return memory.table(title, name, values)

        def zeros(name: str, *shape: int) -> ti.Field:
            return memory.zeros(title, name, shape, whole=True)

        self.surface, self.frame_dt, touching = surface, frame_dt, surface.touching
        self.jellos, self.count, self.elements = surface.jellos, surface.count, surface.elements
        self.margins = Margins(title, body, memory, surface, frame_dt)
        owner, middle = body.jello[touching.nodes[:, 0]], body.rest[touching.nodes].mean(1)
        self.tree = tree = BoxTree.of(owner, middle, touching.shapes.radius > 0.0)
        self.boxes_of_nodes, self.blocks = len(tree.first), len(tree.leaf)
        leaves = np.flatnonzero(tree.is_leaf)
        self.all_leaves, self.leaves = len(leaves), table("tree: all leaves", leaves)
        self.tree_order, self.tree_skip = table("tree: elements", tree.order), table("tree: next nodes", tree.skip)
        self.tree_first, self.tree_last = table("tree: first elements", tree.first), table("tree: ends", tree.last)
        self.tree_start, self.tree_block = table("tree: roots", tree.start), table("tree: blocks", tree.block)
        self.tree_leaf, self.tree_behind = table("tree: leaves", tree.leaf), table("tree: their ends", tree.behind)
        self.element_box = memory.zeros(title, "boxes", (self.elements, 6))
        self.node_box = memory.zeros(title, "tree: boxes", (self.boxes_of_nodes, 6))
        self.leaf_box = memory.numbers(title, "tree: boxes of leaves", (self.blocks, 6, WIDE))
        self.is_found, self.meets_any = (
            zeros("leaves near points", self.boxes_of_nodes),
            zeros("meets any", self.jellos),
        )
        self.meets = zeros("jellos that meet", self.jellos * self.jellos)
        self.state = zeros("stale, full, busy points", 3)
        self.listed, self.busy = zeros("how many found", self.count), zeros("busy points", self.count)
        self.slots = (2 if surface.has_rope_pairs else 1) * SLOTS_PER_POINT  # a bundle of ropes has many segments near
        self.found = zeros("found", self.slots * self.count)
        self.fresh, self.made_at, self.frame_start = False, 0.0, 0.0

    def begin_frame(self, start: float) -> None:
        """Set the clock of the lists back to the frame that begins at `start` [s]."""
        self.frame_start = start
        if self.fresh:
            self._set_clock(self.made_at - start)

    def refresh(self, system: Any, t: float, dt: float) -> None:
        """Make the lists anew for the particles as they are at t [s] of the frame, for steps of dt [s]. Where there is
        no room, with narrower margins and for a shorter time, in which less flies by."""
        scale, lasts = 1.0, max(self.frame_dt, 3.0 * dt)
        while (
            self._search(system, system.members, t, dt, lasts, scale * MIN_MARGIN, scale * MAX_MARGIN)
            and scale >= NARROWEST
        ):
            scale *= 0.5
            lasts = max(0.5 * lasts, ONE_STEP * dt)
        self.fresh, self.made_at = True, self.frame_start + t

    @ti.kernel
    def _set_clock(self, made: float):
        self.margins.clock[0] = made

    @ti.kernel
    def _search(
        self, system: ti.template(), members: int, t: float, dt: float, lasts: float, least: float, most: float
    ) -> int:
        """By so many members of a team. The lists last for `lasts` [s] or longer; usual margins are between `least` and
        `most` point spacings. Returns whether a list is full."""
        if ti.static(system.team == 0):
            for r in ti.static(range(ROUNDS)):
                self._round(r, system, 0, system.count, t, dt, lasts, least, most)
        else:
            system.gather(members)
            ti.loop_config(serialize=system.team == 1, block_dim=1)
            for member in range(members if ti.static(system.team > 1) else 1):
                first, last = system.part_of(member)
                for r in ti.static(range(ROUNDS)):
                    system.wait_for_team()
                    self._round(r, system, first, last, t, dt, lasts, least, most)
        return self.state[FULL]

    @ti.func
    def _round(self, r: ti.template(), system, first, last, t, dt, lasts, least, most):
        """Round r of the search, which all members finish before the next one begins; by the member whose particles
        are first … last - 1, for its share of everything."""
        x, v = ti.static(system.state.x, system.state.v)
        once = ti.select(first == 0, 1, 0)
        if ti.static(r == 0):
            for j in range(system.share_of(first, self.jellos), system.share_of(last, self.jellos)):
                self.margins.measure(j, x, v)
        elif ti.static(r == 1):
            for _ in range(once):
                self.margins.set_clock(t, lasts)
                self.state[STALE], self.state[FULL], self.state[BUSY] = 0, 0, 0
        elif ti.static(r == 2):
            for j in range(system.share_of(first, self.jellos), system.share_of(last, self.jellos)):
                self.margins.widen(j, x, v, dt, least, most)
        elif ti.static(r == 3):
            for place in range(system.share_of(first, self.elements), system.share_of(last, self.elements)):
                self.element_box[place] = self._box(self.tree_order[place])
            for a in range(system.share_of(first, self.jellos), system.share_of(last, self.jellos)):
                self._meet(a)
        elif ti.static(r == 4):
            for b in range(system.share_of(first, self.blocks), system.share_of(last, self.blocks)):
                self._fit(b)
            for n in range(system.share_of(first, self.boxes_of_nodes), system.share_of(last, self.boxes_of_nodes)):
                if self.tree_block[n] < 0 and self.tree_skip[n] > n + 1:
                    low, high = self._all_of(n)
                    self.node_box[n] = box_around(low, high)
        elif ti.static(r == 5):
            for q in range(system.share_of(first, self.count), system.share_of(last, self.count)):
                self._list(q, x)
        else:
            for q in range(once * self.count):
                if self.listed[q] > 0:
                    self.busy[ti.atomic_add(self.state[BUSY], 1)] = q

    @ti.func
    def _fit(self, block):
        """The boxes of the leaves of a block."""
        for k in range(WIDE):
            leaf, low, high = self.tree_leaf[block] + k, ti.Vector([FAR, FAR, FAR]), -ti.Vector([FAR, FAR, FAR])
            if leaf < self.tree_behind[block]:
                low, high = self._all_of(leaf)
                self.is_found[leaf] = 0
            put_box(self.leaf_box, block, k, low, high)

    @ti.func
    def _box(self, e):
        """The box of element e along the axes of its jello, with its margin."""
        nodes = self.surface.nodes[e]
        low, high, reach = self.margins.own_x[nodes[0]], self.margins.own_x[nodes[0]], self.margins.margin[nodes[0]]
        for k in ti.static(range(1, 8)):
            x = self.margins.own_x[nodes[k]]
            low, high, reach = ti.min(low, x), ti.max(high, x), ti.max(reach, self.margins.margin[nodes[k]])
        reach += self.surface.radius[self.surface.owner[e]]
        return box_around(low - reach, high + reach)

    @ti.func
    def _all_of(self, n):
        """The corners of the box of node n."""
        box = self.element_box[self.tree_first[n]]
        low, high = box[:3], box[3:]
        for place in range(self.tree_first[n] + 1, self.tree_last[n]):
            box = self.element_box[place]
            low, high = ti.min(low, box[:3]), ti.max(high, box[3:])
        return low, high

    @ti.func
    def _meet(self, a):
        """Find which jellos jello a may meet."""
        hull, any_meets = self.margins.hull[a], 0
        for b in range(self.jellos):
            meets = a != b and self.surface.others
            if ti.static(self.surface.with_self):
                meets = meets or (a == b and self.surface.alone[a] == 1)
            way = self.margins.travel(a, b)
            meets = meets and meet(self.margins.hull[b], hull[:3] + ti.min(way, 0.0), hull[3:] + ti.max(way, 0.0))
            self.meets[a * self.jellos + b] = meets
            if meets:
                any_meets = 1
        self.meets_any[a] = any_meets

    @ti.func
    def _reach(self, q, x):
        """How far from its way point q, with half of the rope segments beside it, may touch while the lists last."""
        margin = ti.static(self.margins.margin)
        reach = margin[self.surface.points[q]]
        if ti.static(self.surface.blended):
            if q >= self.surface.bare:
                for k in range(8):
                    reach = ti.max(reach, margin[self.surface.corners[q - self.surface.bare][k]])
        if ti.static(self.surface.has_rope_pairs):
            if self.surface.is_rope[self.surface.jello_of(q)]:
                half = ti.cast(0.0, float)
                for k in ti.static(range(2)):
                    r = self.surface.beside(q, k)
                    reach = ti.max(reach, margin[self.surface.points[r]])
                    half = ti.max(half, 0.5 * (self.surface.at(r, x) - self.surface.at(q, x)).norm())
                reach += half
        return reach + self.surface.radius[self.surface.jello_of(q)]

    @ti.func
    def _list(self, q, x):
        """List what is near point q."""
        a, p, reach = self.surface.jello_of(q), self.surface.at(q, x), self._reach(q, x)
        listed = 0
        for b in range(self.jellos):
            if self.meets[a * self.jellos + b]:
                way, n = self.margins.travel(a, b), self.tree_start[b + 1]
                if meet(self.margins.hull[b], p + ti.min(way, 0.0) - reach, p + ti.max(way, 0.0) + reach):
                    n = self.tree_start[b]
                here = self.margins.along(b, p - self.margins.centre[b])
                there = here + self.margins.along(b, way)
                low, high = ti.min(here, there) - reach, ti.max(here, there) + reach
                while n < self.tree_start[b + 1]:
                    block = self.tree_block[n]
                    if block >= 0:
                        near, leaf = which_meet(self.leaf_box, block, low, high), self.tree_leaf[block]
                        while near != 0:
                            if near & 1 and self._may_touch(q, leaf, a == b):
                                if listed < self.slots:
                                    self.found[q * self.slots + listed] = leaf
                                if not self.is_found[leaf]:  # a store by one thread makes the others wait
                                    self.is_found[leaf] = 1
                                listed += 1
                            near >>= 1
                            leaf += 1
                        n = self.tree_skip[n]
                    elif meet(self.node_box[n], low, high):
                        n += 1
                    else:
                        n = self.tree_skip[n]
        if listed > self.slots:
            self.state[FULL] = 1
            listed = self.all_leaves
            for leaf in range(self.all_leaves):
                self.is_found[self.leaves[leaf]] = 1
        self.listed[q] = listed

    @ti.func
    def _may_touch(self, q, n, own):
        """Whether point q may touch any element of leaf n, of its own jello or not."""
        any_may = True
        if ti.static(self.surface.with_self):
            if own:
                any_may = False
                for place in range(self.tree_first[n], self.tree_last[n]):
                    any_may = any_may or self.surface.may_meet(q, self.tree_order[place])
        return any_may

    @ti.func
    def leaf(self, q, k):
        """Number k of the leaves near point q."""
        leaf = self.found[q * self.slots + ti.min(k, self.slots - 1)]
        if self.listed[q] > self.slots:
            leaf = self.leaves[k]
        return leaf

    @ti.func
    def watch(self, first, last, x, v, t, dt):
        """Mark the lists as stale if one of the particles first … last - 1 may leave its margin in the next step."""
        for i in range(first, last):
            if self.margins.strays(i, x, v, t, dt):
                self.state[STALE] = 1
