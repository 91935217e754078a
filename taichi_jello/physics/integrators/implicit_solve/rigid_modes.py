"""Moving as a whole: what stretches no spring, however stiff, is solved for by itself, and rotations really turn.

For every jello that is not pinned these are six modes Z: three translations and three rotations ω × ρ about its
centre. Two things follow from them.

A constant matrix A resists every difference of displacements, and with it rotations; and it does not know of contact,
which makes a body stiff against translation. So the modes are solved for besides: with the particles' own blocks B
(mass, contact) in place of H, Q = Z (ZᵀBZ)⁻¹ Zᵀ is the inverse of H where it moves bodies as a whole, and conjugate
gradients are preconditioned by s = (Q + A⁻¹) r. (Balanced as in Mandel 1993, s = Q r + (I - QB) A⁻¹ (I - BQ) r, they
take two thirds of the products, each for half as much more time and a third more code to compile.)

A straight way ω × ρ stretches a body that turns by a finite angle, by k ω⁴ and so the more the stiffer it is. So a step
along d goes round: the part τ + ω × ρ of it that came from the modes is made with R = exp([ω]), and only the rest e is
straight: x' = centre + τ + R (ρ + e).
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.state import LANES

MODES = 6
ENTRIES = 21  # of a symmetric matrix of that size
FREE = 0.999  # of the displacement that a force gives a jello which nothing but its mass resists


@ti.func
def times(block, i, u):
    """The 3×3 block of particle i times u."""
    D, E = block[0, i], block[1, i]
    return D * u + ti.Vector([E[2] * u[1] + E[1] * u[2], E[2] * u[0] + E[0] * u[2], E[1] * u[0] + E[0] * u[1]])


@ti.func
def inertia_of(D, E, u):
    """What a particle with the block B at u from the centre adds to ZᵀBZ = ((B, -B[u]), ([u]B, -[u]B[u])), [u] = u ×:
    its ENTRIES."""
    B = ti.Matrix([[D[0], E[2], E[1]], [E[2], D[1], E[0]], [E[1], E[0], D[2]]])
    U = ti.Matrix([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
    F = B @ U
    G = U @ F
    forces = [D[0], E[2], E[1], -F[0, 0], -F[0, 1], -F[0, 2], D[1], E[0], -F[1, 0], -F[1, 1], -F[1, 2], D[2]]
    torques = [-F[2, 0], -F[2, 1], -F[2, 2], -G[0, 0], -G[0, 1], -G[0, 2], -G[1, 1], -G[1, 2], -G[2, 2]]
    return ti.Vector(forces + torques)


@ti.func
def less_one(w):
    """R - I for R = exp([w]), Rodrigues' formula; sin and 1 - cos without cancellation where w is small."""
    half = 0.5 * w.norm()
    a = ti.sin(half) / half if half > 1e-4 else 1.0 - half * half / 6.0
    W = ti.Matrix([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    return a * ti.cos(half) * W + 0.5 * a * a * (W @ W)


@ti.data_oriented
class Rigid:
    """Sums over a jello are sums over chunks of at most LANES of its particles, which members of a team share."""

    def __init__(self, memory, body):
        jellos = int(body.jello[-1]) + 1
        cuts = np.union1d(np.arange(0, len(body), LANES), np.searchsorted(body.jello, np.arange(jellos)))
        ends = np.append(cuts[1:], len(body))
        owner = body.jello[cuts]
        free = np.bincount(body.jello, body.pinned, jellos) == 0
        starts = np.arange(0, len(body) + LANES, LANES)
        self.chunks = memory.table("solve", "chunks", np.stack([cuts, ends], 1))
        self.of_block = memory.table("solve", "chunks of blocks", np.searchsorted(cuts, np.minimum(starts, len(body))))
        spans = [np.searchsorted(owner, np.arange(jellos) + k) for k in (0, 1)]
        self.spans = memory.table("solve", "jellos", np.stack([*spans, free], 1))
        self.group = memory.table("solve", "jello", np.pad(body.jello, (0, memory.padded - len(body))))
        self.jellos = jellos
        self.mass = memory.table("solve", "masses", np.bincount(body.jello, body.mass))
        self.together = memory.table("solve", "speed together", np.zeros((1, 3)))
        self.center = memory.table("solve", "centres", np.zeros((jellos, 3)))
        self.inverse = memory.numbers("solve", "inverse of modes", (jellos, MODES, MODES))
        self.modes = memory.numbers("solve", "modes", (jellos, MODES))  # τ and ω that were asked for last
        self.turning = memory.numbers("solve", "turning", (jellos, MODES + 9))  # τ, ω and R - I of the step to go
        self.terms = memory.numbers("solve", "terms", (len(cuts), ENTRIES))
        self.totals = memory.numbers("solve", "totals", (jellos, MODES * MODES))

    # Every function below is called by all members of a team, each for its particles first … last - 1.

    @ti.func
    def first_chunk(self, particle):
        return self.of_block[(particle + LANES - 1) // LANES]

    @ti.func
    def begin(self, system, first, last, x, block):
        """Centres and (ZᵀBZ)⁻¹ for particles at x with the blocks B."""
        for k in range(self.first_chunk(first), self.first_chunk(last)):
            moment, mass = ti.Vector([0.0, 0.0, 0.0]), ti.cast(0.0, float)
            for i in range(self.chunks[k][0], self.chunks[k][1]):
                moment += system.particles.mass(i) * x[i]
                mass += system.particles.mass(i)
            self.keep(k, 0, moment, ti.Vector([mass, 0.0, 0.0]))
        self.add_up(system, first, last, MODES)
        for g in range(self.jellos):
            if first == 0 and last > 0:
                moment = ti.Vector([self.totals[g, 0], self.totals[g, 1], self.totals[g, 2]])
                self.center[g] = moment / self.totals[g, 3]
        system.wait_for_team()
        for k in range(self.first_chunk(first), self.first_chunk(last)):
            center = self.center[self.group[self.chunks[k][0]]]
            total = ti.Vector([0.0 for _ in range(ENTRIES)])
            for i in range(self.chunks[k][0], self.chunks[k][1]):
                total += inertia_of(block[0, i], block[1, i], x[i] - center)
            for entry in ti.static(range(ENTRIES)):
                self.terms[k, entry] = total[entry]
        self.add_up(system, first, last, ENTRIES)
        for g in range(self.jellos):
            if first == 0 and last > 0:
                self.spread(g)
                self.invert(g)
        system.wait_for_team()

    @ti.func
    def spread(self, g):
        """The matrix from its ENTRIES, which stand in its rows from the diagonal on."""
        entry = ENTRIES
        for k in range(MODES * MODES):
            row, column = MODES - 1 - k // MODES, MODES - 1 - k % MODES
            if column >= row:
                entry -= 1
                self.totals[g, MODES * row + column] = self.totals[g, entry]
        for k in range(MODES * MODES):
            if k % MODES < k // MODES:
                self.totals[g, k] = self.totals[g, MODES * (k % MODES) + k // MODES]

    @ti.func
    def keep(self, k, at, force, torque):
        for axis in ti.static(range(3)):
            self.terms[k, at + axis], self.terms[k, at + 3 + axis] = force[axis], torque[axis]

    @ti.func
    def add_up(self, system, first, last, count):
        """The first terms of all chunks of each jello."""
        system.wait_for_team()
        for g in range(self.jellos):
            if first == 0 and last > 0:
                for term in range(count):
                    total = ti.cast(0.0, float)
                    for k in range(self.spans[g][0], self.spans[g][1]):
                        total += self.terms[k, term]
                    self.totals[g, term] = total

    @ti.func
    def invert(self, g):
        """(ZᵀBZ)⁻¹ by sweeping out one mode after the other (Goodnight 1979), which leaves -1 times it. What has no
        inertia, a rope about itself, is given a little; a jello that is held has no such modes."""
        least = ti.cast(1e-30, float)
        for k in range(3, MODES):
            least += 1e-6 * self.totals[g, MODES * k + k]
        for k in range(MODES):
            pivot = self.totals[g, MODES * k + k]
            if k >= 3:
                pivot = ti.max(pivot, least)
            for entry in range(MODES * MODES):
                row, column = entry // MODES, entry % MODES
                if row != k and column != k:
                    both = self.totals[g, MODES * row + k] * self.totals[g, MODES * k + column]
                    self.totals[g, entry] = self.totals[g, entry] - both / pivot
            for other in range(MODES):
                self.totals[g, MODES * k + other] = self.totals[g, MODES * k + other] / pivot
                self.totals[g, MODES * other + k] = self.totals[g, MODES * other + k] / pivot
            self.totals[g, MODES * k + k] = -1.0 / pivot
        for entry in range(MODES * MODES):
            self.inverse[g, entry // MODES, entry % MODES] = -self.spans[g][2] * self.totals[g, entry]

    @ti.func
    def project(self, system, first, last, x, r):
        """The modes that answer the forces r, (ZᵀBZ)⁻¹ Zᵀ r."""
        for k in range(self.first_chunk(first), self.first_chunk(last)):
            center = self.center[self.group[self.chunks[k][0]]]
            force, torque = ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0])
            for i in range(self.chunks[k][0], self.chunks[k][1]):
                force += r[i]
                torque += (x[i] - center).cross(r[i])
            self.keep(k, 0, force, torque)
        self.add_up(system, first, last, MODES)
        for g in range(self.jellos):
            if first == 0 and last > 0:
                for mode in range(MODES):
                    total = ti.cast(0.0, float)
                    for other in range(MODES):
                        total += self.inverse[g, mode, other] * self.totals[g, other]
                    self.modes[g, mode] = total
        system.wait_for_team()

    @ti.func
    def parts(self, g):
        """τ and ω. (Whoever asks has the index of a single jello read too, not the number 0: Taichi would take
        modes[0, k] for constant within a frame.)"""
        return (
            ti.Vector([self.modes[g, 0], self.modes[g, 1], self.modes[g, 2]]),
            ti.Vector([self.modes[g, 3], self.modes[g, 4], self.modes[g, 5]]),
        )

    @ti.func
    def displacement(self, i, x):
        """τ + ω × ρ of particle i."""
        g = self.group[i]
        tau, omega = self.parts(g)
        return tau + omega.cross(x[i] - self.center[g])

    @ti.func
    def is_free(self, g, c):
        """Whether nothing but its mass resists jello g, in a step of c [s], along any axis."""
        least = ti.cast(1.0, float)
        for axis in ti.static(range(3)):
            least = ti.min(least, self.inverse[g, axis, axis] * self.mass[g] / (c * c))
        return least > FREE

    @ti.func
    def join(self, c):
        """The speed [m/s] that the forces of the last projection give in c [s] to all jellos that are not free."""
        force, mass = ti.Vector([0.0, 0.0, 0.0]), ti.cast(1e-30, float)
        for g in range(self.jellos):
            if not self.is_free(g, c):
                force += ti.Vector([self.totals[g, 0], self.totals[g, 1], self.totals[g, 2]])
                mass += self.mass[g]
        self.together[0] = c / mass * force

    @ti.func
    def aim(self, system, first, last, part):
        """For `way`: this part of the modes that were asked for last, and how it turns. A step that would turn by more
        than a radian, of a body that is almost a point for one, goes straight."""
        for g in range(self.jellos):
            if first == 0 and last > 0:
                tau, omega = self.parts(g)
                kept = ti.select(omega.norm() < 1.0, part, 0.0)
                tau, omega = kept * tau, kept * omega
                R = less_one(omega)
                for row in ti.static(range(3)):
                    self.turning[g, row], self.turning[g, 3 + row] = tau[row], omega[row]
                    for column in ti.static(range(3)):
                        self.turning[g, MODES + 3 * row + column] = R[row, column]
        system.wait_for_team()

    @ti.func
    def way(self, i, x, d, part):
        """Where particle i goes from x by this part of the step d, as a displacement; and its direction there."""
        g = self.group[i]
        T = ti.Vector([self.turning[g, k] for k in range(MODES + 9)])
        tau, omega = ti.Vector([T[0], T[1], T[2]]), ti.Vector([T[3], T[4], T[5]])
        R = ti.Matrix([[T[6], T[7], T[8]], [T[9], T[10], T[11]], [T[12], T[13], T[14]]])
        rho = x[i] - self.center[g]
        e = part * d[i] - tau - omega.cross(rho)
        straight, spun = e + R @ e, R @ rho
        direction = tau + omega.cross(rho + spun + straight) + straight
        return tau + straight + spun, direction
