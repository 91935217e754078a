"""Jellos too weak for their own speed: what comes into the core of another one is stopped as a whole.

Contact springs, however hard, stop only the points that touch. Where the springs behind these hold less energy than
a jello brings, the rest of it comes on through its own stopped front. So while points of one jello are in the core of
another, the two lose the speed at which they approach, as rigid bodies in an almost inelastic impact: momentum and
angular momentum stay as they are, energy only falls. What may melt or tear is not stopped.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.search.boxes import TINY
from taichi_jello.physics.forces.soft_contact.surface.surface_fields import SurfaceFields
from taichi_jello.physics.state import Memory

RESTITUTION = 0.1  # with none, what was crushed may come apart on the other side
FIXED_POINT = 4096.0  # integers of this scale add up normals to the same in whatever order
MEAN_NORMAL = 0.5  # the length of the mean normal from which on it gives a direction
INTO = 0.1  # the least cosine between a velocity that leads deeper and that direction
COMPACT, LONG = 1, 2  # what keeps its shape: compact solids, and all others
SINGULAR = 1e-4  # of a round body's inertia and mass: what has less does not turn


@ti.data_oriented
class Brake:
    """deep[J a + b]: whether one of jellos a and b is in a core of the other one; any[0]: whether any is.
    sides[J a + b]: the sum of the normals along which a leaves b, and their number. Not for two compact solids, whose
    centres give the direction, nor for a sheet and what is thin."""

    def __init__(self, title: str, memory: Memory, surface: SurfaceFields):
        self.surface, self.jellos = surface, surface.jellos
        J, shapes = surface.jellos, surface.touching.shapes
        self.firm = memory.table(title, "firm jellos", np.where(shapes.compact, COMPACT, ~shapes.loose * LONG))
        self.deep = memory.zeros(title, "pairs in a core", (J * J,), whole=True)
        self.any = memory.zeros(title, "any in a core", (1,), whole=True)
        self.sided = (surface.solid > 0 and surface.has_thin) or surface.has_rope_pairs or shapes.has_slender
        if self.sided:
            self.sides = memory.zeros(title, "sides of cores", (J * J, 4), whole=True)
        names = ("centres", "speeds", "spins", "pushes", "turns")
        self.centre, self.velocity, self.spin, self.push, self.turn = (
            memory.zeros(title, f"{name} of jellos", (J, 3)) for name in names
        )
        self.inertia = memory.zeros(title, "inertia of jellos", (J, 9))
        self.mass, self.pairs = (
            memory.zeros(title, f"{name} of jellos", (J,)) for name in ("free masses", "braked pairs")
        )

    @ti.func
    def reset(self):
        if self.any[0] == 1:
            for pair in range(self.jellos * self.jellos):
                self.deep[pair] = 0
                if ti.static(self.sided):
                    self.sides[pair] = ti.Vector([0, 0, 0, 0])
            self.any[0] = 0

    @ti.func
    def _stops(self, a, b):
        return a != b and ti.min(self.firm[a], self.firm[b]) > 0

    @ti.func
    def mark(self, a, b):
        """Note that jello a has a point in a core of jello b."""
        if self._stops(a, b):
            self.deep[a * self.jellos + b] = self.deep[b * self.jellos + a] = self.any[0] = 1

    @ti.func
    def add_side(self, a, b, n):
        """Note that this point leaves along n."""
        if self._stops(a, b) and ti.max(self.firm[a], self.firm[b]) == LONG:
            there, back = a * self.jellos + b, b * self.jellos + a
            for k in ti.static(range(3)):
                part = ti.cast(ti.round(FIXED_POINT * n[k]), int)
                self.sides[there][k] += part
                self.sides[back][k] -= part
            self.sides[there][3] += 1
            self.sides[back][3] += 1

    @ti.func
    def brake(self, system, first, last, x, v):
        """At the end of a step, for the share of the particles first … last - 1."""
        any_deep = self.any[0]
        if any_deep:
            system.wait_for_team()  # until all particles are where they are at the end of the step
        from_ = system.share_of(first, self.jellos)
        to = ti.select(any_deep, system.share_of(last, self.jellos), from_)
        for j in range(from_, to):
            self._measure(system, j, x, v)
        if any_deep:
            system.wait_for_team()
        for j in range(from_, to):
            self.push[j], self.turn[j] = self._all_impacts(j)
        if any_deep:
            system.wait_for_team()
        for i in range(first, ti.select(any_deep, last, first)):
            j, m = self.surface.jello[i], self._free_mass(system, i)
            push = self.push[j] + self.turn[j].cross(x[i] - self.centre[j])
            if m > 0.0 and push.norm_sqr() > 0.0:
                if ti.static(system.books):
                    system.ledger.book_impact(i, m, v[i], push)
                v[i] = v[i] + push

    @ti.func
    def _free_mass(self, system, i):
        """The mass [kg] of particle i if it can move, else 0."""
        return ti.select(system.particles.inverse_mass(i) > 0.0, system.particles.mass(i), 0.0)

    @ti.func
    def _measure(self, system, j, x, v):
        """The mass, centre, velocity, inertia and angular momentum of the particles of jello j that can move, and how
        many other jellos are deep in it or it in them."""
        mass, centre, velocity, pairs = ti.cast(0.0, float), 0.0 * x[0], 0.0 * v[0], ti.cast(0.0, float)
        for k in range(self.jellos):
            pairs += ti.cast(self.deep[j * self.jellos + k], float)
        if pairs > 0.0:
            first, last = self.surface.first[j], self.surface.first[j + 1]
            for i in range(first, last):
                m = self._free_mass(system, i)
                mass += m
                centre += m * x[i]
                velocity += m * v[i]
            centre, velocity = centre / ti.max(mass, TINY), velocity / ti.max(mass, TINY)
            inertia, spin = ti.Matrix.zero(float, 3, 3), 0.0 * v[0]
            for i in range(first, last):
                arm, m = x[i] - centre, self._free_mass(system, i)
                inertia += m * point_inertia(arm)
                spin += m * arm.cross(v[i] - velocity)
            for k in ti.static(range(9)):
                self.inertia[j][k] = inertia[k // 3, k % 3]
            self.centre[j], self.velocity[j], self.spin[j] = centre, velocity, spin
        self.mass[j], self.pairs[j] = mass, pairs

    @ti.func
    def _all_impacts(self, j):
        """The change of velocity [m/s] and of angular velocity [rad/s] of jello j by the impacts with all that it is
        deep in; of jellos with several impacts each counts for its share."""
        push, turn = 0.0 * self.velocity[j], 0.0 * self.velocity[j]
        for k in range(self.jellos):
            if self.deep[j * self.jellos + k] == 1 and ti.min(self.mass[j], self.mass[k]) > 0.0:
                arm, velocity = self.centre[j] - self.centre[k], self.velocity[j] - self.velocity[k]
                d = velocity
                if arm.dot(velocity) >= 0.0:
                    d = self._deeper(j, k, velocity)
                if d.any():
                    change, spin = self._impact(j, k, arm, velocity, d / ti.max(d.norm(), TINY))
                    share = 1.0 / ti.max(self.pairs[j], self.pairs[k])
                    other = self.mass[k] / (self.mass[j] + self.mass[k])
                    push += share * (change + spin.cross(other * arm))
                    turn += share * spin
        return push, turn

    @ti.func
    def _deeper(self, j, k, velocity):
        """The direction into jello k at the sides where jello j touches it, if these agree and j moves that way beside
        it, else zero. The middle of a thin jello that is drawn round a bar, or through a ring, may be past the other
        one's."""
        into = 0.0 * velocity
        if ti.static(self.sided):
            side = self.sides[j * self.jellos + k]
            for axis in ti.static(range(3)):
                into[axis] = -ti.cast(side[axis], float) / FIXED_POINT
            size = into.norm()
            if size < MEAN_NORMAL * ti.cast(side[3], float) or into.dot(velocity) < INTO * size * velocity.norm():
                into *= 0.0
        return into

    @ti.func
    def _impact(self, j, k, arm, velocity, d):
        """The impact along d of jellos j and k, with the centre of j at `arm` from that of k and moving at `velocity`
        beside it: the change of velocity of j, and the angular velocity about their common centre that
        both gain, so that angular momentum stays."""
        a, b = self.mass[j], self.mass[k]
        reduced = a * b / (a + b)
        inertia = reduced * point_inertia(arm)
        for r in ti.static(range(3)):
            for c in ti.static(range(3)):
                inertia[r, c] += self.inertia[j][3 * r + c] + self.inertia[k][3 * r + c]
        torque = reduced * arm.cross(d)
        spin = ti.Vector([0.0, 0.0, 0.0])
        size = ti.max(inertia.trace(), TINY)
        inertia /= size
        if inertia.determinant() > SINGULAR:
            spin = -(inertia.inverse() @ torque) / size
        momentum = self.spin[j] + self.spin[k] + reduced * arm.cross(velocity)
        along = reduced * velocity.dot(d) + spin.dot(momentum)
        weight = reduced + spin.dot(torque)
        amount = -(1.0 + RESTITUTION) * ti.max(0.0, along) / ti.max(weight, SINGULAR * reduced)
        return amount * b / (a + b) * d, amount * spin


@ti.func
def point_inertia(arm):
    """The inertia of a unit of mass on an arm."""
    return arm.norm_sqr() * ti.Matrix.identity(float, 3) - arm.outer_product(arm)
