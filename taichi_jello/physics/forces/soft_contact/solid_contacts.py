"""Narrow phase for solids: the cells that hold a point, and the place on the surface by which it leaves them.

A point leaves by the nearest of the triangles by which its cell is left through the undeformed body (the idea of
McAdams et al. 2011, "Efficient elasticity for character skinning", 5), so that a point deep inside leaves by the
nearest face however the body is crushed. By that alone, two jellos that overlap by half hold each other: half of the
points leave on either side. So where both are compact, and the nearest face leads against the way from the middle of
one to that of the other, this way decides.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.contacts import Contacts
from taichi_jello.physics.forces.soft_contact.fast.inelastic_brake import Brake
from taichi_jello.physics.forces.soft_contact.search.box_tree import WIDE
from taichi_jello.physics.forces.soft_contact.search.boxes import TINY, put_box, which_meet
from taichi_jello.physics.forces.soft_contact.search.closest_point import cell_holds, nearer
from taichi_jello.physics.forces.soft_contact.search.neighbour_list import NeighbourList
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import FAR
from taichi_jello.physics.state import Memory

COINCIDENT = 1e-9  # m, a distance that has no direction to rely on
SAME_SIDE = 0.5  # the cosine above which a face is on the same side as the point that would leave by it
OVER_AN_EDGE = 1 / 3  # of the way to the face to leave by: a point this near to a face on its own side leaves by that
LEAST_COSINE = 0.05  # between a direction and the way from middle to middle that it leads along, or against
LEAST_SHARE = 0.002  # of a contact of two compact jellos: else those with coplanar sides would stay in each other
BETWEEN = 0.5  # of a core's depth, at which a thin jello is in it: it may be deeper between its points


@ti.data_oriented
class SolidContacts:
    """boxes: the world boxes of the cells of each leaf, number block[leaf]. intact, brake: see ThinContacts."""

    def __init__(
        self,
        title: str,
        memory: Memory,
        contacts: Contacts,
        near: NeighbourList,
        brake: Brake | None,
        intact: ti.Field | None,
    ):
        self.contacts, self.near, self.brake, self.intact = contacts, near, brake, intact
        self.brakes, self.tears = brake is not None, intact is not None
        self.surface, self.ahead, self.place = contacts.surface, contacts.ahead, contacts.place
        touching, tree = self.surface.touching, near.tree
        solid = tree.is_leaf & (tree.order[tree.first] < touching.solid)
        self.block = memory.table(title, "leaves of cells", np.where(solid, np.cumsum(solid) - 1, -1))
        self.boxes = memory.numbers(title, "boxes of cells", (solid.sum(), 6, WIDE))
        self.exits, self.way = memory.table(title, "exits", touching.exits), memory.table(title, "ways", touching.way)
        self.start = memory.table(title, "exits of groups", touching.start)
        self.triangles = memory.table(title, "exit triangles", touching.triangles)
        self.inner = memory.table(title, "inner neighbours", touching.inner)
        self.core = memory.table(title, "cores", touching.shapes.core)
        self.some_compact = bool(np.count_nonzero(touching.shapes.compact) > 1)
        if self.some_compact:
            self.compact = memory.table(title, "compact", touching.shapes.compact.astype(np.int32))
            self.middle = memory.table(title, "middles", touching.shapes.middle)

    @ti.func
    def fit(self, leaf):
        """Fit the boxes of the cells of a leaf."""
        for k in range(WIDE):
            low, high, place = ti.Vector([FAR, FAR, FAR]), -ti.Vector([FAR, FAR, FAR]), self.near.tree_first[leaf] + k
            if place < self.near.tree_last[leaf]:
                nodes = self.surface.nodes[self.near.tree_order[place]]
                for corner in ti.static(range(8)):
                    low, high = ti.min(low, self.ahead[nodes[corner]]), ti.max(high, self.ahead[nodes[corner]])
            put_box(self.boxes, self.block[leaf], k, low, high)

    @ti.func
    def find(self, q):
        """The contacts of point q with solids, each by the first cell that holds the point and has a way out."""
        p, last = self.place[q], -1
        for number in range(self.near.listed[q]):
            leaf = self.near.leaf(q, number)
            if self.block[leaf] >= 0:
                holding, k = which_meet(self.boxes, self.block[leaf], p, p), self.near.tree_first[leaf]
                while holding != 0:
                    if holding & 1:
                        e = self.near.tree_order[k]
                        if self.surface.owner[e] != last and self._holds(q, e):
                            last = self._add(q, e, last)
                    holding >>= 1
                    k += 1

    @ti.func
    def _holds(self, q, e):
        """Whether point q is in cell e and may touch it."""
        may = self.contacts.count[q] < self.contacts.per_point and self.surface.may_meet(q, e)
        if ti.static(self.tears):
            may = may and self.intact[e] == 1
        if may:
            may = cell_holds(self.surface.nodes[e], self.ahead, self.place[q])
        return may

    @ti.func
    def _add(self, q, e, last):
        """Add a contact of point q, which is in cell e, if it has a way out. Returns the last jello that has one."""
        depth, corners, weights, share = self._way_out(q, e)
        if depth < FAR:
            own, core = self.surface.jello_of(q), self.core[e]
            last = self.surface.owner[e]
            a, b, c = self.place[corners[0]], self.place[corners[1]], self.place[corners[2]]
            out = weights[0] * a + weights[1] * b + weights[2] * c - self.contacts.own_weight(weights) * self.place[q]
            if depth < COINCIDENT:
                out = (b - a).cross(c - a)
            n, contact = out / ti.max(out.norm(), 1e-30), q * self.contacts.per_point + self.contacts.count[q]
            self.contacts.write(contact, corners, weights, n)
            self.contacts.share[contact] = share
            if ti.static(self.surface.has_thin):
                self.contacts.separation[contact] = 0.0
            self.contacts.count[q] = self.contacts.count[q] + 1
            if ti.static(self.brakes):
                if depth > ti.select(self.surface.radius[own] > 0.0, BETWEEN, 1.0) * core:
                    self.brake.mark(own, last)
                    if ti.static(self.brake.sided):
                        self.brake.add_side(own, last, n)
        return last

    @ti.func
    def _way_out(self, q, e):
        """By which place point q leaves cell e: its distance [m], or FAR; its triangle's corners and their weights; and
        the share of a whole contact, as much as stores the energy that it would at the nearest place of all: then a
        way out that has become another one brings no energy.

        The point leaves by the nearest face, of those on the shortest ways through the undeformed body that are not on
        the same side as the point itself: otherwise two jellos that overlap by half crawl round each other (10 of 28
        pairs stay so, for 6). But a point that has just come in over an edge leaves by the face on its own side that
        is much nearer: by another one it would at once be pressed as deep as it is behind the edge (slabs laid into
        each other by half come apart with 1.8 times the energy)."""
        p, a, out = self.place[q], self.ahead[self.surface.nodes[e][0]], self._outwards(q)
        same, first, shortest, way = 0, 0, ti.cast(FAR, float), self.way[e]
        for k in ti.static(range(3)):
            axis = self.ahead[self.surface.nodes[e][4 >> k]] - a
            faces, least_cosine = axis.dot(out), SAME_SIDE * axis.norm() * out.norm()
            for up in ti.static(range(2)):
                if way[2 * k + up] > 0.0 and ti.static(2 * up - 1) * faces > least_cosine:
                    same |= 1 << (2 * k + up)
                elif way[2 * k + up] < shortest:
                    shortest, first = way[2 * k + up], 2 * k + up
        spacing, nearest = self.surface.spacing[self.surface.owner[e]], ti.cast(FAR, float)
        best, corners, weights = ti.cast(FAR, float), ti.Vector([0, 0, 0]), ti.Vector([0.0, 0.0, 0.0])
        # The opposite sides, over an edge, from middle to middle; then any side, for the share.
        for attempt in range(4):
            sides, longest, limit = 63, ti.cast(0.5 * FAR, float), nearest
            if attempt == 0:
                sides, longest = ti.select(shortest < FAR, 63 ^ same, 0), shortest + spacing
            elif attempt == 1:
                sides, longest, limit = ti.select(best < spacing, same, 0), spacing, OVER_AN_EDGE * best
            elif attempt == 2:
                sides, limit = self._side_between_middles(q, e, corners, weights, best), FAR
            if sides != 0:
                found, its_corners, its_weights = self._nearest_exit(e, p, sides, first, longest, limit)
                if found < limit:
                    nearest = ti.min(nearest, found)
                    if attempt < 3:
                        best, corners, weights = found, its_corners, its_weights
        least = ti.select(self._are_compact(q, e), LEAST_SHARE, 0.0)
        share = ti.math.clamp((nearest / ti.max(best, TINY)) ** 2, least, 1.0)
        if ti.static(self.surface.blended):
            if way[0] == 0.0:  # the skin passes through the cell, and the point may be outside
                a, b, c = self.place[corners[0]], self.place[corners[1]], self.place[corners[2]]
                best = ti.select((b - a).cross(c - a).dot(p - a) > 0.0, FAR, best)
        return best, corners, weights, share

    @ti.func
    def _are_compact(self, q, e):
        """Whether the jello of point q and that of cell e are two compact ones."""
        both = False
        if ti.static(self.some_compact):
            own, other = self.surface.jello_of(q), self.surface.owner[e]
            both = own != other and self.compact[own] == 1 and self.compact[other] == 1
        return both

    @ti.func
    def _side_between_middles(self, q, e, corners, weights, best):
        """The side of cell e, as a bit, by which the way from its jello's middle to that of point q's leaves it
        first, if both are compact and the way out found, `best` [m] long, leads against that; else 0."""
        sides = 0
        if ti.static(self.some_compact):
            if self._are_compact(q, e) and best < FAR:
                c, way = ti.Vector([0.0, 0.0, 0.0]), -self.place[q]
                for k in ti.static(range(8)):
                    c += 0.125 * self.ahead[self.middle[self.surface.jello_of(q)][k]]
                    c -= 0.125 * self.ahead[self.middle[self.surface.owner[e]][k]]
                for k in ti.static(range(3)):
                    way += weights[k] * self.place[corners[k]]
                if way.dot(c) < -LEAST_COSINE * ti.max(way.norm() * c.norm(), TINY):
                    least, a = ti.cast(FAR, float), self.ahead[self.surface.nodes[e][0]]
                    for k in ti.static(range(3)):
                        axis = self.ahead[self.surface.nodes[e][4 >> k]] - a
                        cosine = axis.dot(c) / ti.max(axis.norm() * c.norm(), TINY)
                        for up in ti.static(range(2)):
                            faces = ti.static(2 * up - 1) * cosine
                            if faces > LEAST_COSINE and self.way[e][2 * k + up] < faces * least:
                                least, sides = self.way[e][2 * k + up] / faces, 1 << (2 * k + up)
        return sides

    @ti.func
    def _outwards(self, q):
        """The way from the particle inside the body beside point q to q, or to its particle."""
        p = self.place[q]
        if ti.static(self.surface.first_sample < self.surface.count):
            if q >= self.surface.first_sample:
                p = self.ahead[self.surface.points[q]]
        return p - self.ahead[self.inner[q]]

    @ti.func
    def _nearest_exit(self, e, p, sides, first, longest, best):
        """As `nearer`, from the exits of cell e on some of its six sides, given as bits, no farther than `longest` [m]
        through the undeformed body; beginning with side `first`."""
        corners, weights = ti.Vector([0, 0, 0]), ti.Vector([0.0, 0.0, 0.0])
        for n in range(8):
            k = n ^ first
            if (sides >> k) & 1 == 1 and self.way[e][k] <= longest:
                group = self.exits[e][k]
                for t in range(self.start[group], self.start[group + 1]):
                    best, corners, weights = nearer(self.place, p, self.triangles[t], best, corners, weights)
        return best, corners, weights
