"""The rigid modes of each jello: solved for exactly, and followed along finite rotations.

A jello without pins has six rigid modes, the columns of Z: three translations and three rotations ω × ρ about its
centre. The matrix A of the preconditioner resists rotations and does not know of contact. So with the diagonal blocks B
of H (mass, contact) Q = Z (ZᵀBZ)⁻¹ Zᵀ is added, the inverse of H on rigid motions: s = (Q + A⁻¹) r.

A straight displacement ω × ρ stretches a body that turns by a finite angle, with an energy of k ω⁴. So the rigid part
τ + ω × ρ of a step d is made with the rotation R = exp([ω]), and only the rest e is straight:
x' = centre + τ + R (ρ + e).
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import serial
from taichi_jello.physics.state import LANES, Memory
from taichi_jello.scene.body import Body

MODES = 6
UPPER = [(row, column) for row in range(MODES) for column in range(row, MODES)]  # of a symmetric matrix of that size
FREE = 0.999  # of the displacement that a force would give a jello with no other resistance than its mass


@ti.func
def skew(w):
    """The matrix [w] with [w] u = w × u."""
    return ti.Matrix([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


@ti.func
def times(block, i, u):
    """The 3×3 block of particle i times u."""
    D, E = block[0, i], block[1, i]
    return D * u + ti.Vector([E[2] * u[1] + E[1] * u[2], E[2] * u[0] + E[0] * u[2], E[1] * u[0] + E[0] * u[1]])


@ti.func
def generalised_mass(D, E, u):
    """The UPPER entries that a particle with the block B at u from the centre adds to
    ZᵀBZ = ((B, -B[u]), ([u]B, -[u]B[u]))."""
    B = ti.Matrix([[D[0], E[2], E[1]], [E[2], D[1], E[0]], [E[1], E[0], D[2]]])
    U = skew(u)
    F = B @ U
    G = U @ F
    forces = [D[0], E[2], E[1], -F[0, 0], -F[0, 1], -F[0, 2], D[1], E[0], -F[1, 0], -F[1, 1], -F[1, 2], D[2]]
    torques = [-F[2, 0], -F[2, 1], -F[2, 2], -G[0, 0], -G[0, 1], -G[0, 2], -G[1, 1], -G[1, 2], -G[2, 2]]
    return ti.Vector(forces + torques)


@ti.func
def rotation_minus_identity(w):
    """exp([w]) - I by Rodrigues' formula, with sin and 1 - cos free of cancellation for small w."""
    half = 0.5 * w.norm()
    a = ti.sin(half) / half if half > 1e-4 else 1.0 - half * half / 6.0
    W = skew(w)
    return a * ti.cos(half) * W + 0.5 * a * a * (W @ W)


