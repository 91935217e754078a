"""The energy that a pass over the springs of a crushed jello feeds, taken out again.

One pass solves every spring alone and is no minimisation: what a spring pushes apart, the next ones may have to pay
for. Where none is much shorter than at rest, the energy falls all the same. But a spring that is crushed to about half
its length or less pushes far and turns easily, and where such springs hold a good part of the energy and a step does
not resolve them, kinetic + elastic energy grows: × 1.4 … 4 for a cube that starts flat or squashed, × 2 … 4 with one
step a frame.

There the pass has a budget (as in Su, Sheth & Fedkiw 2013, "Energy conservation for the simulation of deformable
bodies"): the kinetic energy before it and the elastic energy of where the step begins, which hold all that outer
forces have done. While kinetic energy after it and the elastic energy of where it leads, x + dt v, are more, the part
of v that deforms is made smaller, in the last try nothing. The rigid part carries momentum and angular momentum and
stays as it is; of a pinned jello all that is free is made smaller. What a handle does to springs is its work and not
counted.
"""

from itertools import pairwise

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.springs.hooke import VECTORS
from taichi_jello.physics.integrators.energy_limits.spin import CHUNK
from taichi_jello.physics.state import LANES

TRIES = 6
CRUSHED = 0.6  # of its length at rest: a spring that is shorter is crushed
SHARE = 0.1  # of the elastic energy, from which on what crushed springs hold can feed energy
SURPLUS = 1.1  # that is taken off the kinetic energy in the first try, over what it is too much; twice that in the next
SMALLEST = 0.25  # part of the deforming kinetic energy that a try leaves, but the last
ROUNDING = 8.0  # epsilons of what flows in a step: less is no growth
GAIN, FLOW, DEFORMING, IN_CRUSHED, IN_ALL = range(5)


