"""Narrow phase for sheets and ropes: they have no inside, and points keep a distance from their triangles and segments.

A point of a rope stands for half of each segment beside it: between two of their points ropes may be near each other
where their points are far apart.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.contacts import ROPE_PAIR_SHARE, Contacts
from taichi_jello.physics.forces.soft_contact.fast.inelastic_brake import Brake
from taichi_jello.physics.forces.soft_contact.search.closest_point import closest, nearer
from taichi_jello.physics.forces.soft_contact.search.neighbour_list import NeighbourList
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import FAR
from taichi_jello.physics.state import Memory
from taichi_jello.scene.body import Body

COPLANAR = 1e-3  # of the distance that ropes keep: those that cross nearer than this do so in one plane
COINCIDENT = 1e-9  # m, a distance that has no direction to rely on
STOPPED_WITHIN = 0.5  # of the distance that thin jellos keep
BRAKED_AT = 0.75  # of the distance that thin jellos keep: deeper, both are braked as wholes
UP, SIDEWAYS = ti.Vector([0.0, 1.0, 0.0]), ti.Vector([1.0, 0.0, 0.0])


@ti.data_oriented
class ThinContacts:
    """intact: which elements are not torn apart, if any may be; brake: None if nothing is braked."""

    def __init__(
        self,
        title: str,
        body: Body,
        memory: Memory,
        contacts: Contacts,
        near: NeighbourList,
        brake: Brake | None,
        intact: ti.Field | None,
    ):
        self.contacts, self.near, self.brake, self.intact = contacts, near, brake, intact
        self.brakes, self.tears = brake is not None, intact is not None
        self.surface, self.place = contacts.surface, contacts.place
        touching, shapes = self.surface.touching, self.surface.touching.shapes
        point_of = np.zeros(len(body), np.int32)
        point_of[touching.points[: touching.bare]] = np.arange(touching.bare)
        self.triangles = memory.table(title, "points of thin elements", point_of[touching.nodes[touching.solid :, :3]])
        self.has_ropes_on_solids = self.surface.has_ropes and self.surface.others and bool(shapes.firm.any())
        self.has_thin_pairs = brake is not None and int(np.sum(shapes.radius > 0.0)) > 1
        if self.has_thin_pairs:
            mass = np.bincount(body.jello, body.mass) / np.bincount(body.jello)
            self.particle_mass = memory.table(title, "masses of particles", mass)

    @ti.func
    def find(self, q, v, ahead):
        """The contacts of point q with thin jellos, each with the nearest of its triangles and segments within reach,
        after those that it has with solids."""
        own, p, best, jello = self.surface.jello_of(q), self.place[q], ti.cast(FAR, float), -1
        end = self.near.listed[q]
        corners, weights = ti.Vector([0, 0, 0]), ti.Vector([0.0, 0.0, 0.0])
        for k in range(ti.select(self._is_rope_sample(q), 0, end + 1)):  # one more than listed, to end the last jello
            e, other = 0, -1
            if k < end:
                e = self.near.tree_order[self.near.tree_first[self.near.leaf(q, k)]]
                other = self.surface.owner[e]
            if other != jello:
                if best < FAR and self.contacts.count[q] < self.contacts.per_point:
                    self._add(q, corners, weights, best, v, ahead)
                jello, best = other, FAR
            if k < end and e >= self.surface.solid and self._may_touch(q, e):
                triangle = self.triangles[e - self.surface.solid]
                if self.surface.are_ropes(own, other):
                    if ti.static(self.surface.has_rope_pairs):
                        best, corners, weights = self._nearer_half(q, triangle, best, corners, weights)
                else:
                    best, corners, weights = nearer(self.place, p, triangle, best, corners, weights)

    @ti.func
    def _is_rope_sample(self, q):
        """Whether q is a point between the particles of a rope, which touches only solids (see edge_samples.py)."""
        sample = False
        if ti.static(self.surface.has_ropes):
            sample = q >= self.surface.first_sample and self.surface.is_rope[self.surface.jello_of(q)] == 1
        return sample

    @ti.func
    def _may_touch(self, q, e):
        """Not what is torn; and a rope and a solid touch by the rope's points alone, as the solid's points are on
        either side of it, unless the solid may melt or tear, and have no cells left."""
        may = self.surface.may_meet(q, e)
        if ti.static(self.tears):
            may = may and self.intact[e] == 1
        if ti.static(self.has_ropes_on_solids):
            own = self.surface.jello_of(q)
            firm_solid = self.surface.radius[own] == 0.0 and self.brake.firm[own] > 0
            may = may and not (firm_solid and self.surface.is_rope[self.surface.owner[e]] == 1)
        return may

    @ti.func
    def _nearer_half(self, q, segment, best, corners, weights):
        """As `nearer`, from one of the halves of the segments beside point q of a rope."""
        p, a = self.place[q], self.place[segment[0]]
        edge = self.place[segment[1]] - a
        for k in ti.static(range(2)):
            r = self.surface.beside(q, k)
            along = self.place[r] - p
            u, s = closest(p, along, 0.5, a, edge)
            distance = (p + u * along - a - s * edge).norm()
            if r != q and distance < best:
                best, corners = distance, ti.Vector([segment[0], segment[1], r])
                weights = ti.Vector([1.0 - s, s, -u])
        return best, corners, weights

    @ti.func
    def _add(self, q, corners, weights, distance, v, ahead):
        """Add a contact of point q with a place at `distance` [m], if the two may touch within the step."""
        own, other = self.surface.jello_of(q), self.surface.jello_of(corners[0])
        separation, ropes = self.surface.radius[own] + self.surface.radius[other], self.surface.are_ropes(own, other)
        n = self._normal(q, corners, weights, distance, ti.select(ropes, COPLANAR * separation, COINCIDENT))
        outwards = self.contacts.difference(q, corners, weights, v).dot(n)
        contact = q * self.contacts.per_point + self.contacts.count[q]
        self.contacts.share[contact] = ti.select(ropes, ROPE_PAIR_SHARE, 1.0)
        self.contacts.separation[contact] = separation
        if ti.static(self.brakes):
            limit = BRAKED_AT * separation
            if ti.static(self.has_thin_pairs):
                if self._is_too_fast(own, other, -outwards):
                    limit = 0.0
            if separation - distance > limit:
                self.brake.mark(own, other)
                if ti.static(self.surface.has_rope_pairs):
                    if ropes:
                        self.brake.add_side(own, other, n)
        if distance < separation + ahead * ti.abs(outwards):
            self.contacts.write(contact, corners, weights, n)
            self.contacts.count[q] = self.contacts.count[q] + 1

    @ti.func
    def _normal(self, q, corners, weights, distance, reliable):
        """The unit vector from a place to point q. Nearer than `reliable` [m], along the triangle's normal, or square
        to a segment: to one side for the first of two jellos, to the other for the second."""
        a, b, c = self.place[corners[0]], self.place[corners[1]], self.place[corners[2]]
        out = self.contacts.own_weight(weights) * self.place[q] - (weights[0] * a + weights[1] * b + weights[2] * c)
        if distance < reliable:
            out = (b - a).cross(c - a)
            if out.norm_sqr() == 0.0:
                out = (b - a).cross(ti.select(ti.abs(b[1] - a[1]) < 0.9 * (b - a).norm(), UP, SIDEWAYS))
            first = self.surface.points[q] < self.surface.points[corners[0]]
            if (out.dot(ti.Vector([0.1, 1.0, 0.01])) > 0.0) != first:
                out = -out
        return out / ti.max(out.norm(), 1e-30)

    @ti.func
    def _is_too_fast(self, a, b, inwards):
        """Whether one of two thin jellos comes `inwards` [m/s] at the other faster than a contact spring stops a
        particle within STOPPED_WITHIN of the distance that they keep: ½ k d² < ½ m v²."""
        way = STOPPED_WITHIN * (self.surface.radius[a] + self.surface.radius[b])
        mass = ti.max(self.particle_mass[a], self.particle_mass[b])
        both_thin = ti.min(self.surface.radius[a], self.surface.radius[b]) > 0.0
        stiffness = self.contacts.law.between(a, b)[0]
        return both_thin and inwards > 0.0 and mass * inwards * inwards > stiffness * way * way
