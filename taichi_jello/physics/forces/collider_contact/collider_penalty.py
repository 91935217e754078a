"""Penalty contact of particles with colliders: spring, dashpot and Coulomb friction (workshop, "Collisions")."""

from dataclasses import dataclass, replace
from math import hypot
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce, Rates, block, even_block
from taichi_jello.physics.forces.collider_contact.continuous_collision import Sweep
from taichi_jello.physics.forces.contact_law import ContactLaw
from taichi_jello.physics.forces.springs.spring_state import loose

FEW = 3  # surfaces up to which a look at each is as quick as asking first whether any is near


@ti.func
def pressure(depth, speed, stiffness, damping):
    """The normal force [N] on a particle `depth` [m] behind a surface and moving out of it at `speed` [m/s]: a spring
    of rest length 0 and a dashpot along the outward normal, never pulling."""
    return ti.max(0.0, stiffness * depth - damping * speed)


@ti.func
def rub(pressed, u, friction, grip):
    """Friction [N] of a particle pressed with `pressed` [N] that slides at `u` [m/s]. It opposes u with magnitude
    μN·g|u|/√(g²|u|² + μ²N²): Coulomb's μN when sliding, viscous with g [N·s/m] when almost at rest."""
    limit = friction * pressed
    return -limit * grip / ti.sqrt(grip * grip * u.dot(u) + limit * limit + 1e-30) * u


@dataclass(frozen=True)
class Group:
    """Rows `start` to `stop` of the surfaces share one signed distance, and where they are solids a core."""

    signed_distance: Any
    core_entry: Any
    start: int
    stop: int

    @property
    def solid(self) -> bool:
        return self.core_entry is not None


