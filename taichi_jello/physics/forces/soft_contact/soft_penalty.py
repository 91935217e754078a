"""Contact of jellos with each other and with themselves: penalty springs with dashpot and friction, equal and opposite.

What a point feels that touches another jello (see contacts.py), the triangle's corners feel the other way,
shared by the place that is touched. Friction on a point that is deep below that place would be a couple and make
angular momentum: so the corners also feel forces along the normal that have no sum and take that torque up.

Springs of contact can be too soft to stop what is fast and heavy before it is out on the other side. A point that comes
near the middle of what it touches, its core, meets a dashpot there that is as hard as the step allows, for as long as
it goes on: it takes energy out and gives none back.
"""

from math import hypot

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import MutualForce, Rates, block, cut, even_block
from taichi_jello.physics.forces.collider_contact.collider_penalty import pressure
from taichi_jello.physics.forces.collider_contact.skin_penalty import steepest
from taichi_jello.physics.forces.contact_law import ContactLaw
from taichi_jello.physics.forces.soft_contact.contacts import Contacts
from taichi_jello.physics.forces.soft_contact.fast.approach_speed import Approach
from taichi_jello.physics.forces.soft_contact.shared_load import LOAD
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import AT_ONCE
from taichi_jello.physics.forces.springs.spring_state import loose
from taichi_jello.support.runtime import RuntimeProblem


@ti.func
def rub(pressed, u, friction, grip):
    limit = friction * pressed
    return -limit * grip / ti.sqrt(grip * grip * u.dot(u) + limit * limit + 1e-30) * u


STOP = 0.25  # of the mass over the step, what an explicit step stands of a dashpot where little else damps
SOFT = 0.5  # of the depth of a core, over which its dashpot grows hard
BLIND = ("vulkan", "metal")  # compiled for them, the search makes lists that stay empty


