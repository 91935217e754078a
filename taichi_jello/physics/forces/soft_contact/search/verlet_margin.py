"""How far particles may stray before what was found near them has to be found again.

A jello is expected to keep its mean velocity; a particle's margin bounds how far it strays from that.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.search.boxes import TINY, axes_of, box_around, levers
from taichi_jello.physics.forces.soft_contact.surface.surface_fields import SurfaceFields
from taichi_jello.physics.state import Memory
from taichi_jello.scene.body import Body

USED = 0.8  # part of a margin after which the lists are made again; the rest covers the step that follows
PASSING = 0.5  # point spacings that jellos may pass each other by before the lists are made again
LONGEST = 60.0  # frames that lists last at most


@ti.data_oriented
class Margins:
    """Particle i, which was at start[i] at the time clock[0], stays within margin[i] [m] of start[i] moved with the
    mean velocity `drift` of its jello until the time clock[0] + clock[1] [s], unless `strays` says that it may not.
    hull: the box of each jello with its margin; centre, axes: its middle and orientation."""

    def __init__(self, title: str, body: Body, memory: Memory, surface: SurfaceFields, frame_dt: float):
        def numbers(name: str, *shape: int) -> ti.Field:
            return memory.zeros(title, name, shape)

        self.surface, self.jellos, self.frame_dt = surface, surface.jellos, frame_dt
        self.least_spacing = float(np.min(surface.touching.shapes.spacing))
        self.lever = memory.table(title, "levers", levers(body))
        self.margin, self.start = numbers("margins", memory.particles), memory.vectors(title, "x at the last search")
        self.own_x = numbers("x along own axes", memory.particles, 3)
        self.drift, self.centre = numbers("speeds", self.jellos, 3), numbers("centres", self.jellos, 3)
        self.axes, self.hull = numbers("axes", self.jellos, 9), numbers("hulls", self.jellos, 6)
        self.stir = numbers("speeds within jellos", self.jellos)
        self.clock = numbers("made at, lasts", 2)

    @ti.func
    def along(self, j, d):
        """The vector d along the axes of jello j."""
        a = self.axes[j]
        return ti.Vector([a[:3].dot(d), a[3:6].dot(d), a[6:].dot(d)])

    @ti.func
    def travel(self, a, b):
        """How far jello a moves beside jello b while the lists last."""
        return self.clock[1] * (self.drift[a] - self.drift[b])

    @ti.func
    def measure(self, j, x, v):
        """The centre, mean velocity and axes of jello j, and the r.m.s. speed of its particles beside that."""
        first, last = self.surface.first[j], self.surface.first[j + 1]
        centre, drift, shape, squares = 0.0 * x[first], 0.0 * v[first], ti.Matrix.zero(float, 3, 3), 0.0 * x[first][0]
        for i in range(first, last):
            centre += x[i]
            drift += v[i]
        centre /= float(last - first)
        drift /= float(last - first)
        for i in range(first, last):
            shape += (x[i] - centre).outer_product(self.lever[i])
            squares += (v[i] - drift).dot(v[i] - drift)
        axes = axes_of(shape)
        self.centre[j], self.drift[j], self.stir[j] = centre, drift, ti.sqrt(squares / float(last - first))
        for k in ti.static(range(9)):
            self.axes[j][k] = axes[k // 3, k % 3]

    @ti.func
    def set_clock(self, t, shortest):
        """The lists are made at t [s] of the frame. They last until jellos have passed each other by PASSING, but at
        least `shortest` [s]."""
        middle, fastest = 0.0 * self.drift[0], 0.0 * t
        for j in range(self.jellos):
            middle += self.drift[j] / float(self.jellos)
        for j in range(self.jellos):
            fastest = ti.max(fastest, 2.0 * (self.drift[j] - middle).norm())
        self.clock[0] = t
        self.clock[1] = ti.math.clamp(
            PASSING * self.least_spacing / ti.max(fastest, TINY), shortest, LONGEST * shortest
        )

    @ti.func
    def widen(self, j, x, v, dt, least, most):
        """The margins of all particles of jello j, usually between `least` and `most` point spacings, and its hull."""
        spacing, radius, stir = self.surface.spacing[j], self.surface.radius[j], self.stir[j]
        wide = ti.math.clamp(1.5 * self.frame_dt * stir, least * spacing, most * spacing)
        first, last = self.surface.first[j], self.surface.first[j + 1]
        low, high = x[first], x[first]
        for i in range(first, last):
            speed = (v[i] - self.drift[j]).norm()
            margin = ti.max(wide, ti.select(speed > 2.0 * stir, 8.0, 3.0) * dt * speed)  # few are quicker than that
            self.margin[i], self.start[i], self.own_x[i] = margin, x[i], self.along(j, x[i] - self.centre[j])
            low, high = ti.min(low, x[i] - margin), ti.max(high, x[i] + margin)
        self.hull[j] = box_around(low - radius, high + radius)

    @ti.func
    def strays(self, i, x, v, t, dt):
        """Whether particle i may leave its margin in the next step."""
        since, drift = t - self.clock[0], self.drift[self.surface.jello[i]]
        way = (x[i] - self.start[i] - since * drift).norm() + dt * (v[i] - drift).norm()
        return way > USED * self.margin[i] or since + dt > self.clock[1] or since < -0.5 * dt
