"""Contact of jellos with each other and with themselves: penalty springs with dashpot and friction, equal and opposite.

The force on a point that touches acts the other way on the corners of the touched triangle, shared out by the weights
of the touched place. Friction at a point that is deep below that place would be a couple and make angular momentum: the
corners also feel forces along the normal, of sum zero, that balance its torque.
"""

from math import hypot
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import MutualForce, Rates, block, cut, even_block
from taichi_jello.physics.forces.collider_contact.collider_penalty import pressure
from taichi_jello.physics.forces.collider_contact.friction import cone, friction_force
from taichi_jello.physics.forces.collider_contact.surface_points import steepest
from taichi_jello.physics.forces.contact_law import ContactLaw
from taichi_jello.physics.forces.soft_contact.bristles import Bristles
from taichi_jello.physics.forces.soft_contact.contacts import FULL_CONTACTS
from taichi_jello.physics.forces.soft_contact.fast.approach_speed import Approach
from taichi_jello.physics.forces.soft_contact.narrow_phase import ROUNDS, NarrowPhase
from taichi_jello.physics.forces.soft_contact.search.neighbour_list import BUSY, STALE, NeighbourList
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import Touching
from taichi_jello.physics.forces.soft_contact.surface.surface_fields import SurfaceFields
from taichi_jello.physics.forces.springs.spring_state import SpringState, loose
from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Scene
from taichi_jello.support.runtime import RuntimeProblem

UNSUPPORTED = ("vulkan", "metal")  # compiled for them, the search makes lists that stay empty


