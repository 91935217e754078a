"""Which points touch which other jello, and where: found once a step, at the place that the step is about to reach.

A point that is inside a solid jello is to leave it (see exit_faces.py). Sheets and ropes have no inside: points keep a
radius away from their triangles and segments. But where a rope lies on a solid the solid's points are on either side
of it; these two touch by the rope's points alone. For ropes among themselves see rope_contacts.py.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.exit_faces import Exits
from taichi_jello.physics.forces.soft_contact.fast.inelastic_brake import Brake
from taichi_jello.physics.forces.soft_contact.rope_contacts import TWICE, Ropes
from taichi_jello.physics.forces.soft_contact.search.closest_point import nearer
from taichi_jello.physics.forces.soft_contact.search.containing_cells import AT_HAND, Inside
from taichi_jello.physics.forces.soft_contact.search.neighbour_list import Neighbours
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import AT_ONCE, FAR, Touching
from taichi_jello.physics.forces.soft_contact.surface.thickness import CORE
from taichi_jello.physics.forces.springs.tearing import still_there

BETWEEN = 0.5  # times as deep as usual is a core for what is thin: it may be deeper between its points
HALFWAY = 0.5  # of the distance that thin jellos keep apart
LATE = 1.5  # times as deep as a core has to be what comes too near to a thin body for both to be braked as wholes


@ti.data_oriented
class Contacts(Ropes):
    """Point q has own[q] contacts, of which n is number AT_ONCE q + n, with the place Σ weights · corners of another
    jello's surface: along `normal` it is to be kept `apart` [m] from there. Where it is not the point itself that
    touches but a place between it and the next one on its rope, the third corner is that one and has a weight less than
    0: the point's own weight is the sum of all three. `share`: how much the contact counts for; `core` [m]: the depth
    beyond which it must not go on, CORE of how thick the other jello is there."""

    rounds = 5

    def __init__(self, title, body, memory, others, itself, loose, tears, law):
        """loose: see Touching.of; tears: whether springs may; an element that is parted is not touched any more. law:
        see ContactLaw."""
        touching = Touching.of(body, loose)
        self.body, self.tears, self.law = body, tears, law
        self.near = Neighbours(title, body, memory, touching, others, itself)
        self.points, self.solid = len(touching.points), touching.solid
        self.has_solid, self.has_thin = touching.solid > 0, touching.solid < len(touching.nodes)

        def table(name, values):
            return memory.table(title, name, values)

        point_of = np.full(memory.padded, -1, np.int32)
        point_of[touching.points[: touching.bare]] = np.arange(touching.bare)
        self.point_of = table("point of each particle", point_of)
        if self.near.skinned:
            self.parts = table("shares", touching.share)
        if tears:
            self.holds = table("elements not parted", np.ones(len(touching.nodes), np.int32))
        self.there = memory.zeros(title, "x looked at", (memory.particles, 3))
        self.place = memory.zeros(title, "places", (self.points, 3))
        self.can_brake = others and int(np.sum(~touching.loose)) > 1
        self.brake = Brake(title, memory, self.near) if self.can_brake else None
        self.sided = self.can_brake and self.brake.sided
        self.has_ropes_on_solids = others and bool(touching.rope.any() and touching.firm.any())
        self.has_thin_pairs = self.can_brake and int(np.sum(touching.radius > 0.0)) > 1
        if self.has_thin_pairs:
            mass = np.bincount(body.jello, body.mass) / np.bincount(body.jello)
            self.particle_mass = table("masses of particles", mass)
        if self.has_solid:
            self.inside = Inside(title, memory, self.near, self.there, self.place)
            self.exits = Exits(title, memory, self.near, self.there, self.place)
        count = AT_ONCE * self.points
        self.corners = memory.zeros(title, "touched corners", (count, 3), whole=True)
        self.weights = memory.zeros(title, "their weights", (count, 3))
        self.normal = memory.zeros(title, "normals", (count, 3))
        if self.has_thin:
            self.apart = memory.zeros(title, "apart", (count,))
        self.share, self.core = (memory.zeros(title, f"{name} of contacts", (count,)) for name in ("shares", "cores"))
        self.own = memory.zeros(title, "contacts of each point", (self.points,), whole=True)
        super().__init__(title, memory, self.points)

    @ti.func
    def look(self, r: ti.template(), system, first, last, x, v, ahead):
        """Round r of finding all contacts where x + ahead v is, done by everybody before the next one begins; for the
        share of the particles first … last - 1 in everything there is."""
        from_, to = system.share_of(first, self.points), system.share_of(last, self.points)
        if ti.static(r == 0):
            for i in range(first, last):
                self.there[i] = x[i] + ahead * v[i]
            for q in range(from_, to):
                self.own[q], self.listed[q] = 0, 0
            if ti.static(self.can_brake):
                for _ in range(ti.select(first == 0, 1, 0)):
                    self.brake.reset()
        elif ti.static(r == 1):
            for q in range(from_, to):
                if self.near.meets_any[self.near.jello[self.near.points[q]]]:
                    self.place[q] = self.near.at(q, self.there)
            if ti.static(self.has_solid):
                leaves = self.near.boxes_of_nodes
                for n in range(system.share_of(first, leaves), system.share_of(last, leaves)):
                    if self.near.is_found[n] and self.inside.block[n] >= 0:
                        self.inside.fit(n)
        elif ti.static(r == 2):
            busy = self.near.state[2]
            if ti.static(self.has_solid):
                for k in range(system.share_of(first, busy), system.share_of(last, busy)):
                    self.inside.collect(self.near.busy[k])
                for k in range(system.share_of(first, busy), system.share_of(last, busy)):
                    q = self.near.busy[k]
                    self.inside.count[q] = self.inside.sift(q, self.inside.count[q])
            for k in range(system.share_of(first, busy), system.share_of(last, busy)):
                self.find(self.near.busy[k], v, ahead)
        elif ti.static(r == 3):
            for k in range(self.near.state[2]):
                self.enter(self.near.busy[k], from_, to)
            for q in range(from_, to):
                if self.listed[q] > 0:
                    self.sort(q)
        else:
            busy = self.near.state[2]
            for k in range(system.share_of(first, busy), system.share_of(last, busy)):
                self.settle(self.near.busy[k])

    def obey(self, law):
        """Let go of what is torn (see spring_state.py)."""
        if self.tears:
            nodes = self.near.touching.nodes
            there = still_there(self.body, law.whole, nodes[: self.solid], nodes[self.solid :, :3])
            self.holds.from_numpy(there.astype(np.int32))

    @ti.func
    def may_touch(self, q, e):
        may = self.near.is_apart(q, e)
        if ti.static(self.tears):
            may = may and self.holds[e] == 1
        return may

    @ti.func
    def find(self, q, v, ahead):
        """The contacts of a point: with each other jello the first of its cells that holds the point, or the nearest of
        its triangles and segments within reach."""
        met = 0
        if ti.static(self.has_solid):
            met = self.find_solid(q, met, v, ahead)
        if ti.static(self.has_thin):
            if not self.is_between_points_of_a_rope(q):
                met = self.find_thin(q, met, v, ahead)
        self.own[q] = met

    @ti.func
    def is_between_points_of_a_rope(self, q):
        """Whether point q is one that touches only solids; see edge_samples.py."""
        between = False
        if ti.static(self.near.has_ropes):
            between = q >= self.near.first_sample and self.near.is_rope[self.near.jello[self.near.points[q]]] == 1
        return between

    @ti.func
    def is_left_to_the_rope(self, q, e):
        """Whether element e is a segment of a rope whose own points touch the solid that q is a point of; those of one
        that may melt or tear touch all the same, since it may have no cells left."""
        left = False
        if ti.static(self.has_ropes_on_solids):
            own, other = self.near.jello[self.near.points[q]], self.near.owner[e]
            solid = self.near.radius[own] == 0.0 and self.brake.firm[own] > 0
            left = solid and self.near.is_rope[other] == 1
        return left

    @ti.func
    def find_solid(self, q, met, v, ahead):
        """Count on from `met` with one contact for each other jello that has a cell which holds the point."""
        done = -1
        for c in range(q * AT_HAND, q * AT_HAND + self.inside.count[q]):
            e = self.inside.cells[c]
            if self.near.owner[e] != done and met < AT_ONCE and self.may_touch(q, e):
                best, corners, weights, counts = self.exits.leave(q, e)
                if best < FAR:
                    contact = q * AT_ONCE + met
                    own, done, core = self.near.jello[self.near.points[q]], self.near.owner[e], self.exits.core[e]
                    self.core[contact], self.share[contact] = core, counts
                    self.tell(own, done, best, core)
                    met += self.note(q, met, corners, weights, best, True, v, ahead)
                    if ti.static(self.sided):
                        late = ti.select(self.near.radius[own] > 0.0, BETWEEN, 1.0)
                        if best > late * core and self.brake.minds_sides(own, done):
                            self.brake.notice_side(own, done, self.normal[contact])
        return met

    @ti.func
    def tell(self, a, b, depth, core):
        """Have the brake know of a point of jello a that is `depth` [m] in b, which has its core there."""
        if ti.static(self.can_brake):
            if depth > core:
                self.brake.notice(a, b)

    @ti.func
    def find_thin(self, q, met, v, ahead):
        """Count on from `met` with the nearest triangle or segment within reach of each other jello."""
        p, best, jello = self.place[q], ti.cast(FAR, float), -1
        place, end = self.near.first_place(q), self.near.listed[q]
        corners, weights = ti.Vector([0, 0, 0]), ti.Vector([0.0, 0.0, 0.0])
        for k in range(end + 1):  # one more than listed, to end with the last jello
            e, other = 0, -1
            if k < end:
                n, place = self.near.next(place)
                e = self.near.tree_order[self.near.tree_first[n]]
                other = self.near.owner[e]
            if other != jello:
                if best < FAR and met < AT_ONCE:
                    met += self.note(q, met, corners, weights, best, False, v, ahead)
                jello, best = other, FAR
            if k < end and e >= self.solid and self.may_touch(q, e) and not self.is_left_to_the_rope(q, e):
                nodes = self.near.nodes[e]
                own = ti.Vector([self.point_of[nodes[0]], self.point_of[nodes[1]], self.point_of[nodes[2]]])
                if self.are_ropes(self.near.jello[self.near.points[q]], other):
                    if ti.static(self.near.has_lines):
                        best, corners, weights = self.nearer_half(q, own, best, corners, weights)
                else:
                    best, corners, weights = nearer(self.place, p, own, best, corners, weights)
        return met

    @ti.func
    def note(self, q, number, corners, weights, distance, solid, v, ahead):
        """Write down contact `number` of point q, which is `distance` [m] from the place on a surface that it touches:
        inside a solid, or outside a thin body. Returns 0 if it is too far from that to touch within the step."""
        a, b, c = self.place[corners[0]], self.place[corners[1]], self.place[corners[2]]
        contact, out = q * AT_ONCE + number, weights[0] * a + weights[1] * b + weights[2] * c
        out -= self.own_weight(weights) * self.place[q]
        if not solid:
            out = -out
        if distance < self.least_distance(q, corners):
            out = (b - a).cross(c - a)
            if not solid:
                out = self.aside(q, corners[0], b - a, out)
        n, touches = out / ti.max(out.norm(), 1e-30), 1
        if ti.static(self.has_thin):
            apart = ti.cast(0.0, float)
            if not solid:
                own, other = self.near.jello[self.near.points[q]], self.near.jello[self.near.points[corners[0]]]
                apart = self.near.radius[own] + self.near.radius[other]
                outwards = self.difference(q, corners, weights, v).dot(n)
                touches = distance < apart + ahead * ti.abs(outwards)
                self.core[contact], self.share[contact] = 2.0 * CORE * apart, 1.0
                late = LATE * self.core[contact]
                if ti.static(self.has_thin_pairs):
                    if self.too_fast(own, other, -outwards):
                        late = 0.0
                if self.are_ropes(own, other):
                    self.share[contact] = TWICE
                    if ti.static(self.can_brake and self.near.has_lines):
                        if apart - distance > late:
                            self.brake.notice_side(own, other, n)
                self.tell(own, other, apart - distance, late)
            self.apart[contact] = apart
        if touches:
            self.corners[contact], self.weights[contact], self.normal[contact] = corners, weights, n
        return touches

    @ti.func
    def too_fast(self, a, b, inward):
        """Whether one of two thin jellos comes `inward` [m/s] on the other faster than a spring of contact stops a
        particle within HALFWAY of the distance that they keep apart: ½ k d² < ½ m v²."""
        way = HALFWAY * (self.near.radius[a] + self.near.radius[b])
        mass = ti.max(self.particle_mass[a], self.particle_mass[b])
        both_thin = ti.min(self.near.radius[a], self.near.radius[b]) > 0.0
        return both_thin and inward > 0.0 and mass * inward * inward > self.law.between(a, b)[0] * way * way

    @ti.func
    def law_of(self, contact):
        """What a contact goes by, see ContactLaw."""
        own, other = self.near.points[contact // AT_ONCE], self.near.points[self.corners[contact][0]]
        return self.law.between(self.near.jello[own], self.near.jello[other])

    @ti.func
    def difference(self, q, corners, weights, x):
        """What point q has of a field x, less what the place has that it touches."""
        d = self.own_weight(weights) * self.near.at(q, x)
        for k in ti.static(range(3)):
            d -= weights[k] * self.near.at(corners[k], x)
        return d

    @ti.func
    def between(self, contact, x):
        return self.difference(contact // AT_ONCE, self.corners[contact], self.weights[contact], x)

    @ti.func
    def depth(self, contact, x):
        """How deep [m] the contact is pressed; less than 0 where it does not touch."""
        depth = -self.between(contact, x).dot(self.normal[contact])
        if ti.static(self.has_thin):
            depth += self.apart[contact]
        return depth