@ti.data_oriented
class Budget:
    """`doubt` marks jellos with crushed springs in the pass, `limit` is one of TRIES after it, `begin` forgets."""

    def __init__(self, memory, body, springs, spin):
        self.springs, self.spin, self.epsilon = springs, spin, ROUNDING * memory.owner.epsilon
        ends = np.searchsorted(body.jello, np.arange(body.jello[-1] + 2))
        whole = enumerate(pairwise(ends))
        chunks = np.array([(k, min(k + CHUNK, b), g) for g, (a, b) in whole for k in range(a, b, CHUNK)])
        self.count, self.groups = len(chunks), len(ends) - 1
        starts = np.searchsorted(chunks[:, 2], np.arange(self.groups + 1))
        jello = np.pad(body.jello, (0, memory.padded - len(body)), mode="edge")
        self.chunks = memory.table("budget", "chunks", chunks)  # first, last, and which jello
        self.starts = memory.table("budget", "chunks of jellos", starts)
        self.jello = memory.table("budget", "jello", jello)
        self.shares = memory.zeros("budget", "shares", (memory.padded, 5))
        self.sums = memory.zeros("budget", "sums", (self.count, 5))
        self.over = memory.zeros("budget", "over", (self.groups,), whole=True)
        self.scale = memory.zeros("budget", "scale", (self.groups,))

    @ti.func
    def begin(self, system, first, last):
        for g in range(system.share_of(first, self.groups), system.share_of(last, self.groups)):
            self.over[g] = 0

    @ti.func
    def doubt(self, i, shortened):
        """A spring of particle i is shorter than at rest by that factor."""
        if shortened > 1.0 / CRUSHED:
            self.over[self.jello[i]] = 1  # whoever writes it writes the same

    @ti.func
    def limit(self, system, first, last, x, v, before, dt, n):
        """Try n: make the deforming part of v smaller in jellos whose energy has grown since v was `before`."""
        system.wait_for_team()  # until v of all particles is there
        for p in range(first // system.lanes, (last + system.lanes - 1) // system.lanes):
            start = p * system.lanes
            end = ti.min(start + system.lanes, last)
            wanted = 0
            for g in range(self.jello[start], self.jello[end - 1] + 1):
                wanted = wanted | self.over[g]
            if wanted:
                self.measure(system, start, end, x, v, before, dt)
        system.wait_for_team()
        for k in range(system.share_of(first, self.count), system.share_of(last, self.count)):
            if self.over[self.chunks[k][2]]:
                total = ti.Vector([0.0] * 5)
                for i in range(self.chunks[k][0], self.chunks[k][1]):
                    total += self.shares[i]
                self.sums[k] = total
        system.wait_for_team()
        for g in range(system.share_of(first, self.groups), system.share_of(last, self.groups)):
            if self.over[g]:
                self.judge(g, n)
        system.wait_for_team()
        for i in range(first, last):
            if self.over[self.jello[i]] and system.particles.inverse_mass(i) > 0.0:
                rigid = self.rigid(i, x)
                v[i] = rigid + self.scale[self.jello[i]] * (v[i] - rigid)

    @ti.func
    def judge(self, g, n):
        """Whether jello g has too much energy, and what its deforming velocities are to be multiplied by."""
        total = ti.Vector([0.0] * 5)
        for k in range(self.starts[g], self.starts[g + 1]):
            total += self.sums[k]
        grown = total[GAIN] > self.epsilon * total[FLOW]
        self.over[g] = ti.cast(grown and total[IN_CRUSHED] > SHARE * total[IN_ALL], ti.i32)
        surplus = SURPLUS * ti.cast(1 << n, float) * total[GAIN] / ti.max(total[DEFORMING], 1e-30)
        left = ti.max(1.0 - self.epsilon - surplus, SMALLEST)
        self.scale[g] = ti.select(n == TRIES - 1, 0.0, ti.sqrt(left))

    @ti.func
    def rigid(self, i, x):
        """The part of a particle's velocity that no limit takes."""
        velocity = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.spin.wanted):
            velocity = self.spin.rigid(i, x)
        return velocity

    @ti.func
    def measure(self, system, first, last, x, v, before, dt):
        """The shares of the particles first … last - 1; each spring belongs to the first of its ends. Vectorised as
        `on_pass` of the springs is."""
        gain, flow = self.springs.Lanes(0.0), self.springs.Lanes(0.0)
        crushed, elastic = self.springs.Lanes(0.0), self.springs.Lanes(0.0)
        for e in range(self.springs.start[first // LANES], self.springs.start[first // LANES + 1]):
            shift, mask, material = self.springs.entries[e][0], self.springs.entries[e][1], self.springs.entries[e][2]
            if shift > 0:
                for start in ti.static(range(0, system.lanes, VECTORS)):
                    for lane in range(start, ti.static(min(start + VECTORS, system.lanes))):
                        i = first + lane
                        stored, had, of_crushed = self.stored(system, material, i, i + shift, x, v, dt)
                        has = (mask >> ((first & (LANES - 1)) + lane)) & 1
                        gain[lane] += ti.select(has, stored, 0.0)
                        flow[lane] += ti.select(has, ti.abs(stored), 0.0)
                        crushed[lane] += ti.select(has, of_crushed, 0.0)
                        elastic[lane] += ti.select(has, had, 0.0)
        for i in range(first, last):
            own = self.kinetic(system, i, x, v, before)
            lane = i - first
            share = [gain[lane] + own[0], flow[lane] + ti.abs(own[0]), own[1], crushed[lane], elastic[lane]]
            self.shares[i] = ti.Vector(share)

    @ti.func
    def stored(self, system, material, i, j, x, v, dt):
        """What the spring from i to j takes up in this step, what it had, and again that if it is crushed [J].

        ½ k (L'-R)² - ½ k (L-R)², as force times way and so without the rounding of a difference of large numbers."""
        m = self.springs.materials[self.springs.place(material, i)]
        w = v[j] - v[i]
        a = x[j] - x[i] + ti.Vector([m[3], m[4], m[5]])
        b = a + dt * w
        length = ti.sqrt(a.dot(a))
        both = length + ti.sqrt(b.dot(b))
        if ti.static(system.particles.pinned):
            end = system.count - 1  # a lane without the spring may be beyond
            w = system.particles.free[ti.min(j, end)] * v[j] - system.particles.free[ti.min(i, end)] * v[i]
        had = 0.5 * m[0] * (length - m[1]) ** 2
        stored = 0.5 * dt * m[0] * (1.0 - 2.0 * m[1] / both) * w.dot(a + b)
        return stored, had, ti.select(length < CRUSHED * m[1], had, 0.0)

    @ti.func
    def kinetic(self, system, i, x, v, before):
        """What particle i gained in the pass, seen from its jello's middle, and what its deforming velocity has [J]."""
        m, rigid, glide = system.particles.mass(i), self.rigid(i, x), ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.spin.wanted):
            glide = self.spin.glide_of(i)
        deforming = v[i] - rigid
        if ti.static(system.particles.pinned):
            deforming *= system.particles.free[i]
        return 0.5 * m * (v[i] - before[i]).dot(v[i] + before[i] - 2.0 * glide), 0.5 * m * deforming.dot(deforming)
