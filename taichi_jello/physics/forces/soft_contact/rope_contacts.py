"""What is special about ropes where they touch: between two of their points they may be near to what their points are
far from.
"""

import taichi as ti

from taichi_jello.physics.forces.soft_contact.search.closest_point import closest
from taichi_jello.physics.forces.soft_contact.shared_load import Loads
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import AT_ONCE

TWICE = 0.5  # what a contact of two ropes counts for: where they cross they touch from two points of each
FLAT = 1e-3  # times how far ropes are kept apart: those that cross nearer than this do so in one plane
TINY = 1e-9  # m
UP, SIDEWAYS = ti.Vector([0.0, 1.0, 0.0]), ti.Vector([1.0, 0.0, 0.0])


@ti.data_oriented
class Ropes(Loads):
    """For Contacts. A point of a rope stands for half of each segment beside it, and it is these that keep away from
    other ropes; the place of such a contact may be between the point and the next one, see Contacts."""

    @ti.func
    def are_ropes(self, a, b):
        both = 0
        if ti.static(self.near.has_lines):
            both = self.near.is_rope[a] * self.near.is_rope[b]
        return both

    @ti.func
    def nearer_half(self, q, segment, best, corners, weights):
        """See nearer: from one of the halves of segments beside point q of a rope."""
        p, a = self.place[q], self.place[segment[0]]
        edge = self.place[segment[1]] - a
        for k in ti.static(range(2)):
            r = self.near.beside(q, k)
            along = self.place[r] - p
            u, s = closest(p, along, 0.5, a, edge)
            distance = (p + u * along - a - s * edge).norm()
            if r != q and distance < best:
                best, corners = distance, ti.Vector([segment[0], segment[1], r])
                weights = ti.Vector([1.0 - s, s, -u])
        return best, corners, weights

    @ti.func
    def own_weight(self, weights):
        """What a point has of the place at which it touches."""
        own = ti.cast(1.0, float)
        if ti.static(self.near.has_lines):
            own = weights.sum()
        return own

    @ti.func
    def whole(self, contact):
        """What a contact that counts for all it may is of a whole one."""
        own, other = self.near.points[contact // AT_ONCE], self.near.points[self.corners[contact][0]]
        return ti.select(self.are_ropes(self.near.jello[own], self.near.jello[other]), TWICE, 1.0)

    @ti.func
    def least_distance(self, q, corners):
        """The distance [m] up to which what separates two places has no direction that could be relied upon."""
        a, b = self.near.jello[self.near.points[q]], self.near.jello[self.near.points[corners[0]]]
        return ti.select(self.are_ropes(a, b), FLAT * (self.near.radius[a] + self.near.radius[b]), TINY)

    @ti.func
    def aside(self, q, corner, edge, normal):
        """The way apart of the point q and a place beside `corner` of a thin body that it lies in: along a triangle's
        normal, or square to a segment's edge, to one side for the first of two jellos, to the other for the second."""
        if normal.norm_sqr() == 0.0:
            normal = edge.cross(ti.select(ti.abs(edge[1]) < 0.9 * edge.norm(), UP, SIDEWAYS))
        side = normal.dot(ti.Vector([0.1, 1.0, 0.01]))
        first = self.near.points[q] < self.near.points[corner]
        return ti.select((side > 0.0) == first, normal, -normal)