@ti.data_oriented
class Touch(MutualForce):
    title = "touch"
    energy_kind = "contact"
    reads_velocity = True
    prepares = has_curvature = True
    works = ("touch dashpots", "touch friction")
    rounds = ROUNDS

    def __init__(self, scene: Scene, particles: Particles, itself: np.ndarray):
        body, memory = particles.body, particles.memory
        self.particles = particles
        touching = Touching.of(body, loose(scene))
        # With this grip all contacts of a point damp as much as one with a collider.
        self.law = ContactLaw(scene, body, memory, self.title, grip_part=0.5 / FULL_CONTACTS)
        self.rubs = self.ends_steps = self.law.rubs
        self.surface = SurfaceFields(self.title, body, memory, touching, scene.contact.touch, itself)
        self.points = self.surface.count
        self.near = NeighbourList(self.title, body, memory, self.surface, scene.solver.frame_dt)
        self.refresh, self.watch = self.near.refresh, self.near.watch
        tears = any(jello.tear_strain for jello in scene.jello)
        narrow = NarrowPhase(self.title, body, memory, self.surface, self.near, self.law, tears)
        self.narrow, self.contacts, self.brake = narrow, narrow.contacts, narrow.brake
        names = ("first", "points", "weights")
        self.first, self.around, self.part_in = (
            memory.table(self.title, f"points of each particle: {name}", values)
            for name, values in zip(names, touching.points_of_particles(len(body)), strict=True)
        )
        count = self.contacts.per_point * self.points
        self.force = memory.zeros(self.title, "forces", (count, 3))
        if self.rubs:
            self.tilt = memory.zeros(self.title, "normal forces of corners", (count, 3))
            self.sticking = memory.zeros(self.title, "parts of friction that hold", (count,))
            self.bristles = Bristles(self.title, memory, count, self.contacts.per_point)
        self.approach = Approach(body, touching.shapes.thickness)
        self.nearest = self.approach.least

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list[Any]:
        itself = np.array([jello.self_contact for jello in scene.jello])
        meets = itself.any() or (len(scene.jello) > 1 and scene.contact.touch)
        if not meets or scene.contact.stiffness == 0.0:
            return []
        if (arch := particles.memory.owner.arch) in UNSUPPORTED:
            raise RuntimeProblem(
                f"--arch {arch}: jellos do not feel each other there; use cpu, or contact.touch = false"
            )
        return [cls(scene, particles, itself)]

    def tuning(self) -> dict[str, float]:
        return self.law.tuning()

    def tune(self, name: str, value: float) -> None:
        self.law.tune(name, value)

    def steepest(self, each: np.ndarray) -> float:
        """How stiff springs (J,) [N/m] at all points of each jello can be, over mass [1/s²]; see steepest."""
        body, touching = self.particles.body, self.surface.touching
        alone = np.repeat(touching.points[: touching.bare, None], 8, 1), np.eye(1, 8).repeat(touching.bare, 0)
        corners = np.concatenate([alone[0], touching.corners])
        weights = np.concatenate([alone[1], touching.weights])
        return steepest(body.mass, corners, weights, touching.share * each[body.jello[corners[:, 0]]])

    def rates(self) -> Rates:
        """Row i of M⁻¹K sums to at most 2/m k Σ|g|, g its weight in each contact, and Σ|g| counts for no more than
        FULL_CONTACTS, that of a skin's point for its share of it; the same holds for the dashpots. Friction as in
        contact with colliders."""
        law, most = self.law, 2.0 * FULL_CONTACTS
        sideways = law.grip if law.rubs else np.zeros_like(law.damping)
        return Rates(
            squared_frequency=most * hypot(1.0, law.friction) * self.steepest(law.stiffness),
            damping=most * self.steepest(np.maximum(law.damping, sideways)),
            damping_time=law.damping_time,
        )

    def parts(self, x: np.ndarray, v: np.ndarray, frame_dt: float, dt: float) -> int:
        return self.approach.parts(x, v, frame_dt, dt)

    def set_state(self, state: SpringState) -> None:
        self.narrow.set_state(state)

    def begin_frame(self, start: float, end: float) -> None:
        self.near.begin_frame(start)

    @property
    def fresh(self) -> bool:
        return self.near.fresh

    def forget(self) -> None:
        self.near.fresh = False

    @ti.func
    def stale(self):
        return self.near.state[STALE]

    def remembered(self) -> dict[str, np.ndarray]:
        return self.bristles.remembered() if self.rubs else {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        if self.rubs:
            self.bristles.recall(memory)

    @ti.func
    def find_contacts(self, r: ti.template(), system, first, last, x, v, ahead):
        self.narrow.find_contacts(r, system, first, last, x, v, ahead)
        if ti.static(self.rubs and r == ROUNDS - 1):
            some = self.near.state[BUSY]
            for k in range(system.share_of(first, some), system.share_of(last, some)):
                start = self.near.busy[k] * self.contacts.per_point
                for contact in range(start, start + self.contacts.count[self.near.busy[k]]):
                    _own, other = self.contacts.jellos(contact)
                    n = self.contacts.normal[contact]
                    self.bristles.begin(contact, other, n, self._along(contact, n, system.state.x))

    @ti.func
    def end_step(self, system, first, last, x, t):
        system.wait_for_team()  # until x of all particles is there
        for q in range(system.share_of(first, self.points), system.share_of(last, self.points)):
            start = q * self.contacts.per_point
            for contact in range(start, start + self.contacts.per_point):
                depth = ti.cast(0.0, float)
                if contact < start + self.contacts.count[q]:
                    depth = self.contacts.depth(contact, x)
                if depth > 0.0:
                    _own, other = self.contacts.jellos(contact)
                    along = self._along(contact, self.contacts.normal[contact], x)
                    self.bristles.end(contact, other, along, self.contacts.law_of(contact)[2] * depth)
                else:
                    self.bristles.let_go(contact)

    @ti.func
    def prepare(self, first, last, x, v, t):
        some = self.near.state[BUSY]
        for k in range(cut(self.points, first, some), cut(self.points, last, some)):
            start = self.near.busy[k] * self.contacts.per_point
            for contact in range(start, start + self.contacts.count[self.near.busy[k]]):
                self._press(contact, x, v)

    @ti.func
    def _press(self, contact, x, v):
        """Store what a contact does to its point."""
        depth, force, tilt = self.contacts.depth(contact, x), ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0])
        if depth > 0.0:
            pressed, _damped, rubbed, _heat, lean = self._push(contact, depth, x, v)
            force, tilt = pressed * self.contacts.normal[contact] + rubbed, lean
        self.force[contact] = force
        if ti.static(self.rubs):
            self.tilt[contact] = tilt

    @ti.func
    def _push(self, contact, depth, x, v):
        """Of a contact at a depth [m]: the normal force [N], the power [W] of its dashpot, friction [N] and its power,
        and the forces along the normal that balance its torque on the corners."""
        n, scale, law = self.contacts.normal[contact], self.contacts.scale(contact), self.contacts.law_of(contact)
        slide = self.contacts.between(contact, v)
        outwards = slide.dot(n)
        pressed = pressure(depth, outwards, scale * law[0], scale * law[1])
        damped = (pressed - scale * law[0] * depth) * outwards
        rubbed, tilt, heat = 0.0 * n, 0.0 * n, 0.0 * depth
        if ti.static(self.rubs):
            lever = -n.dot(self.contacts.between(contact, x))
            slope_a, slope_b, turning = self._slopes(contact, n, v)
            across = slide - outwards * n - lever * turning
            stretch = self._along(contact, n, x) - self.bristles.offset[contact]
            k, grip = scale * law[0], scale * law[3]
            rubbed = friction_force(pressed, stretch, across, law[2], k, grip)
            self.sticking[contact] = cone(k * stretch + grip * across, law[2] * pressed)
            heat = rubbed.dot(across)
            a, b = lever * slope_a.dot(rubbed), lever * slope_b.dot(rubbed)
            tilt = ti.Vector([a, b, -a - b])
        return pressed, damped, rubbed, heat, tilt

    @ti.func
    def _along(self, contact, n, x):
        """Of a field x, positions or velocities: by how much a contact's point differs along the surface from what
        lies as deep below the touched place."""
        apart, lever = self.contacts.between(contact, x), self.contacts.lever_when_found(contact)
        return apart - apart.dot(n) * n - lever * self._slopes(contact, n, x)[2]

    @ti.func
    def _slopes(self, contact, n, v):
        """Of a contact within a triangle: the gradients of the weights of its first two corners, and Σ gradient n · v:
        how fast what lies a metre below the triangle moves along it as it turns. Else zero."""
        corners, weights = self.contacts.corners[contact], self.contacts.weights[contact]
        slope_a, slope_b, turning = 0.0 * n, 0.0 * n, 0.0 * n
        if weights[0] != 0.0 and weights[1] != 0.0 and weights[2] > 0.0:
            place = ti.static(self.contacts.place)
            a, b, c = place[corners[0]], place[corners[1]], place[corners[2]]
            across = (b - a).cross(c - a)
            square = across.norm_sqr()
            if square > 0.0:
                slope_a, slope_b = across.cross(c - b) / square, across.cross(a - c) / square
                last = n.dot(self.surface.at(corners[2], v))
                turning = slope_a * (n.dot(self.surface.at(corners[0], v)) - last)
                turning += slope_b * (n.dot(self.surface.at(corners[1], v)) - last)
        return slope_a, slope_b, turning

    @ti.func
    def on(self, i, x, v, t):
        total = ti.Vector([0.0, 0.0, 0.0])
        for k in range(self.first[i], self.first[i + 1]):
            q, force = self.around[k], ti.Vector([0.0, 0.0, 0.0])
            start = self.contacts.pressing_start[q]
            for p in range(start, start + self.contacts.pressing_count[q]):
                contact = self.contacts.pressing[p]
                force += self.contacts.weight_in[p] * self.force[contact]
                if ti.static(self.rubs):
                    for corner in ti.static(range(3)):
                        if self.contacts.corners[contact][corner] == q:
                            force -= self.tilt[contact][corner] * self.contacts.normal[contact]
            total += self.part_in[k] * force
        return total

    @ti.func
    def curvature(self, i, x, v, t, c):
        """The weights of a contact, without their signs, sum to 2: twice |g| times its block bounds what ties a point
        to the others. It stiffens along its force; across, as the friction that sticks now."""
        total = even_block(ti.cast(0.0, float))
        for k in range(self.first[i], self.first[i + 1]):
            q, at_point = self.around[k], even_block(ti.cast(0.0, float))
            start = self.contacts.pressing_start[q]
            for p in range(start, start + self.contacts.pressing_count[q]):
                contact = self.contacts.pressing[p]
                law, pull = self.contacts.law_of(contact), self.force[contact].norm()
                if pull > 0.0:
                    across = ti.cast(0.0, float)
                    if ti.static(self.rubs):
                        across = self.sticking[contact] * (law[0] + law[3] / c)
                    both = 2.0 * ti.abs(self.contacts.weight_in[p]) * self.contacts.scale(contact)
                    along = law[0] + law[1] / c
                    at_point += both * block(across, along, self.force[contact] / pull)
            total += self.part_in[k] * at_point
        return total

    @ti.func
    def energy(self, i, x, t):
        """The particle's part of ½ k depth² in the contacts of its points."""
        total = ti.cast(0.0, float)
        for k in range(self.first[i], self.first[i + 1]):
            start, stored = self.around[k] * self.contacts.per_point, ti.cast(0.0, float)
            for contact in range(start, start + self.contacts.count[self.around[k]]):
                depth = ti.max(0.0, self.contacts.depth(contact, x))
                stored += 0.5 * self.contacts.scale(contact) * self.contacts.law_of(contact)[0] * depth * depth
            total += self.part_in[k] * stored
        return total

    @ti.func
    def powers(self, i, x, v, t):
        """The particle's part of the power of dashpots and friction in the contacts of its points."""
        total = ti.Vector([0.0, 0.0])
        for k in range(self.first[i], self.first[i + 1]):
            start = self.around[k] * self.contacts.per_point
            for contact in range(start, start + self.contacts.count[self.around[k]]):
                depth = self.contacts.depth(contact, x)
                if depth > 0.0:
                    _pressed, damped, _rubbed, heat, _tilt = self._push(contact, depth, x, v)
                    total += self.part_in[k] * ti.Vector([damped, heat])
        return total
