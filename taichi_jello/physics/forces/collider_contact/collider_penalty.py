"""Penalty contact of particles with colliders: spring, dashpot and Coulomb friction (workshop, "Collisions")."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce, Rates, block, even_block
from taichi_jello.physics.forces.collider_contact.continuous_collision import Sweep
from taichi_jello.physics.forces.collider_contact.friction import Anchors, friction_force, friction_stiffness
from taichi_jello.physics.forces.contact_law import ContactLaw
from taichi_jello.physics.forces.springs.spring_state import loose
from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Scene

BROAD_PHASE_ABOVE = 3  # surfaces; with fewer, testing each in full is as quick as a broad phase


@ti.func
def pressure(depth, speed, stiffness, damping):
    """The normal force [N] on a particle `depth` [m] behind a surface and moving out of it at `speed` [m/s]: a spring
    of rest length 0 and a dashpot along the outward normal, never pulling."""
    return ti.max(0.0, stiffness * depth - damping * speed)


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
    """A row of `rows`: a point of a surface [m], its velocity [m/s] and four numbers for its signed distance. `law`:
    stiffness, damping, friction and grip (see contact_law.py). A point counts as `share` particles of the surface."""

    title = "contact"
    energy_kind = "contact"
    reads_velocity = True
    has_curvature = True
    works = ("contact dashpots", "friction", "moving colliders")
    bare: Any  # whether each particle touches, where `masked`

    def __init__(self, scene: Scene, particles: Particles, colliders: Sequence[Any], touching: int):
        """touching: how many points touch the colliders."""
        self.particles, self.colliders = particles, self._sorted(colliders)
        self.lanes, self.Lanes = particles.memory.lanes, particles.memory.lane_vector
        groups: list[Group] = []
        end = 0
        for collider in self.colliders:
            start, end = end, end + len(collider.rows(0.0, 1.0))
            if groups and groups[-1].signed_distance is collider.signed_distance:
                groups[-1] = replace(groups[-1], stop=end)
            else:
                groups.append(Group(collider.signed_distance, collider.core_entry, start, end))
        self.groups, self.in_passes = tuple(groups), end > BROAD_PHASE_ABOVE
        self.law = ContactLaw(scene, particles.body, particles.memory, self.title)
        self.rubs = self.ends_steps = self.law.rubs
        if self.rubs:
            self.anchors = Anchors(self.title, particles.memory, touching)
            blocks = np.zeros(particles.memory.padded // self.lanes, np.int32)
            self.touched = particles.memory.table(self.title, "passes that touch", blocks)
        self.rows = particles.memory.table(self.title, "surfaces", self._rows(0.0, scene.solver.frame_dt))
        now = self._rows(0.0, 1.0)
        keyed = any(collider.keyframe for collider in self.colliders)
        self.moving = keyed or bool(now[:, 3:6].any()) or not np.array_equal(now, self._rows(1.0, 2.0))
        self.masked = False
        self.surface_speed = 0.0
        if any(group.solid for group in groups):
            self.deep = particles.memory.table(self.title, "deep", np.zeros(1, np.int32))
            self.sweep = self._make_sweep(particles)

    def _make_sweep(self, particles: Particles) -> Sweep:
        return Sweep(self, particles, ~particles.body.embedded)

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list["PenaltyContact"]:
        """For the particles of jellos without an embedded skin. The others touch with their skin (skin_penalty.py), and
        if they may come apart with the particles inside it as well."""
        body = particles.body
        embedded = body.embedded & ~(body.inside & loose(scene)[body.jello])
        if not scene.collider or scene.contact.stiffness == 0.0 or embedded.all():
            return []
        made = cls(scene, particles, scene.collider, len(body))
        if embedded.any():
            bare = np.pad(1 - embedded.astype(np.int32), (0, particles.memory.padded - len(embedded)))
            made.masked, made.bare = True, particles.memory.table(cls.title, "bare", bare)
        return [made]

    def tuning(self) -> dict[str, Any]:
        return self.law.tuning()

    def tune(self, name: str, value: Any) -> None:
        self.law.tune(name, value)

    def remembered(self) -> dict[str, np.ndarray]:
        return self.anchors.remembered() if self.rubs else {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        if self.rubs:
            self.anchors.recall(memory)
            self.touched.fill(1)

    @staticmethod
    def _sorted(colliders: Sequence[Any]) -> list[Any]:
        kinds = list(dict.fromkeys(c.signed_distance for c in colliders))
        return sorted(colliders, key=lambda c: kinds.index(c.signed_distance))

    def _rows(self, start: float, end: float) -> np.ndarray:
        rows = np.concatenate([c.moved_rows(start, end) for c in self.colliders])
        rows[:, :3] -= self.particles.origin
        return rows

    def begin_frame(self, start: float, end: float) -> None:
        if self.moving:
            rows = self._rows(start, end)
            self.surface_speed = float(np.linalg.norm(rows[:, 3:6], axis=1).max())  # [m/s]
            self.rows.from_numpy(rows.astype(self.particles.memory.number))

    @ti.func
    def place(self, r, t):
        """The point [m] that surface r is relative to."""
        row = self.rows[r]
        return ti.Vector([row[0], row[1], row[2]]) + t * ti.Vector([row[3], row[4], row[5]])

    @ti.func
    def touch(self, distance: ti.template(), r, p, t):
        """(normal, signed distance) of the point p at surface r."""
        row = self.rows[r]
        return distance(p - self.place(r, t), ti.Vector([row[6], row[7], row[8], row[9]]))

    @ti.func
    def gap(self, p, t):
        """The signed distance [m] of the point p from the nearest surface."""
        nearest = ti.cast(1e30, float)
        for group in ti.static(self.groups):
            for r in range(group.start, group.stop):
                nearest = ti.min(nearest, self.touch(group.signed_distance, r, p, t)[3])
        return nearest

    @ti.func
    def add_surfaces(self, what: ti.template(), law, q, p, u, t, h, share, total: ti.template()):
        """Add up `what` over the surfaces that point q, at p and moving at u, is behind: see the following
        functions."""
        for group in ti.static(self.groups):
            for r in range(group.start, group.stop):
                touch = self.touch(group.signed_distance, r, p, t)
                if touch[3] < 0.0:
                    n = ti.Vector([touch[0], touch[1], touch[2]])
                    own = ti.Vector([self.rows[r][3], self.rows[r][4], self.rows[r][5]])
                    speed = (u - own).dot(n)
                    slide = (u - own) - speed * n
                    pressed, k, grip = (
                        pressure(-touch[3], speed, share * law[0], share * law[1]),
                        share * law[0],
                        share * law[3],
                    )
                    stretch = 0.0 * n
                    if ti.static(self.rubs and what != "energy"):
                        stretch = self.anchors.stretch(q, r, p - self.place(r, t), n)
                    if ti.static(what == "force"):
                        total += pressed * n
                        if ti.static(self.rubs):
                            total += friction_force(pressed, stretch, slide, law[2], k, grip)
                        if ti.static(group.solid):
                            if -touch[3] > 0.5 * self.sweep.depth:
                                self.deep[0] = 1
                    elif ti.static(what == "block"):
                        if pressed > 0.0:
                            across = ti.cast(0.0, float)
                            if ti.static(self.rubs):
                                across = friction_stiffness(pressed, stretch, slide, law[2], k, grip, h)
                            total += block(across, k + share * law[1] / h, n)
                    elif ti.static(what == "energy"):
                        total += 0.5 * law[0] * touch[3] * touch[3]
                    else:
                        total[0] += (pressed + k * touch[3]) * speed
                        total[2] += pressed * n.dot(own)
                        if ti.static(self.rubs):
                            rubbed = friction_force(pressed, stretch, slide, law[2], k, grip)
                            total[1] += rubbed.dot(slide)
                            total[2] += rubbed.dot(own)

    @ti.func
    def push(self, law, q, p, u, t, share):
        """The force [N] on a point."""
        force = ti.Vector([0.0, 0.0, 0.0])
        self.add_surfaces("force", law, q, p, u, t, 1.0, share, force)
        return force

    @ti.func
    def stiffening(self, law, q, p, u, t, h, share):
        """The block [N/m] of a point for a step of h [s]: (k + damping/h) nnᵀ while pressed, and across n the ratio of
        friction and speed, at the pressure now."""
        total = even_block(ti.cast(0.0, float))
        self.add_surfaces("block", law, q, p, u, t, h, share, total)
        return total

    @ti.func
    def losses(self, law, q, p, u, t, share):
        """The power [W] of dashpots, of friction and of the surfaces' own motion at a point: (N - kδ)s, f · w and
        (N n + f) · V, with pressure N, depth δ, speed s out of the surface, friction f, sliding velocity w and the
        surface's velocity V."""
        total = ti.Vector([0.0, 0.0, 0.0])
        self.add_surfaces("power", law, q, p, u, t, 1.0, share, total)
        return total

    @ti.func
    def hold(self, law, q, p, t):
        """At the end of a step: the surface that point q at p is deepest in holds it, μδ from its anchor at most.
        Returns whether there is one."""
        deepest, depth, normal = -1, ti.cast(0.0, float), ti.Vector([0.0, 0.0, 0.0])
        for group in ti.static(self.groups):
            for r in range(group.start, group.stop):
                touch = self.touch(group.signed_distance, r, p, t)
                if -touch[3] > depth:
                    deepest, depth, normal = r, -touch[3], ti.Vector([touch[0], touch[1], touch[2]])
        if deepest >= 0:
            self.anchors.follow(q, deepest, p - self.place(deepest, t), normal, law[2] * depth)
        else:
            self.anchors.let_go(q)
        return ti.cast(deepest >= 0, ti.i32)

    @ti.func
    def end_step(self, system, first, last, x, t):
        for b in range(first // self.lanes, (last + self.lanes - 1) // self.lanes):
            if self.touched[b]:
                held = 0
                for i in range(b * self.lanes, ti.min((b + 1) * self.lanes, last)):
                    if self.touches(i):
                        held |= self.hold(self.law.of(i), i, x[i], t)
                self.touched[b] = held

    @ti.func
    def touches(self, i):
        """Whether particle i itself touches colliders, not a skin around it."""
        bare = 1
        if ti.static(self.masked):
            bare = self.bare[i]
        return bare

    @ti.func
    def on(self, i, x, v, t):
        force = ti.Vector([0.0, 0.0, 0.0])
        if self.touches(i):
            force = self.push(self.law.of(i), i, x[i], v[i], t, 1.0)
            if ti.static(self.rubs):
                if force.dot(force) > 0.0:
                    self.touched[i // self.lanes] = 1
        return force

    @ti.func
    def on_pass(self, first, last, x, v, t, f):
        """Broad phase: without a branch, the distance of each particle of the pass from all surfaces. Most passes touch
        none and are done then."""
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
    def curvature(self, i, x, v, t, h):
        total = even_block(ti.cast(0.0, float))
        if self.touches(i):
            total = self.stiffening(self.law.of(i), i, x[i], v[i], t, h, 1.0)
        return total

    @ti.func
    def pressed_energy(self, law, p, t):
        """½ k depth² [J] of a point at p."""
        total = ti.cast(0.0, float)
        self.add_surfaces("energy", law, 0, p, p, t, 1.0, 1.0, total)
        return total

    @ti.func
    def powers(self, i, x, v, t):
        return self.touches(i) * self.losses(self.law.of(i), i, x[i], v[i], t, 1.0)

    @ti.func
    def energy(self, i, x, t):
        return self.touches(i) * self.pressed_energy(self.law.of(i), x[i], t)

    def rates(self) -> Rates:
        """Friction follows the depth too, which turns k into k√(1 + μ²); its viscous part counts as damping across the
        normal, where the dashpot does not act."""
        together, law = self._pressing_at_once(), self.law
        sideways = law.grip if law.rubs else np.zeros_like(law.damping)
        return Rates(
            squared_frequency=together * hypot(1.0, law.friction) * self.steepest(law.stiffness),
            damping=together * self.steepest(np.maximum(law.damping, sideways)),
            damping_time=law.damping_time,
        )

    def steepest(self, each: np.ndarray) -> float:
        """The most that springs (J,) [N/m] at the particles of each jello can be over mass [1/s²]."""
        body = self.particles.body
        return float((each[body.jello] / body.mass).max())

    def _pressing_at_once(self) -> int:
        """How many colliders can press one particle along one direction at once. The planes of one room are square
        to each other (opposite ones cannot meet), and two still spheres apart from each other never do."""
        return max(sum(not self._never_meet(a, b) for b in self.colliders) for a in self.colliders)

    @staticmethod
    def _never_meet(a: Any, b: Any) -> bool:
        if not (hasattr(a, "radius") and hasattr(b, "radius")) or a.keyframe or b.keyframe:
            return False
        still = all(np.array_equal(s.place(0.0), s.place(time)) for s in (a, b) for time in (0.37, 1.0))
        return still and bool(np.linalg.norm(a.place(0.0) - b.place(0.0)) > a.radius + b.radius)
