"""How a point that is inside a cell of another jello leaves it.

It is to leave by the nearest of the triangles by which that cell is left through the undeformed body (the idea of
McAdams et al. 2011, "Efficient elasticity for character skinning", 5), so that a point deep inside leaves by the
nearest face however the body is crushed.
"""

import taichi as ti

from taichi_jello.physics.elements import nearer
from taichi_jello.physics.neighbours import Neighbours
from taichi_jello.physics.state import Memory
from taichi_jello.physics.touching import FAR

SAME = 0.5  # the cosine above which a face faces as the point does that would leave by it
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

    @ti.func
    def leave(self, q, e):
        """How the point q leaves cell e: by the nearest face, of those by the shortest
        ways through the undeformed body that do not face as the point itself does. (Without this two jellos that
        overlap by half would crawl round each other, each leaving by the other's sides.) But a point that has just
        come in over an edge goes back by the face that is much nearer, wherever it faces: by another it would be
        pressed at once as deep as it is behind the edge, and come back to be thrown out again, for good."""
        p, a = self.place[q], self.there[self.near.nodes[e][0]]
        out = p - self.there[self.inner[q]]
        same, first, least, way = 0, 0, ti.cast(FAR, float), self.way[e]
        for k in ti.static(range(3)):
            axis = self.there[self.near.nodes[e][4 >> k]] - a
            faces, least_cosine = axis.dot(out), SAME * axis.norm() * out.norm()
            for up in ti.static(range(2)):
                if way[2 * k + up] > 0.0 and ti.static(2 * up - 1) * faces > least_cosine:
                    same |= 1 << (2 * k + up)
                elif way[2 * k + up] < least:
                    least, first = way[2 * k + up], 2 * k + up
        spacing = self.near.spacing[self.near.owner[e]]
        best, corners, weights = ti.cast(FAR, float), ti.Vector([0, 0, 0]), ti.Vector([0.0, 0.0, 0.0])
        if least < FAR:
            best, corners, weights = self.nearest_exit(e, p, 63 ^ same, first, least + spacing, best)
        if same != 0 and best < spacing:
            back, its_corners, its_weights = self.nearest_exit(e, p, same, 0, spacing, BACK * best)
            if back < BACK * best:
                best, corners, weights = back, its_corners, its_weights
        if ti.static(self.near.skinned):  # noqa: SIM102
            if self.way[e][0] == 0.0 and self.is_outside(p, corners):
                best = FAR
        return best, corners, weights

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
