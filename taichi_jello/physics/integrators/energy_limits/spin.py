"""The removal of spurious angular momentum that internal impulses create.

Impulses along the springs' directions at the end of a step, x + dt v, have a torque about the positions x at its start.
The step ends with L' = Σ x' × m v' = Σ x × m v', so the error is Σ x × m Δv. The smallest motion that carries it is
ω × (x - centre of mass), ω = I⁻¹ Σ x × m Δv. Uncorrected, a stiff cube that is twisted and let go begins to spin.
"""

from itertools import pairwise

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators.implicit_solve import ldl
from taichi_jello.physics.state import Memory, State
from taichi_jello.scene.body import Body

CHUNK = 256  # particles that one thread adds up
SUMS = 19  # of a chunk


def spans(body: Body) -> list[tuple[int, int]]:
    """The first and last + 1 particle of each jello."""
    return list(pairwise(np.searchsorted(body.jello, np.arange(body.jello[-1] + 2)).tolist()))


def chunks(spans: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """Chunks (first, last + 1, span) of the particles in these spans; and the first chunk of each span, and of none."""
    found = np.array([(k, min(k + CHUNK, b), g) for g, (a, b) in enumerate(spans) for k in range(a, b, CHUNK)])
    return found, np.searchsorted(found[:, 2], np.arange(len(spans) + 1))


@ti.data_oriented
class Spin:
    """For all jellos of several particles without pins; `wanted`: whether there are any."""

    def __init__(self, memory: Memory, body: Body, state: State, before: ti.MatrixField):
        self.x, self.v, self.before = state.x, state.v, before
        wanted = [(a, b) for a, b in spans(body) if b > a + 1 and not body.pinned[a:b].any()]
        self.wanted = len(wanted) > 0
        if not self.wanted:
            return
        rows, starts = chunks(wanted)
        jello = np.full(memory.padded, len(wanted))
        for g, (a, b) in enumerate(wanted):
            jello[a:b] = g
        self.count, self.jellos, self.epsilon = len(rows), len(wanted), memory.owner.epsilon
        self.chunks = memory.table("spin", "chunks", rows)
        self.starts = memory.table("spin", "first chunks of jellos", starts)
        self.jello = memory.table("spin", "jello", jello)  # all others have the last place, where everything is zero
        self.sums = memory.zeros("spin", "sums", (self.count, SUMS))
        names = ("correction", "centres", "velocities", "spins")
        self.correction, self.centre, self.velocity, self.spin = (
            memory.zeros("spin", name, (self.jellos + 1, 3)) for name in names
        )

    @ti.func
    def correct(self, system, first, last, n, t, dt):
        """A stage of XPBD: remove from v the angular momentum that it has and `before` has not."""
        system.wait_for_team()  # until v is complete
        for k in range(system.share_of(first, self.count), system.share_of(last, self.count)):
            self.add_up(system, k)
        system.wait_for_team()
        for g in range(system.share_of(first, self.jellos), system.share_of(last, self.jellos)):
            self.find(g)
        system.wait_for_team()
        for i in range(first, last):
            g = self.jello[i]
            self.v[i] = self.v[i] - self.correction[g].cross(self.x[i] - self.centre[g])

    @ti.func
    def origin(self, g):
        """The position of the first particle of a jello, to which its sums are relative."""
        return self.x[self.chunks[self.starts[g]][0]]

    @ti.func
    def add_up(self, system, k):
        """Of a chunk, with positions p relative to the origin: Σ m, Σ m p, the six Σ m p p, Σ m p × Δv, Σ m v and
        Σ m p × v, the last two with v from `before`."""
        chunk = self.chunks[k]
        total, origin = ti.Vector([0.0] * SUMS), self.origin(chunk[2])
        for i in range(chunk[0], chunk[1]):
            m, p, before = system.particles.mass(i), self.x[i] - origin, self.before[i]
            moment, torque, momentum = m * p, m * p.cross(self.v[i] - before), m * before
            angular = p.cross(momentum)
            total[0] += m
            for axis in ti.static(range(3)):
                total[1 + axis] += moment[axis]
                total[4 + axis] += moment[axis] * p[axis]
                total[7 + axis] += moment[(axis + 1) % 3] * p[(axis + 2) % 3]
                total[10 + axis] += torque[axis]
                total[13 + axis] += momentum[axis]
                total[16 + axis] += angular[axis]
        self.sums[k] = total

    @ti.func
    def find(self, g):
        """The centre of mass and the correction ω of a jello, and its rigid motion from `before`."""
        total = ti.Vector([0.0] * SUMS)
        for k in range(self.starts[g], self.starts[g + 1]):
            total += self.sums[k]
        mass, c = total[0], total[1:4] / total[0]
        torque, momentum, angular = total[10:13], total[13:16], total[16:19]
        inertia = ti.Vector([0.0] * 6)
        for axis in ti.static(range(3)):
            y, z = ti.static((axis + 1) % 3, (axis + 2) % 3)
            inertia[axis] = total[4 + y] + total[4 + z] - mass * (c[y] * c[y] + c[z] * c[z])
            inertia[3 + axis] = mass * c[y] * c[z] - total[7 + axis]
        smallest = 16.0 * self.epsilon * (inertia[0] + inertia[1] + inertia[2]) + 1e-30  # a rope has none about itself
        for axis in ti.static(range(3)):
            inertia[axis] += smallest
        self.correction[g] = ldl.solve(inertia, torque, self.epsilon)
        self.velocity[g], self.centre[g] = momentum / mass, self.origin(g) + c
        self.spin[g] = ldl.solve(inertia, angular - c.cross(momentum), self.epsilon)

    @ti.func
    def rigid(self, i):
        """The velocity that particle i would have if its jello did not deform; zero with pins."""
        g = self.jello[i]
        return self.velocity[g] + self.spin[g].cross(self.x[i] - self.centre[g])
