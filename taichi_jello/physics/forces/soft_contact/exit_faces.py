"""How a point that is inside a cell of another jello leaves it.

It is to leave by the nearest of the triangles by which that cell is left through the undeformed body (the idea of
McAdams et al. 2011, "Efficient elasticity for character skinning", 5), so that a point deep inside leaves by the
nearest face however the body is crushed. By that alone two that cross each other would hold each other, as a blade
does what it sticks in: half of it would leave on either side. So where both are compact, convex and about as thick as
long, and the nearest face leads against the way from the middle of one to that of the other, it is this way that
decides. Of what is slender it would lead to an end.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.search.boxes import TINY
from taichi_jello.physics.forces.soft_contact.search.closest_point import nearer
from taichi_jello.physics.forces.soft_contact.search.neighbour_list import Neighbours
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import FAR
from taichi_jello.physics.state import Memory

SAME = 0.5  # the cosine above which a face faces as the point does that would leave by it
ASIDE = 0.05  # the cosine up to which a face is beside the way from middle to middle
LEAST = 0.002  # that a contact counts for: without it jellos whose sides lie in one plane would stay in each other
LOOKS = 4  # for a way out
STRAIGHT, OVER_THE_EDGE, BETWEEN_HEARTS, ANY = range(LOOKS)
BACK = 1 / 3  # of the distance to the face to leave by: within it a point near an edge goes back over that edge


@ti.data_oriented
class Exits:
    """The ways out of the cells, see Touching, for particles that are `there` and points that are at `place`."""

    def __init__(self, title: str, memory: Memory, near: Neighbours, there: ti.Field, place: ti.Field):
        touching = near.touching
        self.near, self.there, self.place = near, there, place
        self.exits = memory.table(title, "exits of each cell", touching.exits)
        self.triangles = memory.table(title, "exits", touching.triangles)
        self.start = memory.table(title, "starts of exits", touching.start)
        self.way = memory.table(title, "ways to them", touching.way)
        self.inner = memory.table(title, "inner neighbours", touching.inner)
        self.core = memory.table(title, "cores of cells", touching.core)
        self.sampled = near.first_sample < near.count
        self.some_compact = bool(np.count_nonzero(touching.compact) > 1)
        if self.some_compact:
            self.compact = memory.table(title, "compact", touching.compact.astype(np.int32))
            self.hearts = memory.table(title, "hearts", touching.hearts)

    @ti.func
    def leave(self, q, e):
        """How the point q leaves cell e: by the nearest face, of those by the shortest
        ways through the undeformed body that do not face as the point itself does. (Without this two jellos that
        overlap by half would crawl round each other, each leaving by the other's sides.) But a point that has just
        come in over an edge goes back by the face that is much nearer, wherever it faces: by another it would be
        pressed at once as deep as it is behind the edge, and come back to be thrown out again, for good.

        Returns the distance to the place where it leaves, its triangle's corners and their weights, and how much the
        contact counts for: where that is not the nearest place of all, as much as stores the energy that it would
        there, so that a way out that has become another one brings no energy, whatever has become of the body; but
        between two that are compact at least LEAST."""
        p, a = self.place[q], self.there[self.near.nodes[e][0]]
        out = p - self.there[self.inner[q]]
        if ti.static(self.sampled):
            if q >= self.near.first_sample:  # the way into the body is that from the particle beside it
                out = self.there[self.near.points[q]] - self.there[self.inner[q]]
        same, first, least, way = 0, 0, ti.cast(FAR, float), self.way[e]
        for k in ti.static(range(3)):
            axis = self.there[self.near.nodes[e][4 >> k]] - a
            faces, least_cosine = axis.dot(out), SAME * axis.norm() * out.norm()
            for up in ti.static(range(2)):
                if way[2 * k + up] > 0.0 and ti.static(2 * up - 1) * faces > least_cosine:
                    same |= 1 << (2 * k + up)
                elif way[2 * k + up] < least:
                    least, first = way[2 * k + up], 2 * k + up
        spacing, nearest = self.near.spacing[self.near.owner[e]], ti.cast(FAR, float)
        best, corners, weights = ti.cast(FAR, float), ti.Vector([0, 0, 0]), ti.Vector([0.0, 0.0, 0.0])
        for look in range(LOOKS):
            sides, longest, limit = 63, ti.cast(0.5 * FAR, float), nearest
            if look == STRAIGHT:
                sides, longest = ti.select(least < FAR, 63 ^ same, 0), least + spacing
            elif look == OVER_THE_EDGE:
                sides, longest, limit = ti.select(best < spacing, same, 0), spacing, BACK * best
            elif look == BETWEEN_HEARTS:
                sides, limit = self.between_hearts(q, e, corners, weights, best), ti.cast(FAR, float)
            if sides != 0:
                found, its_corners, its_weights = self.nearest_exit(e, p, sides, first, longest, limit)
                if found < limit:
                    nearest = ti.min(nearest, found)
                    if look != ANY:
                        best, corners, weights = found, its_corners, its_weights
        fewest = ti.select(self.both_compact(q, e), LEAST, 0.0)
        counts = ti.math.clamp((nearest / ti.max(best, TINY)) ** 2, fewest, 1.0)
        if ti.static(self.near.skinned):
            if self.way[e][0] == 0.0 and self.is_outside(p, corners):
                best = FAR
        return best, corners, weights, counts

    @ti.func
    def between_hearts(self, q, e, corners, weights, best):
        """The side, as a bit, by which point q is to leave cell e for the sake of the two bodies' middles, if the place
        found on a triangle, `best` [m] away, leads against the way from one to the other."""
        sides = 0
        if ti.static(self.some_compact):
            if self.both_compact(q, e) and best < FAR:
                c = self.heart(self.near.jello[self.near.points[q]]) - self.heart(self.near.owner[e])
                if self.leads(self.place[q], corners, weights, c) < -ASIDE:
                    sides = self.toward(e, c)
        return sides

    @ti.func
    def both_compact(self, q, e):
        """Whether the jello of point q and that of cell e are two that are compact and stay so."""
        both = False
        if ti.static(self.some_compact):
            own, other = self.near.jello[self.near.points[q]], self.near.owner[e]
            both = own != other and self.compact[own] == 1 and self.compact[other] == 1
        return both

    @ti.func
    def heart(self, j):
        """The middle of jello j."""
        place = ti.Vector([0.0, 0.0, 0.0])
        for k in ti.static(range(8)):
            place += 0.125 * self.there[self.hearts[j][k]]
        return place

    @ti.func
    def leads(self, p, corners, weights, c):
        """The cosine between the way from p to a place of a triangle and c."""
        way = -p
        for k in ti.static(range(3)):
            way += weights[k] * self.place[corners[k]]
        return way.dot(c) / ti.max(way.norm() * c.norm(), TINY)

    @ti.func
    def toward(self, e, c):
        """The side of cell e, as a bit, by which the way along c leaves the body first; 0 if there is none."""
        side, least, a = 0, ti.cast(FAR, float), self.there[self.near.nodes[e][0]]
        for k in ti.static(range(3)):
            axis = self.there[self.near.nodes[e][4 >> k]] - a
            cosine = axis.dot(c) / ti.max(axis.norm() * c.norm(), TINY)
            for up in ti.static(range(2)):
                faces = ti.static(2 * up - 1) * cosine
                if faces > ASIDE and self.way[e][2 * k + up] < faces * least:
                    least, side = self.way[e][2 * k + up] / faces, 1 << (2 * k + up)
        return side

    @ti.func
    def nearest_exit(self, e, p, sides, first, longest, best):
        """The place nearer to p than `best` by which it leaves cell e on some of its six sides, given as bits, and by
        ways no longer than `longest`; see nearer."""
        corners, weights = ti.Vector([0, 0, 0]), ti.Vector([0.0, 0.0, 0.0])
        for n in range(8):
            k = n ^ first
            if (sides >> k) & 1 == 1 and self.way[e][k] <= longest:
                group = self.exits[e][k]
                for t in range(self.start[group], self.start[group + 1]):
                    best, corners, weights = nearer(self.place, p, self.triangles[t], best, corners, weights)
        return best, corners, weights

    @ti.func
    def is_outside(self, p, corners):
        """Whether p is on the outer side of a skin's triangle, the nearest one to it."""
        a, b, c = self.place[corners[0]], self.place[corners[1]], self.place[corners[2]]
        return (b - a).cross(c - a).dot(p - a) > 0.0