@ti.data_oriented
class RigidModes:
    """Sums over a jello are sums over chunks of at most LANES of its particles, which the threads of a team share."""

    def __init__(self, memory: Memory, body: Body):
        jellos = int(body.jello[-1]) + 1
        cuts = np.union1d(np.arange(0, len(body), LANES), np.searchsorted(body.jello, np.arange(jellos)))
        ends = np.append(cuts[1:], len(body))
        owner = body.jello[cuts]
        free = np.bincount(body.jello, body.pinned, jellos) == 0
        starts = np.arange(0, len(body) + LANES, LANES)
        self.chunks = memory.table("solve", "chunks", np.stack([cuts, ends], 1))
        self.of_block = memory.table("solve", "chunks of blocks", np.searchsorted(cuts, np.minimum(starts, len(body))))
        spans = [np.searchsorted(owner, np.arange(jellos) + k) for k in (0, 1)]
        self.spans = memory.table("solve", "chunks of jellos", np.stack(spans, 1))
        self.free = memory.table("solve", "jellos without pins", free.astype(np.int32))
        self.jello = memory.table("solve", "jello", np.pad(body.jello, (0, memory.padded - len(body))))
        self.jellos = jellos
        self.mass = memory.table("solve", "masses", np.bincount(body.jello, body.mass))
        self.joint_velocity = memory.zeros("solve", "joint velocity", (1, 3))
        self.centre = memory.zeros("solve", "centres", (jellos, 3))
        self.inverse = memory.numbers("solve", "inverse of modes", (jellos, MODES, MODES))  # (ZᵀBZ)⁻¹, 0 with pins
        self.tau, self.omega = (memory.zeros("solve", name, (jellos, 3)) for name in ("translations", "rotations"))
        self.turn = memory.zeros("solve", "rotation matrices", (3 * jellos, 3))  # the rows of R - I
        self.terms = memory.numbers("solve", "terms", (len(cuts), len(UPPER)))
        self.totals = memory.numbers("solve", "totals", (jellos, len(UPPER)))

    # All threads of the team call `begin`, `project` and `aim`, each for its particles first … last - 1.

    @ti.func
    def first_chunk(self, particle):
        return self.of_block[(particle + LANES - 1) // LANES]

    @ti.func
    def begin(self, system, first, last, x, block):
        """Find the centres and (ZᵀBZ)⁻¹ for particles at x with the blocks B."""
        for k in range(self.first_chunk(first), self.first_chunk(last)):
            moment, mass = ti.Vector([0.0, 0.0, 0.0]), ti.cast(0.0, float)
            for i in range(self.chunks[k][0], self.chunks[k][1]):
                moment += system.particles.mass(i) * x[i]
                mass += system.particles.mass(i)
            self.set_terms(k, moment, ti.Vector([mass, 0.0, 0.0]))
        self.add_up(system, first, last, MODES)
        for g in range(self.jellos):
            if serial(first, last):
                self.centre[g] = self.total(g) / self.totals[g, 3]
        system.wait_for_team()
        for k in range(self.first_chunk(first), self.first_chunk(last)):
            centre = self.centre[self.jello[self.chunks[k][0]]]
            total = ti.Vector([0.0 for _ in UPPER])
            for i in range(self.chunks[k][0], self.chunks[k][1]):
                total += generalised_mass(block[0, i], block[1, i], x[i] - centre)
            for entry in ti.static(range(len(UPPER))):
                self.terms[k, entry] = total[entry]
        self.add_up(system, first, last, ti.static(len(UPPER)))
        for g in range(self.jellos):
            if serial(first, last):
                self.invert(g)
        system.wait_for_team()

    @ti.func
    def set_terms(self, k, force, torque):
        for axis in ti.static(range(3)):
            self.terms[k, axis], self.terms[k, 3 + axis] = force[axis], torque[axis]

    @ti.func
    def add_up(self, system, first, last, count):
        """The sums of the first `count` terms over the chunks of each jello."""
        system.wait_for_team()
        for g in range(self.jellos):
            if serial(first, last):
                for term in range(count):
                    total = ti.cast(0.0, float)
                    for k in range(self.spans[g][0], self.spans[g][1]):
                        total += self.terms[k, term]
                    self.totals[g, term] = total

    @ti.func
    def total(self, g):
        """The first three sums of jello g."""
        return ti.Vector([self.totals[g, 0], self.totals[g, 1], self.totals[g, 2]])

    @ti.func
    def invert(self, g):
        """(ZᵀBZ)⁻¹ by sweeping one mode after the other (Goodnight 1979), which results in -(ZᵀBZ)⁻¹. A rope gets a
        little inertia about itself."""
        for entry in ti.static(range(len(UPPER))):
            row, column = ti.static(UPPER[entry])
            self.inverse[g, row, column] = self.inverse[g, column, row] = self.totals[g, entry]
        smallest = ti.cast(1e-30, float)
        for k in range(3, MODES):
            smallest += 1e-6 * self.inverse[g, k, k]
        for k in range(MODES):
            pivot = self.inverse[g, k, k]
            if k >= 3:
                pivot = ti.max(pivot, smallest)
            for row, column in ti.ndrange(MODES, MODES):
                if row != k and column != k:
                    product = self.inverse[g, row, k] * self.inverse[g, k, column]
                    self.inverse[g, row, column] = self.inverse[g, row, column] - product / pivot
            for other in range(MODES):
                self.inverse[g, k, other] = self.inverse[g, k, other] / pivot
                self.inverse[g, other, k] = self.inverse[g, other, k] / pivot
            self.inverse[g, k, k] = -1.0 / pivot
        for row, column in ti.ndrange(MODES, MODES):
            self.inverse[g, row, column] = -self.free[g] * self.inverse[g, row, column]

    @ti.func
    def project(self, system, first, last, x, r):
        """The modes (ZᵀBZ)⁻¹ Zᵀ r for the forces r."""
        for k in range(self.first_chunk(first), self.first_chunk(last)):
            centre = self.centre[self.jello[self.chunks[k][0]]]
            force, torque = ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0])
            for i in range(self.chunks[k][0], self.chunks[k][1]):
                force += r[i]
                torque += (x[i] - centre).cross(r[i])
            self.set_terms(k, force, torque)
        self.add_up(system, first, last, MODES)
        for g in range(self.jellos):
            if serial(first, last):
                tau, omega = ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0])
                for axis in ti.static(range(3)):
                    for mode in range(MODES):
                        tau[axis] += self.inverse[g, axis, mode] * self.totals[g, mode]
                        omega[axis] += self.inverse[g, 3 + axis, mode] * self.totals[g, mode]
                self.tau[g], self.omega[g] = tau, omega
        system.wait_for_team()

    @ti.func
    def displacement(self, i, x):
        """τ + ω × ρ of particle i. (Even a single jello's index is read from a field: Taichi would take tau[0] for
        constant within a frame.)"""
        g = self.jello[i]
        return self.tau[g] + self.omega[g].cross(x[i] - self.centre[g])

    @ti.func
    def is_free(self, g, c):
        """Whether nothing but its mass resists a translation of jello g in a step of c [s]."""
        smallest = ti.cast(1.0, float)
        for axis in ti.static(range(3)):
            smallest = ti.min(smallest, self.inverse[g, axis, axis] * self.mass[g] / (c * c))
        return smallest > FREE

    @ti.func
    def join(self, c):
        """The velocity [m/s] that the forces of the last projection give in c [s] to all jellos that are not free,
        moving as one."""
        force, mass = ti.Vector([0.0, 0.0, 0.0]), ti.cast(1e-30, float)
        for g in range(self.jellos):
            if not self.is_free(g, c):
                force += self.total(g)
                mass += self.mass[g]
        self.joint_velocity[0] = c / mass * force

    @ti.func
    def aim(self, system, first, last, fraction):
        """Prepare `way`: scale the modes of the last projection by this fraction and find the rotation. A step that
        would turn a body by more than a radian, as one that is almost a point, goes straight."""
        for g in range(self.jellos):
            if serial(first, last):
                kept = ti.select(self.omega[g].norm() < 1.0, fraction, 0.0)
                self.tau[g], self.omega[g] = kept * self.tau[g], kept * self.omega[g]
                R = rotation_minus_identity(self.omega[g])
                for row in ti.static(range(3)):
                    self.turn[3 * g + row] = ti.Vector([R[row, 0], R[row, 1], R[row, 2]])
        system.wait_for_team()

    @ti.func
    def way(self, i, x, d, fraction):
        """The displacement of particle i from x by this fraction of the step d, and its derivative."""
        g = self.jello[i]
        tau, omega, rho = self.tau[g], self.omega[g], x[i] - self.centre[g]
        R = ti.Matrix.rows([self.turn[3 * g], self.turn[3 * g + 1], self.turn[3 * g + 2]])
        e = fraction * d[i] - tau - omega.cross(rho)
        straight, spun = e + R @ e, R @ rho
        direction = tau + omega.cross(rho + spun + straight) + straight
        return tau + straight + spun, direction
