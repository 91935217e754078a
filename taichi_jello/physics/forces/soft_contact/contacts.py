"""The contacts of a step, and which of them press on each point."""

import taichi as ti

from taichi_jello.physics.forces.contact_law import ContactLaw
from taichi_jello.physics.forces.soft_contact.surface.surface_fields import SurfaceFields
from taichi_jello.physics.state import Memory

MAX_CONTACTS_PER_POINT = 4  # each with another jello: as many as meet at a corner of a stack
FULL_CONTACTS = 2.0  # contacts that press on one point with full stiffness: its own and one that it is a corner of
ROPE_PAIR_SHARE = 0.5  # of a whole contact of two ropes: where these cross they touch from two points of each


@ti.data_oriented
class Contacts:
    """Point q has count[q] contacts from per_point · q on, each with the place Σ weight · corner on the surface of
    another jello: along `normal` the two are to be `separation` [m] apart. Of two ropes it may be a place between the
    point and the next one on its rope that touches: the third corner is that next one, with a weight less than 0, and
    the point's own weight is the sum of all three. share: the part of the full stiffness that a contact has.

    Point q has the weight weight_in[k] in the contact pressing[k], for the pressing_count[q] numbers k from
    pressing_start[q] on, in ascending order of contacts. It is that in its own contacts, less that of a corner.

    Contacts are found for particles at `ahead` and points at `place`."""

    def __init__(self, title: str, memory: Memory, surface: SurfaceFields, law: ContactLaw):
        self.surface, self.law = surface, law
        others = (surface.jellos - 1 if surface.others else 0) + surface.with_self
        self.per_point = min(others, MAX_CONTACTS_PER_POINT)
        points, count = surface.count, self.per_point * surface.count
        self.ahead = memory.zeros(title, "x looked at", (memory.particles, 3))
        self.place = memory.zeros(title, "places", (points, 3))
        self.corners = memory.zeros(title, "touched corners", (count, 3), whole=True)
        self.weights, self.normal = (memory.zeros(title, name, (count, 3)) for name in ("their weights", "normals"))
        self.share = memory.zeros(title, "shares of contacts", (count,))
        if surface.has_thin:
            self.separation = memory.zeros(title, "apart", (count,))
        self.count = memory.zeros(title, "contacts of each point", (points,), whole=True)
        self.load = memory.zeros(title, "loads", (points,))
        self.pressing_count, self.pressing_start = (
            memory.zeros(title, f"contacts that press: {name}", (points,), whole=True) for name in ("count", "start")
        )
        self.pressing = memory.zeros(title, "contacts that press", (4 * count,), whole=True)
        self.weight_in = memory.zeros(title, "weights in them", (4 * count,))
        self.listed = memory.zeros(title, "contacts listed", (1,), whole=True)

    @ti.func
    def clear(self, q):
        self.count[q], self.pressing_count[q] = 0, 0

    @ti.func
    def own_weight(self, weights):
        """The weight of a point in the place at which it touches."""
        own = ti.cast(1.0, float)
        if ti.static(self.surface.has_rope_pairs):
            own = weights.sum()
        return own

    @ti.func
    def jellos(self, contact):
        """The jello of a contact's point and the one that it touches."""
        q, corner = contact // self.per_point, self.corners[contact][0]
        return self.surface.jello_of(q), self.surface.jello_of(corner)

    @ti.func
    def law_of(self, contact):
        """See ContactLaw."""
        own, other = self.jellos(contact)
        return self.law.between(own, other)

    @ti.func
    def scale(self, contact):
        """The part of the contact law's coefficients that a contact has."""
        return self.surface.part(contact // self.per_point) * self.share[contact]

    @ti.func
    def write(self, contact, corners, weights, normal):
        self.corners[contact], self.weights[contact], self.normal[contact] = corners, weights, normal

    @ti.func
    def difference(self, q, corners, weights, x):
        """The value of a field x of the particles at point q, less that at the place that it touches."""
        d = self.own_weight(weights) * self.surface.at(q, x)
        for k in ti.static(range(3)):
            d -= weights[k] * self.surface.at(corners[k], x)
        return d

    @ti.func
    def between(self, contact, x):
        return self.difference(contact // self.per_point, self.corners[contact], self.weights[contact], x)

    @ti.func
    def depth(self, contact, x):
        """The penetration depth [m]; less than 0 where there is a gap."""
        depth = -self.between(contact, x).dot(self.normal[contact])
        if ti.static(self.surface.has_thin):
            depth += self.separation[contact]
        return depth

    @ti.func
    def lever_when_found(self, contact):
        """How deep [m] the point lies below the touched place where the contact was found."""
        weights = self.weights[contact]
        apart = self.own_weight(weights) * self.place[contact // self.per_point]
        for k in ti.static(range(3)):
            apart -= weights[k] * self.place[self.corners[contact][k]]
        return -apart.dot(self.normal[contact])

    @ti.func
    def list_pressing(self, busy: ti.template(), some, from_, to):
        """List what presses on the points from_ … to - 1, of the contacts of the first `some` of the points `busy`.
        (Each member of a team goes through all contacts, for points of its own: nobody waits for another one's store.)
        """
        for k in range(some):
            self._enter(busy[k], from_, to, False)
        for q in range(from_, to):
            if self.pressing_count[q] > 0:
                self.pressing_start[q] = ti.atomic_add(self.listed[0], self.pressing_count[q])
                self.pressing_count[q] = 0
        for k in range(some):
            self._enter(busy[k], from_, to, True)
        for q in range(from_, to):
            if self.pressing_count[q] > 0:
                self._sort(q)

    @ti.func
    def _enter(self, q, from_, to, listing: ti.template()):
        """Count the contacts of point q for each of the points from_ … to - 1 that they press on, or list them."""
        for contact in range(q * self.per_point, q * self.per_point + self.count[q]):
            weights = self.weights[contact]
            self._enter_one(contact, q, self.own_weight(weights), from_, to, listing)
            for k in ti.static(range(3)):
                if weights[k] != 0.0:
                    self._enter_one(contact, self.corners[contact][k], -weights[k], from_, to, listing)

    @ti.func
    def _enter_one(self, contact, q, weight, from_, to, listing: ti.template()):
        if from_ <= q < to:
            number = ti.atomic_add(self.pressing_count[q], 1)
            if ti.static(listing):
                place = self.pressing_start[q] + number
                self.pressing[place], self.weight_in[place] = contact, weight

    @ti.func
    def _sort(self, q):
        """Sort what presses on point q by contact, for sums that do not depend on threads; and add up its load."""
        first, last = self.pressing_start[q], self.pressing_start[q] + self.pressing_count[q]
        for k in range(first + 1, last):
            contact, weight, place = self.pressing[k], self.weight_in[k], k
            while place > first and self.pressing[place - 1] > contact:
                self.pressing[place], self.weight_in[place] = self.pressing[place - 1], self.weight_in[place - 1]
                place -= 1
            self.pressing[place], self.weight_in[place] = contact, weight
        load = ti.cast(0.0, float)
        for k in range(first, last):
            contact = self.pressing[k]
            own, other = self.jellos(contact)
            whole = ti.select(self.surface.are_ropes(own, other), ROPE_PAIR_SHARE, 1.0)
            load += ti.abs(self.weight_in[k]) * self.surface.part(contact // self.per_point) * whole
        self.load[q] = load / self.surface.part(q)

    @ti.func
    def share_loads(self, q):
        """Weaken the contacts of point q where more press on one of their points than may with full stiffness."""
        for contact in range(q * self.per_point, q * self.per_point + self.count[q]):
            most = ti.max(self.load[q], FULL_CONTACTS)
            for k in ti.static(range(3)):
                if self.weights[contact][k] != 0.0:
                    most = ti.max(most, self.load[self.corners[contact][k]])
            self.share[contact] = self.share[contact] * (FULL_CONTACTS / most)
