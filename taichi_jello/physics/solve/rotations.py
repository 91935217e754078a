"""Turning as a whole: the motion of a stiff body that a constant matrix does not know to be easy.

L resists every difference of displacements, and with it rotations, which stretch no spring. A preconditioner that
takes them for stiff leaves them to the last: the residual looks small while angular momentum is wrong. So for every
jello that is not pinned the three rotations ω × ρ about its centre are solved for by themselves, (Σ [ρ]ᵀ B [ρ]) ω =
Σ ρ × r with the blocks B of each particle (mass, contact), and added.
"""

from itertools import pairwise

import numpy as np
import taichi as ti


@ti.data_oriented
class Rotations:
    def __init__(self, memory, body):
        ends = np.searchsorted(body.jello, np.arange(body.jello[-1] + 2))
        free = [not body.pinned[a:b].any() and b > a + 1 for a, b in pairwise(ends)]
        self.groups = len(free)
        self.spans = memory.table("solve", "jellos", np.stack([ends[:-1], ends[1:], free], 1))
        self.center = memory.table("solve", "centres", np.zeros((self.groups, 3)))
        self.inverse = memory.table("solve", "rotations", np.zeros((self.groups, 6)))
        self.turn = memory.table("solve", "turn", np.zeros((self.groups, 3)))
        self.group = memory.table("solve", "jello", np.pad(body.jello, (0, memory.padded - len(body))))

    @ti.func
    def measure(self, system, leads, anew, x, block, r):
        """ω of every jello, by the member that leads; with `anew`, x and the blocks have changed."""
        for g in range(self.groups):
            if leads and self.spans[g][2]:
                if anew:
                    self.prepare(system, g, x, block)
                torque, center = ti.Vector([0.0, 0.0, 0.0]), self.center[g]
                for i in range(self.spans[g][0], self.spans[g][1]):
                    torque += (x[i] - center).cross(r[i])
                self.turn[g] = self.times(self.inverse[g], torque)
        system.wait_for_team()

    @ti.func
    def prepare(self, system, g, x, block):
        center, mass = ti.Vector([0.0, 0.0, 0.0]), ti.cast(0.0, float)
        for i in range(self.spans[g][0], self.spans[g][1]):
            center += system.particles.mass(i) * x[i]
            mass += system.particles.mass(i)
        center = center / mass
        self.center[g] = center
        a, b = ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0])  # diagonal and off it, as in a block
        for i in range(self.spans[g][0], self.spans[g][1]):
            p, D, E = x[i] - center, block[0, i], block[1, i]
            q = ti.Vector([p[1] * p[1], p[2] * p[2], p[0] * p[0]])
            o = ti.Vector([p[2] * p[2], p[0] * p[0], p[1] * p[1]])
            a += ti.Vector(
                [
                    D[2] * q[0] + D[1] * o[0] - 2.0 * E[0] * p[1] * p[2],
                    D[0] * q[1] + D[2] * o[1] - 2.0 * E[1] * p[0] * p[2],
                    D[1] * q[2] + D[0] * o[2] - 2.0 * E[2] * p[0] * p[1],
                ]
            )
            b += ti.Vector(
                [
                    -D[0] * p[1] * p[2] + E[2] * p[0] * p[2] + E[1] * p[0] * p[1] - E[0] * p[0] * p[0],
                    -D[1] * p[0] * p[2] + E[2] * p[1] * p[2] + E[0] * p[0] * p[1] - E[1] * p[1] * p[1],
                    -D[2] * p[0] * p[1] + E[1] * p[1] * p[2] + E[0] * p[0] * p[2] - E[2] * p[2] * p[2],
                ]
            )
        a += 1e-6 * (a[0] + a[1] + a[2]) + 1e-30  # a rope has nothing that turns about itself
        cofactor = ti.Vector([a[1] * a[2] - b[0] * b[0], a[0] * a[2] - b[1] * b[1], a[0] * a[1] - b[2] * b[2]])
        across = ti.Vector([b[1] * b[2] - a[0] * b[0], b[0] * b[2] - a[1] * b[1], b[0] * b[1] - a[2] * b[2]])
        det = a[0] * cofactor[0] + b[2] * across[2] + b[1] * across[1]
        for k in ti.static(range(3)):
            self.inverse[g][k], self.inverse[g][3 + k] = cofactor[k] / det, across[k] / det

    @ti.func
    def times(self, m, u):
        """The symmetric matrix of the numbers xx, yy, zz, yz, xz, xy times u."""
        return ti.Vector(
            [
                m[0] * u[0] + m[5] * u[1] + m[4] * u[2],
                m[5] * u[0] + m[1] * u[1] + m[3] * u[2],
                m[4] * u[0] + m[3] * u[1] + m[2] * u[2],
            ]
        )

    @ti.func
    def displacement(self, i, x):
        """ω × ρ of particle i."""
        g = self.group[i]  # not the number 0 for a single jello: Taichi takes turn[0] for constant within a frame
        return self.turn[g].cross(x[i] - self.center[g])
