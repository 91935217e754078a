"""How far the particles of jellos may stray before what was found near them has to be found again.

Every jello is expected to go on as fast as it does; what counts is how far a particle strays from that: its margin.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.search.boxes import TINY, axes_of, box_around, levers
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import Touching
from taichi_jello.physics.state import Memory
from taichi_jello.scene.body import Body

SPARE = 0.8  # of a margin after which the lists are made again; the rest covers the step that follows
AHEAD = 0.5  # how far jellos may go by each other before the lists are made again, in distances between the points
LONGEST = 60.0  # how long lists last at most, in frames


@ti.data_oriented
class Margins:
    """Particle i, which was at ref[i] at the time clock[0], lies within margin[i] [m] of where the mean speed `drift`
    of its jello has brought it, until the time clock[0] + clock[1] [s], or `watch` tells that it may not."""

    def __init__(self, title: str, body: Body, memory: Memory, touching: Touching):
        def numbers(name: str, *shape: int) -> ti.Field:
            return memory.zeros(title, name, shape)

        self.jellos = len(touching.radius)
        self.jello = memory.table(title, "jello", body.jello)
        first = np.searchsorted(body.jello, np.arange(self.jellos + 1))
        self.first = memory.table(title, "first particles", first)
        self.radius = memory.table(title, "radius", touching.radius)
        self.spacing = memory.table(title, "spacing", touching.spacing)
        self.least_spacing = float(touching.spacing.min())
        self.lever = memory.table(title, "levers", levers(body))
        self.margin, self.ref = numbers("margins", memory.particles), memory.vectors(title, "x at the last search")
        self.own_x = numbers("x along own axes", memory.particles, 3)
        self.drift, self.centre = numbers("speeds", self.jellos, 3), numbers("centres", self.jellos, 3)
        self.axes, self.hull = numbers("axes", self.jellos, 9), numbers("hulls", self.jellos, 6)
        self.most = numbers("widest usual margins", self.jellos)
        self.clock = numbers("made at, lasts", 2)

    @ti.func
    def along(self, j, d):
        """The vector d along the axes of jello j."""
        a = self.axes[j]
        return ti.Vector(
            [
                a[0] * d[0] + a[1] * d[1] + a[2] * d[2],
                a[3] * d[0] + a[4] * d[1] + a[5] * d[2],
                a[6] * d[0] + a[7] * d[1] + a[8] * d[2],
            ]
        )

    @ti.func
    def _follow(self, j, x, v):
        """The centre, speed and axes of jello j; `most`, for now, is how fast its particles move beside it."""
        first, last = self.first[j], self.first[j + 1]
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
        self.centre[j], self.drift[j], self.most[j] = centre, drift, ti.sqrt(squares / float(last - first))
        for k in ti.static(range(9)):
            self.axes[j][k] = axes[k // 3, k % 3]

    @ti.func
    def _set_time(self, t, least):
        """The lists are made t seconds after the frame began, and last until jellos have gone by each other by AHEAD,
        or for `least` [s]."""
        middle, fastest = 0.0 * self.drift[0], 0.0 * t
        for j in range(self.jellos):
            middle += self.drift[j] / float(self.jellos)
        for j in range(self.jellos):
            fastest = ti.max(fastest, 2.0 * (self.drift[j] - middle).norm())
        self.clock[0] = t
        self.clock[1] = ti.math.clamp(AHEAD * self.least_spacing / ti.max(fastest, TINY), least, LONGEST * least)

    @ti.func
    def _widen(self, j, x, v, dt, frame_dt, least, most):
        """The margins of all particles of jello j, and its hull."""
        usual = self.most[j]
        wide = ti.math.clamp(1.5 * frame_dt * usual, least * self.spacing[j], most * self.spacing[j])
        low, high = x[self.first[j]], x[self.first[j]]
        for i in range(self.first[j], self.first[j + 1]):
            speed = (v[i] - self.drift[j]).norm()
            margin = ti.max(wide, ti.select(speed > 2.0 * usual, 8.0, 3.0) * dt * speed)  # few are quicker than that
            self.margin[i], self.ref[i], self.own_x[i] = margin, x[i], self.along(j, x[i] - self.centre[j])
            low, high = ti.min(low, x[i] - margin), ti.max(high, x[i] + margin)
        self.hull[j] = box_around(low - self.radius[j], high + self.radius[j])

    @ti.func
    def strays(self, i, x, v, t, dt):
        """Whether particle i may leave its margin in the next step."""
        since, drift = t - self.clock[0], self.drift[self.jello[i]]
        strays = (x[i] - self.ref[i] - since * drift).norm() + dt * (v[i] - drift).norm()
        return strays > SPARE * self.margin[i] or since + dt > self.clock[1] or since < -0.5 * dt
