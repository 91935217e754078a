"""Which points are near which leaves of trees of boxes over elements, found again only when something moved too far.

A list made with a margin stays right until something has moved by half of it, as in molecular dynamics (Verlet 1967);
see verlet_margin.py. Boxes are those along the axes of the jello, which fit it however it has turned. A list may hold
too much: what it holds beyond the points that touch adds nothing, so no number depends on when it was made.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.search.box_tree import WIDE, BoxTree
from taichi_jello.physics.forces.soft_contact.search.boxes import box_around, meet, put_box, which_meet
from taichi_jello.physics.forces.soft_contact.search.verlet_margin import Margins
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import FAR, Touching
from taichi_jello.physics.state import Memory
from taichi_jello.scene.body import Body

ROOM = 40  # places in the lists for each point
ROW = 8  # places in a row of a list: leaves, and in the last one where the next row begins
OWN = 2.5  # distances between the points within which a jello does not touch itself: there its springs hold
ROUNDS = 7  # of a search
ONE_STEP = 1.001  # the least time that lists last, in steps
LEAST, MOST, NARROWEST = 0.4, 0.6, 0.01  # a margin: its usual size, in distances between the points; a part of that


@ti.data_oriented
class Neighbours(Margins):
    """Point q has listed[q] leaves near it, read one after another by `next` from first_place(q) on, jello by jello:
    blocks of cells, single triangles or segments, the elements tree_order[tree_first[n]] … tree_order[tree_last[n] -
    1]. A point for which the lists have no room has all leaves. Points that have any: busy[0] … busy[state[2] - 1]."""

    def __init__(self, title: str, body: Body, memory: Memory, touching: Touching, others: bool, itself: np.ndarray):
        """others: whether jellos meet other ones; itself (J,) bool: which meet themselves."""

        def table(name: str, values: np.ndarray) -> ti.Field:
            return memory.table(title, name, values)

        def zeros(name: str, *shape: int) -> ti.Field:
            return memory.zeros(title, name, shape, whole=True)

        def numbers(name: str, *shape: int) -> ti.Field:
            return memory.zeros(title, name, shape)

        super().__init__(title, body, memory, touching)
        self.touching, self.count, self.elements = touching, len(touching.points), len(touching.nodes)
        self.points, self.nodes = table("points", touching.points), table("elements", touching.nodes)
        self.bare, self.skinned = touching.bare, touching.bare < self.count
        self.first_sample = touching.skin
        if self.skinned:
            self.corners = table("skin corners", touching.corners)
            self.weights = table("skin weights", touching.weights)
        owner = body.jello[touching.nodes[:, 0]]
        self.owner = table("jello of each element", owner)
        self.tree = tree = BoxTree.of(owner, body.rest[touching.nodes].mean(1), touching.radius > 0.0)
        self.boxes_of_nodes, self.blocks = len(tree.first), len(tree.leaf)
        leaves = np.flatnonzero(tree.skip == np.arange(len(tree.skip)) + 1)
        self.all_leaves, self.leaves = len(leaves), table("tree: all leaves", leaves)
        self.tree_order, self.tree_skip = table("tree: elements", tree.order), table("tree: next nodes", tree.skip)
        self.tree_first, self.tree_last = table("tree: first elements", tree.first), table("tree: ends", tree.last)
        self.tree_start, self.tree_block = table("tree: roots", tree.start), table("tree: blocks", tree.block)
        self.tree_leaf, self.tree_behind = table("tree: leaves", tree.leaf), table("tree: their ends", tree.behind)
        self.element_box, self.node_box = numbers("boxes", self.elements, 6), numbers("tree: boxes", len(tree.first), 6)
        self.leaf_box = memory.numbers(title, "tree: boxes of leaves", (self.blocks, 6, WIDE))
        self.is_found, self.meets_any = zeros("leaves near points", len(tree.first)), zeros("meets any", self.jellos)
        self.met = zeros("jellos that each meets", self.jellos * self.jellos)
        self.state = zeros("stale, rows, busy points", 3)
        self.listed, self.busy = zeros("how many found", self.count), zeros("busy points", self.count)
        self.has_room = zeros("with a list", self.count)
        self.others, self.itself, self.with_self = others, itself, bool(itself.any())
        self.has_lines = bool((others and touching.rope.sum() > 1) or itself[touching.rope].any())
        self.has_ropes = self.has_lines or (others and bool(touching.rope.any()))
        if self.has_ropes:
            self.is_rope = table("ropes", touching.rope.astype(np.int32))
        self.rows = (2 if self.has_lines else 1) * ROOM * self.count // ROW  # a bundle of ropes has many segments near
        self.found = zeros("found", self.rows * ROW)
        if self.with_self:
            self.alone = table("meets itself", itself.astype(np.int32))
            self.rest = table("rest", body.rest)
            self.apart = table("own neighbourhood", OWN * touching.spacing)
        self.fresh, self.made_at, self.frame_start = False, 0.0, 0.0

    def begin_frame(self, start: float) -> None:
        """Tell the time of the lists by the clock of the frame that begins at `start` [s]."""
        self.frame_start = start
        if self.fresh:
            self._set_clock(self.made_at - start)

    def refresh(self, system: Any, t: float, dt: float, frame_dt: float) -> None:
        """Make the lists anew for the particles as they are t seconds after the current frame began; where they have
        no room, with narrower margins, and for a shorter time, in which what flies by comes near to less."""
        scale, lasts = 1.0, max(frame_dt, 3.0 * dt)
        while (
            self._search(system, system.members, t, dt, frame_dt, lasts, scale * LEAST, scale * MOST) > self.rows
            and scale >= NARROWEST
        ):
            scale *= 0.5
            lasts = max(0.5 * lasts, ONE_STEP * dt)
        self.fresh, self.made_at = True, self.frame_start + t

    @ti.kernel
    def _set_clock(self, made: float):
        self.clock[0] = made

    @ti.func
    def at(self, q, x):
        """What the point q has of a field x of the particles."""
        p = x[self.points[q]]
        if ti.static(self.skinned):
            if q >= self.bare:
                p *= 0.0
                for k in range(8):
                    p += self.weights[q - self.bare][k] * x[self.corners[q - self.bare][k]]
        return p

    @ti.func
    def beside(self, q, k: ti.template()):
        """The point before, for k = 0, or behind point q on its rope; q itself where there is none."""
        r = ti.min(ti.max(q + 2 * k - 1, 0), self.bare - 1)  # particles are numbered along a rope
        return ti.select(q < self.bare and self.jello[self.points[r]] == self.jello[self.points[q]], r, q)

    @ti.func
    def reach_of(self, q, x):
        """How far from its way point q, with half of the segments beside it, may touch before the lists are made
        again."""
        reach = self.margin[self.points[q]]
        if ti.static(self.skinned):
            if q >= self.bare:
                for k in range(8):
                    reach = ti.max(reach, self.margin[self.corners[q - self.bare][k]])
        if ti.static(self.has_lines):
            if self.is_rope[self.jello[self.points[q]]]:
                half = ti.cast(0.0, float)
                for k in ti.static(range(2)):
                    r = self.beside(q, k)
                    reach = ti.max(reach, self.margin[self.points[r]])
                    half = ti.max(half, 0.5 * (self.at(r, x) - self.at(q, x)).norm())
                reach += half
        return reach + self.radius[self.jello[self.points[q]]]

    @ti.kernel
    def _search(
        self,
        system: ti.template(),
        members: int,
        t: float,
        dt: float,
        frame_dt: float,
        lasts: float,
        least: float,
        most: float,
    ) -> int:
        """Done by so many members of a team. Returns how many rows the lists have, which may be more than there is room
        for. They last for `lasts` [s] or longer; usual margins are between `least` and `most` distances between the
        points."""
        if ti.static(system.team == 0):
            for r in ti.static(range(ROUNDS)):
                self._round(r, system, 0, system.count, t, dt, frame_dt, lasts, least, most)
        else:
            system.gather(members)
            ti.loop_config(serialize=system.team == 1, block_dim=1)
            for member in range(members if ti.static(system.team > 1) else 1):
                first, last = system.part_of(member)
                for r in ti.static(range(ROUNDS)):
                    system.wait_for_team()
                    self._round(r, system, first, last, t, dt, frame_dt, lasts, least, most)
        return self.count + self.state[1]

    @ti.func
    def _round(self, r: ti.template(), system, first, last, t, dt, frame_dt, lasts, least, most):
        """Round r of the search, done by everybody before the next one begins; for the share of the particles first …
        last - 1 in everything there is."""
        once = ti.select(first == 0, 1, 0)
        if ti.static(r == 0):
            for j in range(system.share_of(first, self.jellos), system.share_of(last, self.jellos)):
                self._follow(j, system.state.x, system.state.v)
        elif ti.static(r == 1):
            for _ in range(once):
                self._set_time(t, lasts)
                self.state[0], self.state[1], self.state[2] = 0, 0, 0
        elif ti.static(r == 2):
            for j in range(system.share_of(first, self.jellos), system.share_of(last, self.jellos)):
                self._widen(j, system.state.x, system.state.v, dt, frame_dt, least, most)
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
                self._list(q, system.state.x)
        else:
            for q in range(once * self.count):
                if self.listed[q] > 0:
                    self.busy[ti.atomic_add(self.state[2], 1)] = q

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
        i = self.nodes[e][0]
        low, high, reach = self.own_x[i], self.own_x[i], self.margin[i]
        for k in ti.static(range(1, 8)):
            i = self.nodes[e][k]
            low, high, reach = ti.min(low, self.own_x[i]), ti.max(high, self.own_x[i]), ti.max(reach, self.margin[i])
        reach += self.radius[self.owner[e]]
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
        """The jellos that jello a may meet, in ascending order; -1 behind the last one."""
        met, low, high = 0, self.hull[a][:3], self.hull[a][3:]
        for b in range(self.jellos):
            meets = a != b and self.others
            if ti.static(self.with_self):
                meets = meets or (a == b and self.alone[a] == 1)
            way = self.clock[1] * (self.drift[a] - self.drift[b])
            if meets and meet(self.hull[b], low + ti.min(way, 0.0), high + ti.max(way, 0.0)):
                self.met[a * self.jellos + met] = b
                met += 1
        self.meets_any[a] = met > 0
        if met < self.jellos:
            self.met[a * self.jellos + met] = -1

    @ti.func
    def _list(self, q, x):
        """List what is near point q."""
        a, p, reach = self.jello[self.points[q]], self.at(q, x), self.reach_of(q, x)
        listed, place, k = 0, 0, 0
        while k < self.jellos and self.met[a * self.jellos + k] >= 0:
            b = self.met[a * self.jellos + k]
            k += 1
            way = self.clock[1] * (self.drift[a] - self.drift[b])
            n = self.tree_start[b + 1]
            if meet(self.hull[b], p + ti.min(way, 0.0) - reach, p + ti.max(way, 0.0) + reach):
                n = self.tree_start[b]
            here = self.along(b, p - self.centre[b])
            there = here + self.along(b, way)
            low, high = ti.min(here, there) - reach, ti.max(here, there) + reach
            while n < self.tree_start[b + 1]:
                block = self.tree_block[n]
                if block >= 0:
                    near, leaf = which_meet(self.leaf_box, block, low, high), self.tree_leaf[block]
                    while near != 0:
                        if near & 1 and place >= 0 and self._may_touch(q, leaf, a == b):
                            place = self._append(q, listed, place, leaf)
                            listed += 1
                        near >>= 1
                        leaf += 1
                    n = self.tree_skip[n]
                elif meet(self.node_box[n], low, high):
                    n += 1
                else:
                    n = self.tree_skip[n]
        self.listed[q] = ti.select(place < 0, self.all_leaves, listed)
        self.has_room[q] = ti.select(place < 0, 0, 1)
        for leaf in range(ti.select(place < 0, self.all_leaves, 0)):
            self.is_found[self.leaves[leaf]] = 1

    @ti.func
    def _may_touch(self, q, n, own):
        """Whether point q may touch any element of leaf n, of its own jello or not."""
        any_may = True
        if ti.static(self.with_self):
            if own:
                any_may = False
                for place in range(self.tree_first[n], self.tree_last[n]):
                    any_may = any_may or self.is_apart(q, self.tree_order[place])
        return any_may

    @ti.func
    def is_apart(self, q, e):
        """Whether point q meets the jello of element e; of its own all but what is near in the undeformed body."""
        own = self.owner[e] == self.jello[self.points[q]]
        apart = ti.static(self.others) and not own
        if ti.static(self.with_self):
            if own and self.alone[self.owner[e]] == 1:
                distance = (self.rest[self.points[q]] - self.rest[self.nodes[e][0]]).norm()
                apart = distance > self.apart[self.owner[e]]
        return apart

    @ti.func
    def _append(self, q, listed, place, n):
        """Add leaf n to the list of point q, which has `listed` until now; returns the place behind it, less than 0
        if there is no room."""
        to = place
        if listed == 0:
            to = q * ROW
        elif listed % (ROW - 1) == 0:
            row, to = self.count + ti.atomic_add(self.state[1], 1), -1
            if row < self.rows:
                to = row * ROW
                self.found[place] = to
        if to >= 0:
            self.found[to] = n
            if not self.is_found[n]:  # one thread's storing makes the other one wait
                self.is_found[n] = 1
            to += 1
        return to

    @ti.func
    def first_place(self, q):
        """Where the list of point q begins."""
        return ti.select(self.has_room[q] == 1, q * ROW, -1)

    @ti.func
    def next(self, place):
        """The leaf at a place of a list, and the next place; places less than 0 are in the list of all leaves."""
        n, after = 0, place - 1
        if place < 0:
            n = self.leaves[-place - 1]
        else:
            n, after = self.found[place], place + 1
            if after % ROW == ROW - 1:
                after = self.found[after]
        return n, after

    @ti.func
    def watch(self, first, last, x, v, t, dt):
        """Mark the lists as stale if one of the particles first … last - 1 may leave its margin in the next step."""
        for i in range(first, last):
            if self.strays(i, x, v, t, dt):
                self.state[0] = 1
