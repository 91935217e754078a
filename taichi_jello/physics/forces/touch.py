"""Contact of jellos with each other and with themselves: penalty springs with dashpot and friction, equal and opposite.

A point of one jello that is inside a cell of another is pulled to the nearest of the triangles by which that cell is
left through the undeformed body (the idea of McAdams et al. 2011, "Efficient elasticity for character skinning", 5),
so that a point deep inside leaves by the nearest face however the body is crushed. Sheets and ropes have no inside:
points keep a radius away from their triangles and segments. What a point feels, the triangle's corners feel the other
way, shared by the place that is touched.
"""

from dataclasses import replace
from math import hypot, sqrt

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce, Rates, block, even_block
from taichi_jello.physics.forces.contact import pressure, rub
from taichi_jello.physics.forces.skin_contact import SkinContact
from taichi_jello.physics.neighbours import Neighbours
from taichi_jello.physics.touching import FAR, Touching

AT_ONCE = 2  # contacts of one point, each with another jello; more are rare and left out
SLOTS = 12  # contacts of a point that are listed; if it has more, all contacts are looked through
UNIT = 1024  # a whole contact in the count of what presses on a point, in which a corner has its share
TINY = 1e-9  # m
SAME = 0.5  # the cosine above which a face faces as the point does that would leave by it
LOAD = 2  # whole contacts that press on one point with full stiffness: its own and one that it is a corner of


