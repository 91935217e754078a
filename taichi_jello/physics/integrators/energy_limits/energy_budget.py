"""The removal of energy that a pass of XPBD over the springs of a crushed jello feeds.

A pass solves each spring by itself. Where springs crushed to about half their length hold much of the energy and the
step does not resolve them, kinetic + elastic energy grows: by a factor of 1.4 to 4 for a cube that starts flat.

So the pass gets a budget (like Su, Sheth & Fedkiw 2013, "Energy conservation for the simulation of deformable bodies"):
the kinetic energy before it, which contains the work of external forces, and the elastic energy at the start of the
step. While the kinetic energy after it and the elastic energy at x + dt v exceed the budget, the deforming part of v is
reduced, to zero in the last attempt. The rigid part stays; of a jello with pins all is reduced. The work of handles on
springs is not counted.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.springs.hooke import VECTORS
from taichi_jello.physics.integrators.energy_limits.spin import Spin, chunks, spans
from taichi_jello.physics.state import LANES, Memory
from taichi_jello.scene.body import Body

ATTEMPTS = 6
CRUSHED = 0.6  # of its rest length: a shorter spring is crushed
CRUSHED_SHARE = 0.1  # of the elastic energy: crushed springs with less feed no energy
EXCESS = 1.1  # times the excess of energy that the first attempt removes; twice as much in each further one
MIN_FACTOR = 0.25  # of the deforming kinetic energy that an attempt leaves, except the last
ROUNDING = 8.0  # rounding units of the energy that a step exchanges: growth below that is ignored
GAIN, EXCHANGED, DEFORMING, IN_CRUSHED, ELASTIC = range(5)  # columns of the sums [J]


@ti.data_oriented
class Budget:
    """`begin` forgets, `doubt` marks jellos with crushed springs during the pass, `limit` makes one of ATTEMPTS."""

    def __init__(self, memory: Memory, body: Body, springs: Any, spin: Spin):
        self.springs, self.spin, self.epsilon = springs, spin, ROUNDING * memory.owner.epsilon
        self.x, self.v, self.before = spin.x, spin.v, spin.before
        rows, starts = chunks(spans(body))
        self.count, self.jellos = len(rows), len(starts) - 1
        jello = np.pad(body.jello, (0, memory.padded - len(body)), mode="edge")
        self.chunks = memory.table("budget", "chunks", rows)
        self.starts = memory.table("budget", "first chunks of jellos", starts)
        self.jello = memory.table("budget", "jello", jello)
        self.shares = memory.zeros("budget", "shares", (memory.padded, 5))
        self.sums = memory.zeros("budget", "sums", (self.count, 5))
        self.over = memory.zeros("budget", "over", (self.jellos,), whole=True)
        self.scale = memory.zeros("budget", "scale", (self.jellos,))

    @ti.func
    def begin(self, system, first, last):
        for g in range(system.share_of(first, self.jellos), system.share_of(last, self.jellos)):
            self.over[g] = 0

    @ti.func
    def doubt(self, i, compression):
        """A spring of particle i has 1/compression of its rest length."""
        if compression > 1.0 / CRUSHED:
            self.over[self.jello[i]] = 1  # several threads may write the same

    @ti.func
    def limit(self, system, first, last, n, t, dt):
        """Attempt n, a stage of XPBD: reduce the deforming part of v in jellos that have gained energy."""
        system.wait_for_team()  # until v is complete
        for p in range(first // system.lanes, (last + system.lanes - 1) // system.lanes):
            start = p * system.lanes
            end = ti.min(start + system.lanes, last)
            wanted = 0
            for g in range(self.jello[start], self.jello[end - 1] + 1):
                wanted = wanted | self.over[g]
            if wanted:
                self.measure(system, start, end, dt)
        system.wait_for_team()
        for k in range(system.share_of(first, self.count), system.share_of(last, self.count)):
            if self.over[self.chunks[k][2]]:
                total = ti.Vector([0.0] * 5)
                for i in range(self.chunks[k][0], self.chunks[k][1]):
                    total += self.shares[i]
                self.sums[k] = total
        system.wait_for_team()
        for g in range(system.share_of(first, self.jellos), system.share_of(last, self.jellos)):
            if self.over[g]:
                self.judge(g, n)
        system.wait_for_team()
        for i in range(first, last):
            if self.over[self.jello[i]] and system.particles.inverse_mass(i) > 0.0:
                rigid = self.rigid(i)
                self.v[i] = rigid + self.scale[self.jello[i]] * (self.v[i] - rigid)

    @ti.func
    def judge(self, g, n):
        """Whether jello g has too much energy, and the factor for its deforming velocities."""
        total = ti.Vector([0.0] * 5)
        for k in range(self.starts[g], self.starts[g + 1]):
            total += self.sums[k]
        grown = total[GAIN] > self.epsilon * total[EXCHANGED]
        self.over[g] = ti.cast(grown and total[IN_CRUSHED] > CRUSHED_SHARE * total[ELASTIC], ti.i32)
        excess = EXCESS * ti.cast(1 << n, float) * total[GAIN] / ti.max(total[DEFORMING], 1e-30)
        left = ti.max(1.0 - self.epsilon - excess, MIN_FACTOR)
        self.scale[g] = ti.select(n == ATTEMPTS - 1, 0.0, ti.sqrt(left))

    @ti.func
    def rigid(self, i):
        """The part of a particle's velocity that stays."""
        velocity = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.spin.wanted):
            velocity = self.spin.rigid(i)
        return velocity

    @ti.func
    def measure(self, system, first, last, dt):
        """The shares of the particles first … last - 1 of a pass; each spring counts for the first of its ends.
        Vectorised like Springs.on_pass."""
        gain, exchanged = self.springs.Lanes(0.0), self.springs.Lanes(0.0)
        in_crushed, elastic = self.springs.Lanes(0.0), self.springs.Lanes(0.0)
        for e in range(self.springs.start[first // LANES], self.springs.start[first // LANES + 1]):
            shift, mask, material = self.springs.entries[e][0], self.springs.entries[e][1], self.springs.entries[e][2]
            if shift > 0:
                for start in ti.static(range(0, system.lanes, VECTORS)):
                    for lane in range(start, ti.static(min(start + VECTORS, system.lanes))):
                        i = first + lane
                        stored, had, crushed = self.stored(system, material, i, i + shift, dt)
                        has = (mask >> ((first & (LANES - 1)) + lane)) & 1
                        gain[lane] += ti.select(has, stored, 0.0)
                        exchanged[lane] += ti.select(has, ti.abs(stored), 0.0)
                        in_crushed[lane] += ti.select(has, crushed, 0.0)
                        elastic[lane] += ti.select(has, had, 0.0)
        for i in range(first, last):
            gained, deforming = self.kinetic(system, i)
            n = i - first
            self.shares[i] = ti.Vector(
                [gain[n] + gained, exchanged[n] + ti.abs(gained), deforming, in_crushed[n], elastic[n]]
            )

    @ti.func
    def stored(self, system, material, i, j, dt):
        """The energy [J] that the spring from i to j stores in this step, what it had, and that again if it is crushed.

        ½ k (L'-R)² - ½ k (L-R)² is computed as force times displacement, without cancellation."""
        m = self.springs.materials[self.springs.place(material, i)]
        stiffness, rest_length = m[0], m[1]
        w = self.v[j] - self.v[i]
        a = self.x[j] - self.x[i] + ti.Vector([m[3], m[4], m[5]])
        b = a + dt * w
        length = ti.sqrt(a.dot(a))
        both = length + ti.sqrt(b.dot(b))
        if ti.static(system.particles.pinned):
            end = system.count - 1  # a lane without this spring may lie beyond
            w = system.particles.free[ti.min(j, end)] * self.v[j] - system.particles.free[ti.min(i, end)] * self.v[i]
        had = 0.5 * stiffness * (length - rest_length) ** 2
        stored = 0.5 * dt * stiffness * (1.0 - 2.0 * rest_length / both) * w.dot(a + b)
        return stored, had, ti.select(length < CRUSHED * rest_length, had, 0.0)

    @ti.func
    def kinetic(self, system, i):
        """The energy [J] that particle i gained in the pass, relative to its jello's centre of mass, and that of its
        deforming velocity."""
        m, v, before, centre = system.particles.mass(i), self.v[i], self.before[i], ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.spin.wanted):
            centre = self.spin.velocity[self.spin.jello[i]]
        deforming = v - self.rigid(i)
        if ti.static(system.particles.pinned):
            deforming *= system.particles.free[i]
        return 0.5 * m * (v - before).dot(v + before - 2.0 * centre), 0.5 * m * deforming.dot(deforming)
