"""Which points are near which leaves of trees of boxes over elements, found again only when something moved too far.

A list made with a margin stays right until something has moved by half of it, as in molecular dynamics (Verlet 1967);
see margins.py. Boxes are those along the jello's own axes, which fit it well however it has turned. A list may hold
too much: what it holds beyond the points that touch adds nothing, so no number depends on when it was made.
"""

import numpy as np
import taichi as ti

from taichi_jello.body import Body
from taichi_jello.physics.boxes import box_around, meet
from taichi_jello.physics.boxtree import BoxTree
from taichi_jello.physics.margins import Margins
from taichi_jello.physics.state import ALONE, Memory
from taichi_jello.physics.touching import Touching

ROOM = 40  # places in the lists for each point
ROW = 8  # places in a row of a list: leaves, and in the last one where the next row begins
OWN = 2.5  # distances between the points within which a jello does not touch itself: there its springs hold
LEAST, MOST = 0.4, 0.6  # a margin's usual size, in distances between the points


@ti.data_oriented
class Neighbours(Margins):
    """Point q has listed[q] leaves near it, read one after another by `next` from start[q] on, jello by jello: blocks
    of cells, single triangles or segments, the elements tree_order[tree_first[n]] … tree_order[tree_last[n] - 1].

    Points that have any: busy[0] … busy[state[2] - 1]."""

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
        self.serial = memory.owner.on_cpu and memory.particles < ALONE
        self.rows = ROOM * self.count // ROW
        self.points, self.nodes = table("points", touching.points), table("elements", touching.nodes)
        self.bare, self.skinned = touching.bare, touching.bare < self.count
        if self.skinned:
            self.corners = table("skin corners", touching.corners)
            self.weights = table("skin weights", touching.weights)
        owner = body.jello[touching.nodes[:, 0]]
        self.owner = table("jello of each element", owner)
        tree = BoxTree.of(owner, body.rest[touching.nodes].mean(1), touching.radius > 0.0)
        self.boxes_of_nodes = len(tree.first)
        self.tree_order, self.tree_skip = table("tree: elements", tree.order), table("tree: next nodes", tree.skip)
        self.tree_first, self.tree_last = table("tree: first elements", tree.first), table("tree: ends", tree.last)
        self.tree_start = table("tree: roots", tree.start)
        self.element_box, self.node_box = numbers("boxes", self.elements, 6), numbers("tree: boxes", len(tree.first), 6)
        self.is_found, self.meets_any = zeros("leaves near points", len(tree.first)), zeros("meets any", self.jellos)
        self.met = zeros("jellos that each meets", self.jellos * self.jellos)
        self.state = zeros("stale, rows, busy points", 3)
        self.found, self.start = zeros("found", self.rows * ROW), zeros("start", self.count)
        self.listed, self.busy = zeros("how many found", self.count), zeros("busy points", self.count)
        self.others, self.itself, self.with_self = others, itself, bool(itself.any())
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

    def refresh(self, x: ti.MatrixField, v: ti.MatrixField, t: float, dt: float, frame_dt: float) -> None:
        """Make the lists anew for particles at x that move at v, t seconds after the current frame began."""
        scale = 1.0
        while self._search(x, v, t, dt, frame_dt, scale * LEAST, scale * MOST) > self.rows and scale > 0.01:
            scale *= 0.5
        self.fresh, self.made_at = True, self.frame_start + t

    @ti.kernel
    def _set_clock(self, made: float):
        self.clock[0] = made

    @ti.func
    def at(self, q, x):
        """What the point q has of a field x of the particles."""
        p = x[self.points[q]]
        if ti.static(self.skinned):  # noqa: SIM102
            if q >= self.bare:
                p *= 0.0
                for k in range(8):
                    p += self.weights[q - self.bare][k] * x[self.corners[q - self.bare][k]]
        return p

    @ti.func
    def reach_of(self, q):
        """How far from its way point q may touch before the lists are made again."""
        reach = self.margin[self.points[q]]
        if ti.static(self.skinned):  # noqa: SIM102
            if q >= self.bare:
                for k in range(8):
                    reach = ti.max(reach, self.margin[self.corners[q - self.bare][k]])
        return reach + self.radius[self.jello[self.points[q]]]

    @ti.kernel
    def _search(self, x: ti.template(), v: ti.template(), t: float, dt: float, frame_dt: float, least: float,
                most: float) -> int:  # fmt: skip
        """Returns how many rows the lists have, which may be more than there is room for. Usual margins are between
        `least` and `most` distances between the points."""
        for k in ti.static(range(3)):
            self.state[k] = 0
        ti.loop_config(serialize=self.serial, block_dim=1)
        for j in range(self.jellos):
            self._follow(j, x, v)
        ti.loop_config(serialize=True)
        for _ in range(1):
            self._set_time(t, ti.max(frame_dt, 3.0 * dt))
        ti.loop_config(serialize=self.serial, block_dim=1)
        for j in range(self.jellos):
            self._widen(j, x, v, dt, frame_dt, least, most)
        ti.loop_config(serialize=self.serial, block_dim=64)
        for place in range(self.elements):
            self.element_box[place] = self._box(self.tree_order[place])
        ti.loop_config(serialize=self.serial, block_dim=16)
        for n in range(self.boxes_of_nodes):
            box = self.element_box[self.tree_first[n]]
            low, high = box[:3], box[3:]
            for place in range(self.tree_first[n] + 1, self.tree_last[n]):
                box = self.element_box[place]
                low, high = ti.min(low, box[:3]), ti.max(high, box[3:])
            self.node_box[n], self.is_found[n] = box_around(low, high), 0
        ti.loop_config(serialize=self.serial, block_dim=1)
        for a in range(self.jellos):
            self._meet(a)
        ti.loop_config(serialize=self.serial, block_dim=64)
        for q in range(self.count):
            self._list(q, x)
        return self.state[1]

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
        a, p, reach = self.jello[self.points[q]], self.at(q, x), self.reach_of(q)
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
                if not meet(self.node_box[n], low, high):
                    n = self.tree_skip[n]
                else:
                    if self.tree_skip[n] == n + 1 and self._may_touch(q, n, a == b):
                        place = self._append(q, listed, place, n)
                        listed += place >= 0
                    n += 1
        self.listed[q] = listed
        if listed > 0:
            self.busy[ti.atomic_add(self.state[2], 1)] = q

    @ti.func
    def _may_touch(self, q, n, own):
        """Whether point q may touch any element of leaf n, of its own jello or not."""
        any_may = True
        if ti.static(self.with_self):  # noqa: SIM102 - decided when it is compiled
            if own:
                any_may = False
                for place in range(self.tree_first[n], self.tree_last[n]):
                    any_may = any_may or self.is_apart(q, self.tree_order[place])
        return any_may

    @ti.func
    def is_apart(self, q, e):
        """Whether element e is not of the neighbourhood of point q in its own jello."""
        apart = True
        if ti.static(self.with_self):  # noqa: SIM102
            if self.owner[e] == self.jello[self.points[q]]:
                distance = (self.rest[self.points[q]] - self.rest[self.nodes[e][0]]).norm()
                apart = distance > self.apart[self.owner[e]]
        return apart

    @ti.func
    def _append(self, q, listed, place, n):
        """Add leaf n to the list of point q, which has `listed` until now; returns the place behind it, less than 0
        if there is no room."""
        to = place
        if listed % (ROW - 1) == 0:
            row = ti.atomic_add(self.state[1], 1)
            to = -1
            if row < self.rows:
                to = row * ROW
                if listed == 0:
                    self.start[q] = to
                else:
                    self.found[place] = to
        if to >= 0:
            self.is_found[n], self.found[to] = 1, n
            to += 1
        return to

    @ti.func
    def next(self, place):
        """The leaf at a place of a list, and the next place."""
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