@ti.data_oriented
class PenaltyContact(ParticleForce):
    title = "contact"
    energy_kind = "contact"
    reads_velocity = True
    has_curvature = True
    works = ("contact dashpots", "friction", "moving colliders")

    def __init__(self, scene, particles):
        self.particles, self.colliders = particles, self._sorted(scene.collider)
        self.lanes, self.Lanes = particles.memory.lanes, particles.memory.lane_vector
        counts = [len(c.rows(0.0, 1.0)) for c in self.colliders]
        ends = np.cumsum(counts)
        self.in_passes = ends[-1] > FEW
        groups: list[Group] = []
        for collider, count, end in zip(self.colliders, counts, ends, strict=True):
            if groups and groups[-1].signed_distance is collider.signed_distance:
                groups[-1] = replace(groups[-1], stop=int(end))
            else:
                groups.append(Group(collider.signed_distance, collider.core_entry, int(end - count), int(end)))
        self.groups = tuple(groups)
        self.law = ContactLaw(scene, particles.body, particles.memory, self.title)
        self.rubs = self.law.rubs
        self.rows = particles.memory.table(self.title, "surfaces", self._rows(0.0, scene.solver.frame_dt))
        self.moving = (
            any(c.keyframe for c in self.colliders)
            or not np.array_equal(self._rows(0.0, 1.0), self._rows(1.0, 2.0))
            or any(np.any(row[3:6]) for row in self._rows(0.0, 1.0))
        )
        self.masked = False
        self.surface_speed = 0.0
        if any(group.solid for group in groups):
            self.deep = particles.memory.table(self.title, "deep", np.zeros(1, np.int32))
            self.sweep = Sweep(self, particles, self._swept(particles.body))

    @staticmethod
    def _swept(body):
        """(N,) whether a particle stands for what touches here."""
        return ~body.embedded

    @classmethod
    def made_for(cls, scene, particles):
        """For the particles of jellos without an embedded skin. The others touch with their skin (skin_penalty.py), and
        if they may come apart with the particles inside it as well."""
        body = particles.body
        embedded = body.embedded & ~(body.inside & loose(scene)[body.jello])
        if not scene.collider or scene.contact.stiffness == 0.0 or embedded.all():
            return []
        made = cls(scene, particles)
        if embedded.any():
            bare = np.pad(1 - embedded.astype(np.int32), (0, particles.memory.padded - len(embedded)))
            made.masked, made.bare = True, particles.memory.table(cls.title, "bare", bare)
        return [made]

    def tuning(self):
        return self.law.tuning()

    def tune(self, name, value):
        self.law.tune(name, value)

    @staticmethod
    def _sorted(colliders):
        kinds = list(dict.fromkeys(c.signed_distance for c in colliders))
        return sorted(colliders, key=lambda c: kinds.index(c.signed_distance))

    def _rows(self, start, end):
        rows = np.concatenate([c.moved_rows(start, end) for c in self.colliders])
        rows[:, :3] -= self.particles.origin
        return rows

    def begin_frame(self, start, end):
        if self.moving:
            rows = self._rows(start, end)
            self.surface_speed = float(np.linalg.norm(rows[:, 3:6], axis=1).max())  # [m/s]
            self.rows.from_numpy(rows.astype(self.particles.memory.number))

    @ti.func
    def touch(self, distance: ti.template(), r, p, t):
        """(normal, signed distance) of the point p at surface r."""
        row = self.rows[r]
        place = ti.Vector([row[0], row[1], row[2]]) + t * ti.Vector([row[3], row[4], row[5]])
        return distance(p - place, ti.Vector([row[6], row[7], row[8], row[9]]))

    @ti.func
    def gap(self, p, t):
        """The signed distance [m] of the point p from the nearest surface."""
        nearest = ti.cast(1e30, float)
        for group in ti.static(self.groups):
            for r in range(group.start, group.stop):
                nearest = ti.min(nearest, self.touch(group.signed_distance, r, p, t)[3])
        return nearest

    @ti.func
    def push(self, law, p, u, t, share):
        """The force [N] on a point at p that moves at u and stands for `share` of a particle of the surface."""
        force = ti.Vector([0.0, 0.0, 0.0])
        for group in ti.static(self.groups):
            for r in range(group.start, group.stop):
                touch = self.touch(group.signed_distance, r, p, t)
                if touch[3] < 0.0:
                    n = ti.Vector([touch[0], touch[1], touch[2]])
                    relative = u - ti.Vector([self.rows[r][3], self.rows[r][4], self.rows[r][5]])
                    speed = relative.dot(n)
                    pressed = pressure(-touch[3], speed, share * law[0], share * law[1])
                    force += pressed * n
                    if ti.static(self.rubs):
                        force += rub(pressed, relative - speed * n, law[2], share * law[3])
                    if ti.static(group.solid):
                        if -touch[3] > 0.5 * self.sweep.depth:
                            self.deep[0] = 1
        return force

    @ti.func
    def on(self, i, x, v, t):
        force = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.masked):
            if self.bare[i]:
                force = self.push(self.law.of(i), x[i], v[i], t, 1.0)
        else:
            force = self.push(self.law.of(i), x[i], v[i], t, 1.0)
        return force

    @ti.func
    def on_pass(self, first, last, x, v, t, f):
        """First, without a branch, how near each particle of the pass is to any surface; most passes are done then."""
        nearest = self.Lanes(1.0)
        for group in ti.static(self.groups):
            for r in range(group.start, group.stop):
                for lane in range(self.lanes):
                    nearest[lane] = ti.min(nearest[lane], self.touch(group.signed_distance, r, x[first + lane], t)[3])
        least = ti.cast(1.0, float)
        for lane in range(self.lanes):
            least = ti.min(least, nearest[lane])
        if least < 0.0:
            for i in range(first, last):
                if nearest[i - first] < 0.0:
                    f[i] = f[i] + self.on(i, x, v, t)

    @ti.func
    def stiffening(self, law, p, u, t, c, share):
        """How such a point stiffens a step of length c [s]: (k + damping/c) nnᵀ while pressed, and across n the slope
        of friction with the speed, at the pressure now."""
        total = even_block(ti.cast(0.0, float))
        for group in ti.static(self.groups):
            for r in range(group.start, group.stop):
                touch = self.touch(group.signed_distance, r, p, t)
                if touch[3] < 0.0:
                    n = ti.Vector([touch[0], touch[1], touch[2]])
                    relative = u - ti.Vector([self.rows[r][3], self.rows[r][4], self.rows[r][5]])
                    speed = relative.dot(n)
                    pressed = pressure(-touch[3], speed, share * law[0], share * law[1])
                    if pressed > 0.0:
                        across = ti.cast(0.0, float)
                        if ti.static(self.rubs):
                            slide, limit, grip = relative - speed * n, law[2] * pressed, share * law[3]
                            slope = limit * grip / ti.sqrt(grip * grip * slide.dot(slide) + limit * limit + 1e-30)
                            across = slope / c
                        total += block(across, share * (law[0] + law[1] / c), n)
        return total

    @ti.func
    def curvature(self, i, x, v, t, c):
        total = even_block(ti.cast(0.0, float))
        if ti.static(self.masked):
            if self.bare[i]:
                total = self.stiffening(self.law.of(i), x[i], v[i], t, c, 1.0)
        else:
            total = self.stiffening(self.law.of(i), x[i], v[i], t, c, 1.0)
        return total

    @ti.func
    def pressed_energy(self, law, p, t):
        """½ k depth² [J] of a point at p."""
        total = ti.cast(0.0, float)
        for group in ti.static(self.groups):
            for r in range(group.start, group.stop):
                depth = ti.max(0.0, -self.touch(group.signed_distance, r, p, t)[3])
                total += 0.5 * law[0] * depth * depth
        return total

    @ti.func
    def losses(self, law, p, u, t, share):
        """The power [W] of dashpots, of friction and of the surfaces' own motion at a point, as in `push`: (p - kδ)s,
        rub · w and (p n + rub) · V for a pressure p, speeds s out of the surface and w across, and V the surface's."""
        total = ti.Vector([0.0, 0.0, 0.0])
        for group in ti.static(self.groups):
            for r in range(group.start, group.stop):
                touch = self.touch(group.signed_distance, r, p, t)
                if touch[3] < 0.0:
                    n = ti.Vector([touch[0], touch[1], touch[2]])
                    own = ti.Vector([self.rows[r][3], self.rows[r][4], self.rows[r][5]])
                    relative = u - own
                    speed = relative.dot(n)
                    pressed = pressure(-touch[3], speed, share * law[0], share * law[1])
                    total[0] += (pressed + share * law[0] * touch[3]) * speed
                    total[2] += pressed * n.dot(own)
                    if ti.static(self.rubs):
                        slide = relative - speed * n
                        rubbed = rub(pressed, slide, law[2], share * law[3])
                        total[1] += rubbed.dot(slide)
                        total[2] += rubbed.dot(own)
        return total

    @ti.func
    def powers(self, i, x, v, t):
        total = self.losses(self.law.of(i), x[i], v[i], t, 1.0)
        if ti.static(self.masked):
            total *= self.bare[i]
        return total

    @ti.func
    def energy(self, i, x, t):
        total = self.pressed_energy(self.law.of(i), x[i], t)
        if ti.static(self.masked):
            total *= self.bare[i]
        return total

    def rates(self):
        """Friction's force follows the depth too, which turns k into k√(1 + μ²); its viscous part counts as damping
        across the normal, where the dashpot does not act."""
        together, law = self._most_at_once(), self.law
        sideways = law.grip if law.rubs else np.zeros_like(law.damping)
        return Rates(
            squared_frequency=together * hypot(1.0, law.friction) * self.steepest(law.stiffness),
            damping=together * self.steepest(np.maximum(law.damping, sideways)),
            damping_time=law.damping_time,
        )

    def steepest(self, each):
        """The most that springs (J,) [N/m] at the particles of each jello can be over mass [1/s²]."""
        body = self.particles.body
        return float((each[body.jello] / body.mass).max())

    def _most_at_once(self):
        """How many colliders can press one particle along one direction at once. The planes of one room are square
        to each other (opposite ones cannot meet), and two still spheres apart from each other never do."""
        apart = [[self._never_meet(a, b) for b in self.colliders] for a in self.colliders]
        return max(sum(not apart[i][j] for j in range(len(apart))) for i in range(len(apart)))

    @staticmethod
    def _never_meet(a, b):
        reach = getattr(a, "radius", None), getattr(b, "radius", None)
        if None in reach:
            return False
        still = not (a.keyframe or b.keyframe) and all(
            np.array_equal(s.place(0.0), s.place(time)) for s in (a, b) for time in (0.37, 1.0)
        )
        return still and np.linalg.norm(a.place(0.0) - b.place(0.0)) > sum(reach)