@ti.func
def nearest(p, a, b, c):
    """The weights of the corners a, b, c in the point of their triangle that is nearest to p; of a segment if b = c
    (Ericson, Real-Time Collision Detection, 5.1.5)."""
    ab, ac, ap, bp, cp = b - a, c - a, p - a, p - b, p - c
    d1, d2, d3, d4, d5, d6 = ab.dot(ap), ac.dot(ap), ab.dot(bp), ac.dot(bp), ab.dot(cp), ac.dot(cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    w1, w2 = ti.cast(0.0, float), ti.cast(0.0, float)
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        w1 = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        w1 = d1 / (d1 - d3)
    elif d6 >= 0.0 and d5 <= d6:
        w2 = 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w2 = d2 / (d2 - d6)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        w2 = (d4 - d3) / (d4 - d3 + d5 - d6)
        w1 = 1.0 - w2
    else:
        w1, w2 = vb / (va + vb + vc), vc / (va + vb + vc)
    return ti.Vector([1.0 - w1 - w2, w1, w2])


@ti.func
def holds(d, a, b, g):
    """Whether the tetrahedron with edges a, b, g from one corner holds the point d from there, either way round."""
    normal = b.cross(g)
    volume = a.dot(normal)
    side = ti.select(volume < 0.0, -1.0, 1.0)
    u, v, w = d.dot(normal) * side, a.dot(d.cross(g)) * side, a.dot(b.cross(d)) * side
    return volume != 0.0 and u >= 0.0 and v >= 0.0 and w >= 0.0 and u + v + w <= ti.abs(volume)


@ti.data_oriented
class Touch(ParticleForce):
    title = "touch"
    energy_kind = "contact"
    reads_velocity = True
    prepares = tidies = watches = has_curvature = mutual = True

    def __init__(self, scene, particles, itself):
        body, memory = particles.body, particles.memory
        self.particles, self.contact, self.number = particles, scene.contact, memory.number
        touching = Touching.of(body)
        self.near = Neighbours(self.title, body, memory, touching, scene.contact.touch, itself)
        self.points, self.solid = len(touching.points), touching.solid
        self.has_solid, self.has_thin = touching.solid > 0, touching.solid < len(touching.nodes)
        self.rubs, self.frame_dt = scene.contact.friction > 0.0, scene.solver.frame_dt

        def table(name, values):
            return memory.table(self.title, name, values)

        contacts, point_of = AT_ONCE * self.points, np.full(memory.padded, -1, np.int32)
        point_of[touching.points[: touching.bare]] = np.arange(touching.bare)
        self.law = table("law", np.array([self._law()]))
        self.point_of = table("point of each particle", point_of)
        if self.has_solid:
            self.exits, self.triangles = table("exits of each cell", touching.exits), table("exits", touching.triangles)
            self.exit_start = table("starts of exits", touching.start)
            self.way, self.inner = table("ways to them", touching.way), table("inner neighbours", touching.inner)
            self.spacing = table("spacing", touching.spacing)
        self.inverse_mass = self._steepest(body, touching)
        if self.near.skinned:
            self.shares = table("shares", touching.share)
            first, around, parts = touching.rows
            self.first, self.around = table("points of each particle", first), table("those points", around)
            self.in_it = table("its parts in them", parts)
        self.force = memory.zeros(self.title, "forces", (contacts, 3))
        self.depth = memory.zeros(self.title, "depths", (contacts,))
        self.corners = memory.zeros(self.title, "touched corners", (contacts, 3), whole=True)
        self.weights = memory.zeros(self.title, "their weights", (contacts, 3))
        self.own = memory.zeros(self.title, "contacts of each point", (self.points,), whole=True)
        self.load = memory.zeros(self.title, "loads", (self.points,), whole=True)
        self.listed = memory.zeros(self.title, "listed contacts", (self.points,), whole=True)
        self.list = memory.zeros(self.title, "lists", (self.points * SLOTS,), whole=True)

    @classmethod
    def made_for(cls, scene, particles):
        itself = np.array([jello.self_contact for jello in scene.jello])
        meets = itself.any() or (len(scene.jello) > 1 and scene.contact.touch)
        return [cls(scene, particles, itself)] if meets and scene.contact.stiffness > 0.0 else []

    @property
    def grip(self):
        """The viscous part of friction [N·s/m]: with it all contacts of a point damp as much as one with a collider."""
        return sqrt(self.contact.stiffness * float(self.particles.body.mass.min())) / (2.0 * LOAD)

    @staticmethod
    def _steepest(body, touching):
        """How stiff unit springs at all points can be, over mass [1/kg]; see SkinContact."""
        bare = 1.0 / float(body.mass[~body.embedded].min(initial=np.inf))
        return max(bare, SkinContact._steepest(body, touching.share[touching.bare :]) if len(body.skin) else 0.0)

    def _law(self):
        return self.contact.stiffness, self.contact.damping, self.contact.friction, self.grip

    def tuning(self):
        numbers = {"contact_stiffness": self.contact.stiffness, "contact_damping": self.contact.damping}
        return numbers | ({"friction": self.contact.friction} if self.rubs else {})

    def tune(self, name, value):
        self.contact = replace(self.contact, **{name.removeprefix("contact_"): float(value)})
        self.law.from_numpy(np.array([self._law()], self.number))

    def rates(self):
        """Row i of M⁻¹K sums to at most 2/m k Σ|g|, g its weight in each contact, and no load Σ|g| counts for more
        than LOAD, that of a skin's point for its share of it; the same holds for the dashpots. Friction as in contact
        with colliders."""
        k, c = self.contact.stiffness, self.contact.damping
        most = 2.0 * LOAD * self.inverse_mass
        return Rates(
            squared_frequency=most * k * hypot(1.0, self.contact.friction),
            damping=most * max(c, self.grip if self.rubs else 0.0),
            damping_time=c / k if k > 0.0 else np.inf,
        )

    @ti.func
    def holds_point(self, e, p, x):
        """Whether cell e, cut into six tetrahedra around its diagonal, holds the point p."""
        nodes = self.near.nodes[e]
        low = x[nodes[0]]
        high = low
        for k in ti.static(range(1, 8)):
            low, high = ti.min(low, x[nodes[k]]), ti.max(high, x[nodes[k]])
        inside = False
        if (p >= low).all() and (p <= high).all():
            a = x[nodes[0]]
            for k in range(6):  # along one axis from corner 0, then along another: the six ways to corner 7
                if not inside:
                    b = x[self.near.nodes[e][1 << (k >> 1)]]
                    c = x[self.near.nodes[e][7 - (1 << ((k >> 1) + 1 + (k & 1)) % 3)]]
                    inside = holds(p - a, b - a, c - a, x[nodes[7]] - a)
        return inside

    @ti.func
    def prepare(self, first, last, x, v, t):
        """The contacts of the points first … last - 1: with each other jello the first of its cells that holds the
        point, or the nearest of its triangles and segments within reach."""
        for q in range(first, last):
            p = self.near.at(q, x)
            met, jello, solid, best = 0, -1, False, ti.cast(FAR, float)
            corners, weights = ti.Vector([0, 0, 0]), ti.Vector([0.0, 0.0, 0.0])
            end = self.near.start[q + 1]
            for k in range(self.near.start[q], end + 1):  # one more than listed, to end with the last jello
                e, other = 0, -1
                if k < end:
                    e = self.near.found[k]
                    other = self.near.jello[self.near.nodes[e][0]]
                if other != jello:
                    if best < FAR and met < AT_ONCE:
                        self.press(q, met, corners, weights, best, solid, x, v)
                        met += 1
                    jello, solid, best = other, e < self.solid, FAR
                if ti.static(self.has_solid):  # noqa: SIM102
                    if k < end and solid and best == FAR:  # noqa: SIM102
                        if self.holds_point(e, p, x):
                            best, corners, weights = self.leave(e, p, p - x[self.inner[q]], x)
                if ti.static(self.has_thin):  # noqa: SIM102
                    if k < end and not solid:
                        nodes = self.near.nodes[e]
                        own = ti.Vector([self.point_of[nodes[0]], self.point_of[nodes[1]], self.point_of[nodes[2]]])
                        best, corners, weights = self.nearer(p, own, best, corners, weights, x)
            self.own[q] = met

    @ti.func
    def leave(self, e, p, out, x):
        """How the point p of a surface that faces `out` leaves cell e: by the nearest face, of those by the shortest
        ways through the undeformed body that do not face as the point itself does. (Without this two jellos that
        overlap by half would crawl round each other, each leaving by the other's sides.)"""
        a = x[self.near.nodes[e][0]]
        same, least = 0, ti.cast(FAR, float)
        for k in range(6):
            axis = (x[self.near.nodes[e][4 >> (k >> 1)]] - a) * (2.0 * (k & 1) - 1.0)
            if self.way[e][k] > 0.0 and axis.dot(out) > SAME * axis.norm() * out.norm():
                same |= 1 << k
            else:
                least = ti.min(least, self.way[e][k])
        least += self.spacing[self.near.jello[self.near.nodes[e][0]]]
        best, corners, weights = ti.cast(FAR, float), ti.Vector([0, 0, 0]), ti.Vector([0.0, 0.0, 0.0])
        for k in range(6):
            if (same >> k) & 1 == 0 and self.way[e][k] <= least and least < FAR:
                group = self.exits[e][k]
                for t in range(self.exit_start[group], self.exit_start[group + 1]):
                    best, corners, weights = self.nearer(p, self.triangles[t], best, corners, weights, x)
        if ti.static(self.near.skinned):  # noqa: SIM102
            if self.way[e][0] == 0.0 and self.is_outside(p, corners, x):
                best = FAR
        return best, corners, weights

    @ti.func
    def is_outside(self, p, corners, x):
        """Whether p is on the outer side of a skin's triangle, the nearest one to it."""
        a, b, c = self.near.at(corners[0], x), self.near.at(corners[1], x), self.near.at(corners[2], x)
        return (b - a).cross(c - a).dot(p - a) > 0.0

    @ti.func
    def nearer(self, p, triangle, best, corners, weights, x):
        """The nearest place so far: its distance from p, its triangle's corners and their weights."""
        a, b, c = self.near.at(triangle[0], x), self.near.at(triangle[1], x), self.near.at(triangle[2], x)
        w = nearest(p, a, b, c)
        distance = (w[0] * a + w[1] * b + w[2] * c - p).norm()
        less = distance < best
        return ti.min(distance, best), ti.select(less, triangle, corners), ti.select(less, w, weights)

    @ti.func
    def press(self, q, number, corners, weights, distance, solid, x, v):
        """Write down contact `number` of point q, which is `distance` [m] from the place on a surface that it touches:
        inside a solid, or outside a thin body."""
        i, j = self.near.points[q], self.near.points[corners[0]]
        a, b, c = self.near.at(corners[0], x), self.near.at(corners[1], x), self.near.at(corners[2], x)
        place, speed = weights[0] * a + weights[1] * b + weights[2] * c, ti.Vector([0.0, 0.0, 0.0])
        for k in ti.static(range(3)):
            speed += weights[k] * self.near.at(corners[k], v)
        p = self.near.at(q, x)
        out = ti.select(solid, place - p, p - place)
        if distance < TINY:
            out = (b - a).cross(c - a)
        n = out / ti.max(out.norm(), 1e-30)
        depth = ti.cast(distance, float)
        if not solid:
            depth = self.near.radius[self.near.jello[i]] + self.near.radius[self.near.jello[j]] - distance
        contact, law, slide = q * AT_ONCE + number, self.part(q) * self.law[0], self.near.at(q, v) - speed
        force = ti.Vector([0.0, 0.0, 0.0])
        if depth > 0.0:
            outwards = slide.dot(n)
            pressed = pressure(depth, outwards, law[0], law[1])
            force = pressed * n
            if ti.static(self.rubs):
                force += rub(pressed, slide - outwards * n, self.law[0][2], law[3])
            self.note(contact, q, self.part(q))
            for k in ti.static(range(3)):
                if weights[k] > 0.0:
                    self.note(contact, corners[k], self.part(q) * weights[k])
        self.force[contact], self.depth[contact] = force, ti.max(depth, 0.0)
        self.corners[contact], self.weights[contact] = corners, weights

    @ti.func
    def part(self, q):
        """How much of a particle of the surface the point stands for."""
        share = ti.cast(1.0, float)
        if ti.static(self.near.skinned):
            share = self.shares[q]
        return share

    @ti.func
    def note(self, contact, q, weight):
        """List a contact with point q, on which it presses with its weight."""
        ti.atomic_add(self.load[q], int(UNIT * weight / self.part(q) + 0.5))
        place = ti.atomic_add(self.listed[q], 1)
        if place < SLOTS:
            self.list[q * SLOTS + place] = contact

    @ti.func
    def tidy(self, first, last):
        for q in range(first, last):
            self.load[q], self.listed[q] = 0, 0

    @ti.func
    def share(self, contact):
        """What a contact counts for: less where more press on one of its points than may with full stiffness."""
        most = ti.max(self.load[contact // AT_ONCE], LOAD * UNIT)
        for k in ti.static(range(3)):
            if self.weights[contact][k] > 0.0:
                most = ti.max(most, self.load[self.corners[contact][k]])
        return float(LOAD * UNIT) / most

    @ti.func
    def following(self, q, before, r):
        """The contact in round r that presses on point q: of those listed, in any order, the next by number after
        `before`; where not all are listed, contact r."""
        contact, listed = r, self.listed[q]
        if listed <= SLOTS:
            contact = AT_ONCE * self.points
            for place in range(q * SLOTS, q * SLOTS + listed):
                if before < self.list[place] < contact:
                    contact = self.list[place]
        return contact

    @ti.func
    def rounds(self, q):
        return ti.select(self.listed[q] > SLOTS, AT_ONCE * self.points, self.listed[q])

    @ti.func
    def weight_in(self, contact, q):
        """The weight g of point q in a contact: 1 for the point itself, less than 0 for a corner."""
        g = ti.cast(0.0, float)
        if contact % AT_ONCE < self.own[contact // AT_ONCE]:
            if contact // AT_ONCE == q:
                g += 1.0
            for k in ti.static(range(3)):
                if self.corners[contact][k] == q:
                    g -= self.weights[contact][k]
        return g

    @ti.func
    def felt(self, q):
        """The force [N] on a point. Contacts were listed in any order; they are added in that of their numbers."""
        force, before = ti.Vector([0.0, 0.0, 0.0]), -1
        for r in range(self.rounds(q)):
            contact = self.following(q, before, r)
            before = contact
            g = self.weight_in(contact, q)
            if g != 0.0:
                force += g * self.share(contact) * self.force[contact]
        return force

    @ti.func
    def on(self, i, x, v, t):
        force = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.near.skinned):
            for k in range(self.first[i], self.first[i + 1]):
                if self.listed[self.around[k]] > 0:
                    force += self.in_it[k] * self.felt(self.around[k])
        else:
            if self.point_of[i] >= 0:
                force = self.felt(self.point_of[i])
        return force

    @ti.func
    def resists(self, q, c):
        """The weights of a contact, without their signs, sum to 2: twice |g| times its block bounds what ties this
        point to the others. It stiffens along its force; across, friction at its stickiest."""
        total, before, law = even_block(ti.cast(0.0, float)), -1, self.law[0]
        for r in range(self.rounds(q)):
            contact = self.following(q, before, r)
            before = contact
            g, pull = ti.abs(self.weight_in(contact, q)), self.force[contact].norm()
            if g * pull > 0.0:
                across = ti.cast(0.0, float)
                if ti.static(self.rubs):
                    across = law[3] / c
                both = 2.0 * g * self.part(contact // AT_ONCE) * self.share(contact)
                total += both * block(across, law[0] + law[1] / c, self.force[contact] / pull)
        return total

    @ti.func
    def curvature(self, i, x, v, t, c):
        """That of the points that the particle belongs to, each times its part: the parts in one point sum to 1."""
        total = even_block(ti.cast(0.0, float))
        if ti.static(self.near.skinned):
            for k in range(self.first[i], self.first[i + 1]):
                if self.listed[self.around[k]] > 0:
                    total += self.in_it[k] * self.resists(self.around[k], c)
        else:
            if self.point_of[i] >= 0:
                total = self.resists(self.point_of[i], c)
        return total

    @ti.func
    def stored(self, q):
        """½ k depth² of the contacts of a point; k as much as they count for."""
        total = ti.cast(0.0, float)
        for contact in range(q * AT_ONCE, q * AT_ONCE + self.own[q]):
            depth = self.depth[contact]
            total += 0.5 * self.part(q) * self.law[0][0] * self.share(contact) * depth * depth
        return total

    @ti.func
    def energy(self, i, x, t):
        """A particle's part in what the points that it belongs to have stored."""
        total = ti.cast(0.0, float)
        if ti.static(self.near.skinned):
            for k in range(self.first[i], self.first[i + 1]):
                total += self.in_it[k] * self.stored(self.around[k])
        else:
            if self.point_of[i] >= 0:
                total = self.stored(self.point_of[i])
        return total

    def refresh(self, x, v, positions, dt):
        self.near.refresh(x, v, positions, dt, self.frame_dt)

    @property
    def fresh(self):
        return self.near.fresh

    def forget(self):
        self.near.fresh = False

    @ti.func
    def watch(self, first, last, x, v, dt):
        self.near.watch(first, last, x, v, dt)

    @ti.func
    def stale(self):
        return self.near.state[0]
