"""The angular momentum that impulses inside a body make by mistake, taken out again.

Impulses along where springs will be, at x + dt v, have a torque about where they are, at x. A step ends with
L' = Σ x' × m v' = Σ x × m v', so the mistake is Σ x × m Δv, and ω × (x - centre of mass) with ω = I⁻¹ Σ x × m Δv is the
least motion that carries it. Without this a stiff cube that was twisted and let go spins, the faster the shorter the
step: it is within one step that it takes its shape.
"""

from itertools import pairwise

import numpy as np
import taichi as ti

CHUNK = 256  # particles that are added up in one go


@ti.func
def solve_spd(b, r):
    """d with B d = r for a symmetric positive definite B: its xx, yy, zz, yz, xz and xy. By Cholesky's B = L D Lᵀ."""
    yx, zx = b[5] / b[0], b[4] / b[0]
    dy = b[1] - yx * b[5]
    zy = (b[3] - zx * b[5]) / dy
    dz = b[2] - zx * b[4] - zy * zy * dy
    y = r[1] - yx * r[0]
    z = (r[2] - zx * r[0] - zy * y) / dz
    y = y / dy - zy * z
    return ti.Vector([r[0] / b[0] - yx * y - zx * z, y, z])


@ti.data_oriented
class Spin:
    """`correct` for all jellos that are not pinned; `wanted`: whether there are any."""

    def __init__(self, memory, body):
        ends = np.searchsorted(body.jello, np.arange(body.jello[-1] + 2))
        spans = [(a, b) for a, b in pairwise(ends) if b > a + 1 and not body.pinned[a:b].any()]
        self.wanted = len(spans) > 0
        if not self.wanted:
            return
        chunks = [(k, min(k + CHUNK, b), a) for a, b in spans for k in range(a, b, CHUNK)]
        starts = np.cumsum([0] + [len(range(a, b, CHUNK)) for a, b in spans])
        group = np.full(memory.padded, -1, np.int32)
        for g, (a, b) in enumerate(spans):
            group[a:b] = g
        self.count, self.groups, self.epsilon = len(chunks), len(spans), memory.owner.epsilon
        self.chunks = memory.table("spin", "chunks", np.array(chunks))  # first, last, and first of the jello
        self.spans = memory.table("spin", "chunks of jellos", np.column_stack([starts[:-1], starts[1:]]))
        self.group = memory.table("spin", "jello", group)
        self.sums = memory.zeros("spin", "sums", (self.count, 19))
        names = ("turn", "centres", "glide", "whirl")
        made = (memory.zeros("spin", name, (self.groups, 3)) for name in names)
        self.turn, self.center, self.glide, self.whirl = made

    @ti.func
    def correct(self, system, first, last, x, v, before):
        """Take the angular momentum out of v that it has and `before` has not."""
        system.wait_for_team()  # until v of all particles is there
        for k in range(system.share_of(first, self.count), system.share_of(last, self.count)):
            self.add_up(system, k, x, v, before)
        system.wait_for_team()
        for g in range(system.share_of(first, self.groups), system.share_of(last, self.groups)):
            self.find(g, x)
        system.wait_for_team()
        for i in range(first, last):
            g = self.group[i]
            if g >= 0:
                v[i] = v[i] - self.turn[g].cross(x[i] - self.center[g])

    @ti.func
    def add_up(self, system, k, x, v, before):
        """Of a chunk, with places p relative to the jello's first particle: Σ m, Σ m p, the six Σ m p p,
        Σ m p × Δv, Σ m v and Σ m p × v of before."""
        chunk = self.chunks[k]
        total, origin = ti.Vector([0.0] * 19), x[chunk[2]]
        for i in range(chunk[0], chunk[1]):
            m, p = system.particles.mass(i), x[i] - origin
            q, torque, momentum = m * p, m * p.cross(v[i] - before[i]), m * before[i]
            angular = p.cross(momentum)
            total[0] += m
            for axis in ti.static(range(3)):
                total[1 + axis] += q[axis]
                total[4 + axis] += q[axis] * p[axis]
                total[7 + axis] += q[(axis + 1) % 3] * p[(axis + 2) % 3]
                total[10 + axis] += torque[axis]
                total[13 + axis] += momentum[axis]
                total[16 + axis] += angular[axis]
        self.sums[k] = total

    @ti.func
    def find(self, g, x):
        """Centre of mass and ω of a jello, and the rigid motion it goes on with, its velocity and its turning."""
        total = ti.Vector([0.0] * 19)
        for k in range(self.spans[g][0], self.spans[g][1]):
            total += self.sums[k]
        c, torque = ti.Vector([total[1], total[2], total[3]]) / total[0], ti.Vector([total[10], total[11], total[12]])
        b = ti.Vector([0.0] * 6)  # the inertia tensor
        for axis in ti.static(range(3)):
            y, z = ti.static((axis + 1) % 3, (axis + 2) % 3)
            b[axis] = total[4 + y] + total[4 + z] - total[0] * (c[y] * c[y] + c[z] * c[z])
            b[3 + axis] = total[0] * c[y] * c[z] - total[7 + axis]
        least = 16.0 * self.epsilon * (b[0] + b[1] + b[2]) + 1e-30  # a rope has nothing that turns about itself
        for axis in ti.static(range(3)):
            b[axis] += least
        self.turn[g] = solve_spd(b, torque)
        momentum, angular = ti.Vector([total[13], total[14], total[15]]), ti.Vector([total[16], total[17], total[18]])
        self.glide[g], self.whirl[g] = momentum / total[0], solve_spd(b, angular - c.cross(momentum))
        self.center[g] = x[self.chunks[self.spans[g][0]][2]] + c

    @ti.func
    def glide_of(self, i):
        """The velocity of the centre of mass of particle i's jello; zero if that is pinned."""
        velocity, g = ti.Vector([0.0, 0.0, 0.0]), self.group[i]
        if g >= 0:
            velocity = self.glide[g]
        return velocity

    @ti.func
    def rigid(self, i, x):
        """The velocity that particle i would have if its jello did not deform; zero if that is pinned."""
        velocity, g = ti.Vector([0.0, 0.0, 0.0]), self.group[i]
        if g >= 0:
            velocity = self.glide[g] + self.whirl[g].cross(x[i] - self.center[g])
        return velocity