@ti.data_oriented
class Touch(MutualForce):
    title = "touch"
    energy_kind = "contact"
    reads_velocity = True
    prepares = has_curvature = True
    works = ("touch dashpots", "touch friction")

    def __init__(self, scene, particles, itself):
        body, memory = particles.body, particles.memory
        self.particles, self.frame_dt = particles, scene.solver.frame_dt
        tears = any(jello.tear_strain for jello in scene.jello)
        # With this grip all contacts of a point damp as much as one with a collider.
        self.law = ContactLaw(scene, body, memory, self.title, grip_part=0.5 / LOAD)
        self.rubs = self.law.rubs
        self.contacts = Contacts(self.title, body, memory, scene.contact.touch, itself, loose(scene), tears, self.law)
        self.brake = self.contacts.brake
        self.near, self.points, self.rounds = self.contacts.near, self.contacts.points, self.contacts.rounds
        touching = self.near.touching
        if self.near.skinned:
            for name, values in zip(("first", "around", "in_it"), touching.rows, strict=True):
                setattr(self, name, memory.table(self.title, f"points of each particle: {name}", values))
        self.force = memory.zeros(self.title, "forces", (AT_ONCE * self.points, 3))
        if self.rubs:
            self.tilt = memory.zeros(self.title, "normal forces of corners", (AT_ONCE * self.points, 3))
        self.approach = Approach(body, touching.thickness)
        self.lightest = memory.table(self.title, "lightest particle and mass", self._weights(body))
        self.stops = memory.table(self.title, "stops", np.zeros(2))
        self.damping = memory.zeros(self.title, "dashpots", (AT_ONCE * self.points,))
        self._stops = (0.0, 0.0)

    @classmethod
    def made_for(cls, scene, particles):
        itself = np.array([jello.self_contact for jello in scene.jello])
        meets = itself.any() or (len(scene.jello) > 1 and scene.contact.touch)
        if not meets or scene.contact.stiffness == 0.0:
            return []
        if (arch := particles.memory.owner.arch) in BLIND:
            raise RuntimeProblem(
                f"--arch {arch}: jellos do not feel each other there; use cpu, or contact.touch = false"
            )
        return [cls(scene, particles, itself)]

    def tuning(self):
        return self.law.tuning()

    def tune(self, name, value):
        self.law.tune(name, value)

    def steepest(self, each):
        """How stiff springs (J,) [N/m] at all points of each jello can be, over mass [1/s²]; see steepest."""
        body, touching = self.particles.body, self.near.touching
        particles = touching.points[: touching.bare]
        bare, others = float((each[body.jello] / body.mass)[particles].max(initial=0.0)), 0.0
        if len(touching.corners):
            share = touching.share[touching.bare :] * each[body.jello[touching.corners[:, 0]]]
            others = steepest(body.mass, touching.corners, touching.weights, share)
        both = body.embedded[particles].any() or touching.skin < len(touching.points)
        return bare + others if both else max(bare, others)

    def rates(self):
        """Row i of M⁻¹K sums to at most 2/m k Σ|g|, g its weight in each contact, and no load Σ|g| counts for more
        than LOAD, that of a skin's point for its share of it; the same holds for the dashpots. Friction as in contact
        with colliders."""
        law, most = self.law, 2.0 * LOAD
        sideways = law.grip if law.rubs else np.zeros_like(law.damping)
        return Rates(
            squared_frequency=most * hypot(1.0, law.friction) * self.steepest(law.stiffness),
            damping=most * self.steepest(np.maximum(law.damping, sideways)),
            damping_time=law.damping_time,
        )

    @ti.func
    def find_contacts(self, r: ti.template(), system, first, last, x, v, ahead):
        self.contacts.look(r, system, first, last, x, v, ahead)

    @ti.func
    def prepare(self, first, last, x, v, t):
        busy = self.near.state[2]
        for k in range(cut(self.points, first, busy), cut(self.points, last, busy)):
            q = self.near.busy[k]
            for contact in range(q * AT_ONCE, q * AT_ONCE + self.contacts.own[q]):
                self.force[contact] = self.press(contact, x, v)

    @staticmethod
    def _weights(body):
        """(J, 2) [kg] of each jello: its lightest particle, and all of it."""
        jellos = range(int(body.jello.max()) + 1)
        return np.array([[f(body.mass[body.jello == j]) for f in (np.min, np.sum)] for j in jellos])

    @property
    def nearest(self):
        return self.approach.least

    def parts(self, x, v, frame_dt, dt):
        return self.approach.parts(x, v, frame_dt, dt)

    def stride(self, dt, solves, damping):
        """What a dashpot in a core may have [1/s], of the lightest particle and of all of a jello: where a step is
        solved for it stops all of it within one; else no more than what the other dashpots leave of the step's limit,
        which is at 2/dt or beyond for every scheme."""
        stops = (0.0, 1.0 / dt) if solves else (STOP * max(0.0, 1.0 / dt - 0.5 * damping), 0.0)
        if stops != self._stops:
            self._stops = stops
            self.stops.from_numpy(np.array(stops, self.particles.memory.number))

    @ti.func
    def stopping(self, contact, depth, outwards):
        """The dashpot [N·s/m] that a whole contact has in the core of what it touches."""
        stops, core = ti.cast(0.0, float), self.contacts.core[contact]
        if depth > core and outwards < 0.0:
            a = self.lightest[self.near.jello[self.near.points[contact // AT_ONCE]]]
            b = self.lightest[self.near.jello[self.near.points[self.contacts.corners[contact][0]]]]
            hardness = self.stops[0] * ti.min(a[0], b[0]) + self.stops[1] * ti.min(a[1], b[1])
            stops = hardness * ti.min(1.0, (depth - core) / (SOFT * core))
        return stops

    @ti.func
    def press(self, contact, x, v):
        """The force [N] of a contact on its point."""
        n, depth, force = self.contacts.normal[contact], self.contacts.depth(contact, x), ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.rubs):
            self.tilt[contact] = force
        if depth > 0.0:
            counts, law = (
                self.contacts.part(contact // AT_ONCE) * self.contacts.share[contact],
                self.contacts.law_of(contact),
            )
            slide = self.contacts.between(contact, v)
            outwards = slide.dot(n)
            damping = law[1] + self.stopping(contact, depth, outwards)
            pressed = pressure(depth, outwards, counts * law[0], counts * damping)
            self.damping[contact] = damping
            force = pressed * n
            if ti.static(self.rubs):
                lever = -n.dot(self.contacts.between(contact, x))
                slope_a, slope_b, turning = self.slopes(contact, n, v)
                rubbed = rub(pressed, slide - outwards * n - lever * turning, law[2], counts * law[3])
                a, b = lever * slope_a.dot(rubbed), lever * slope_b.dot(rubbed)
                self.tilt[contact] = ti.Vector([a, b, -a - b])
                force += rubbed
        return force

    @ti.func
    def slopes(self, contact, n, v):
        """Of a contact within a triangle: how the weights of its first two corners grow with the place, and Σ slope
        (n · v), by how much what lies a metre below the triangle moves along it as it turns. Else zero."""
        corners, weights = self.contacts.corners[contact], self.contacts.weights[contact]
        slope_a, slope_b, turning = 0.0 * n, 0.0 * n, 0.0 * n
        if weights[0] != 0.0 and weights[1] != 0.0 and weights[2] > 0.0:
            a, b, c = (
                self.contacts.place[corners[0]],
                self.contacts.place[corners[1]],
                self.contacts.place[corners[2]],
            )
            across = (b - a).cross(c - a)
            square = across.norm_sqr()
            if square > 0.0:
                slope_a, slope_b = across.cross(c - b) / square, across.cross(a - c) / square
                last = n.dot(self.near.at(corners[2], v))
                turning = slope_a * (n.dot(self.near.at(corners[0], v)) - last)
                turning += slope_b * (n.dot(self.near.at(corners[1], v)) - last)
        return slope_a, slope_b, turning

    @ti.func
    def felt(self, q):
        """The force [N] on a point."""
        force = ti.Vector([0.0, 0.0, 0.0])
        for k in range(self.contacts.rounds_of(q)):
            contact, g = self.contacts.pressing(q, k)
            if g != 0.0:
                force += g * self.force[contact]
                if ti.static(self.rubs):
                    for k in ti.static(range(3)):
                        if self.contacts.corners[contact][k] == q:
                            force -= self.tilt[contact][k] * self.contacts.normal[contact]
        return force

    @ti.func
    def on(self, i, x, v, t):
        force = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.near.skinned):
            for k in range(self.first[i], self.first[i + 1]):
                if self.contacts.listed[self.around[k]] > 0:
                    force += self.in_it[k] * self.felt(self.around[k])
        else:
            if self.contacts.point_of[i] >= 0:
                force = self.felt(self.contacts.point_of[i])
        return force

    @ti.func
    def resists(self, q, c):
        """The weights of a contact, without their signs, sum to 2: twice |g| times its block bounds what ties this
        point to the others. It stiffens along its force; across, friction at its stickiest."""
        total = even_block(ti.cast(0.0, float))
        for k in range(self.contacts.rounds_of(q)):
            contact, g = self.contacts.pressing(q, k)
            law = self.contacts.law_of(contact)
            pull = self.force[contact].norm()
            if g != 0.0 and pull > 0.0:
                across = ti.cast(0.0, float)
                if ti.static(self.rubs):
                    across = law[3] / c
                both = 2.0 * ti.abs(g) * self.contacts.part(contact // AT_ONCE) * self.contacts.share[contact]
                along = law[0] + self.damping[contact] / c
                total += both * block(across, along, self.force[contact] / pull)
        return total

    @ti.func
    def curvature(self, i, x, v, t, c):
        """That of the points that the particle belongs to, each times its part: the parts in one point sum to 1."""
        total = even_block(ti.cast(0.0, float))
        if ti.static(self.near.skinned):
            for k in range(self.first[i], self.first[i + 1]):
                if self.contacts.listed[self.around[k]] > 0:
                    total += self.in_it[k] * self.resists(self.around[k], c)
        else:
            if self.contacts.point_of[i] >= 0:
                total = self.resists(self.contacts.point_of[i], c)
        return total

    @ti.func
    def stored(self, q, x):
        """½ k depth² of the contacts of a point; k as much as they count for."""
        total = ti.cast(0.0, float)
        for contact in range(q * AT_ONCE, q * AT_ONCE + self.contacts.own[q]):
            depth = ti.max(0.0, self.contacts.depth(contact, x))
            stiffness = self.contacts.part(q) * self.contacts.law_of(contact)[0] * self.contacts.share[contact]
            total += 0.5 * stiffness * depth * depth
        return total

    @ti.func
    def energy(self, i, x, t):
        """A particle's part in what the points that it belongs to have stored."""
        total = ti.cast(0.0, float)
        if ti.static(self.near.skinned):
            for k in range(self.first[i], self.first[i + 1]):
                total += self.in_it[k] * self.stored(self.around[k], x)
        else:
            if self.contacts.point_of[i] >= 0:
                total = self.stored(self.contacts.point_of[i], x)
        return total

    @ti.func
    def lost(self, q, x, v):
        """The power [W] of dashpots and of friction in the contacts of a point, as in `press`: (p - kδ)s and rub · w
        for a pressure p and speeds s apart and w across."""
        total = ti.Vector([0.0, 0.0])
        for contact in range(q * AT_ONCE, q * AT_ONCE + self.contacts.own[q]):
            n, depth = self.contacts.normal[contact], self.contacts.depth(contact, x)
            if depth > 0.0:
                counts, slide = self.contacts.part(q) * self.contacts.share[contact], self.contacts.between(contact, v)
                law = self.contacts.law_of(contact)
                outwards = slide.dot(n)
                damping = law[1] + self.stopping(contact, depth, outwards)
                pressed = pressure(depth, outwards, counts * law[0], counts * damping)
                total[0] += (pressed - counts * law[0] * depth) * outwards
                if ti.static(self.rubs):
                    lever = -n.dot(self.contacts.between(contact, x))
                    across = slide - outwards * n - lever * self.slopes(contact, n, v)[2]
                    total[1] += rub(pressed, across, law[2], counts * law[3]).dot(across)
        return total

    @ti.func
    def powers(self, i, x, v, t):
        """A particle's part in what the points that it belongs to lose."""
        total = ti.Vector([0.0, 0.0])
        if ti.static(self.near.skinned):
            for k in range(self.first[i], self.first[i + 1]):
                total += self.in_it[k] * self.lost(self.around[k], x, v)
        else:
            if self.contacts.point_of[i] >= 0:
                total = self.lost(self.contacts.point_of[i], x, v)
        return total

    def set_state(self, law):
        self.contacts.obey(law)

    def begin_frame(self, start, end):
        self.near.begin_frame(start)

    def refresh(self, system, t, dt):
        self.near.refresh(system, t, dt, self.frame_dt)

    @property
    def fresh(self):
        return self.near.fresh

    def forget(self):
        self.near.fresh = False

    @ti.func
    def watch(self, first, last, x, v, t, dt):
        self.near.watch(first, last, x, v, t, dt)

    @ti.func
    def stale(self):
        return self.near.state[0]
