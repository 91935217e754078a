"""The touching surfaces of a scene as Taichi fields, for every part of jello contact to read."""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import Touching
from taichi_jello.physics.state import Memory
from taichi_jello.scene.body import Body

SELF_CONTACT_GAP = 2.5  # point spacings within which a jello does not touch itself: there its springs hold


@ti.data_oriented
class SurfaceFields:
    """See Touching for the tables. others: whether jellos touch each other; itself (J,) bool: which touch themselves.
    has_ropes: whether ropes touch anything, has_rope_pairs: whether they touch ropes."""

    def __init__(self, title: str, body: Body, memory: Memory, touching: Touching, others: bool, itself: np.ndarray):
        def table(name: str, values: np.ndarray) -> ti.Field:
            return memory.table(title, name, values)

        self.touching, self.others, self.itself, self.with_self = touching, others, itself, bool(itself.any())
        shapes, ropes = touching.shapes, touching.shapes.rope & ~touching.shapes.loose
        self.jellos, self.count, self.elements = len(shapes.radius), len(touching.points), len(touching.nodes)
        self.solid, self.has_thin = touching.solid, touching.solid < self.elements
        self.jello = table("jello", body.jello)
        self.first = table("first particles", np.searchsorted(body.jello, np.arange(self.jellos + 1)))
        self.radius, self.spacing = table("radius", shapes.radius), table("spacing", shapes.spacing)
        self.points, self.nodes = table("points", touching.points), table("elements", touching.nodes)
        self.owner = table("jello of each element", body.jello[touching.nodes[:, 0]])
        self.bare, self.first_sample, self.blended = touching.bare, touching.skin, touching.bare < self.count
        if self.blended:
            self.corners, self.weights = (
                table("skin corners", touching.corners),
                table("skin weights", touching.weights),
            )
            self.parts = table("shares", touching.share)
        self.has_rope_pairs = bool((others and ropes.sum() > 1) or itself[ropes].any())
        self.has_ropes = self.has_rope_pairs or (others and bool(ropes.any()))
        if self.has_ropes:
            self.is_rope = table("ropes", ropes.astype(np.int32))
        if self.with_self:
            self.alone, self.rest = table("meets itself", itself.astype(np.int32)), table("rest", body.rest)
            self.self_gap = table("own neighbourhood", SELF_CONTACT_GAP * shapes.spacing)

    @ti.func
    def jello_of(self, q):
        """The jello of point q."""
        return self.jello[self.points[q]]

    @ti.func
    def at(self, q, x):
        """The value at point q of a field x of the particles."""
        p = x[self.points[q]]
        if ti.static(self.blended):
            if q >= self.bare:
                p *= 0.0
                for k in range(8):
                    p += self.weights[q - self.bare][k] * x[self.corners[q - self.bare][k]]
        return p

    @ti.func
    def part(self, q):
        """The fraction of a surface particle that point q stands for."""
        part = ti.cast(1.0, float)
        if ti.static(self.blended):
            part = self.parts[q]
        return part

    @ti.func
    def are_ropes(self, a, b):
        """Whether jellos a and b are ropes."""
        both = 0
        if ti.static(self.has_rope_pairs):
            both = self.is_rope[a] * self.is_rope[b]
        return both

    @ti.func
    def beside(self, q, k: ti.template()):
        """The point before (k = 0) or after (k = 1) point q on its rope; q itself where there is none."""
        r = ti.min(ti.max(q + 2 * k - 1, 0), self.bare - 1)  # particles are numbered along a rope
        return ti.select(q < self.bare and self.jello_of(r) == self.jello_of(q), r, q)

    @ti.func
    def may_meet(self, q, e):
        """Whether point q can touch element e: any of another jello, and of its own those far away along the body."""
        own = self.owner[e] == self.jello_of(q)
        may = ti.static(self.others) and not own
        if ti.static(self.with_self):
            if own and self.alone[self.owner[e]] == 1:
                distance = (self.rest[self.points[q]] - self.rest[self.nodes[e][0]]).norm()
                may = distance > self.self_gap[self.owner[e]]
        return may
