"""The constant matrix of projective dynamics, A = M/c² + L, and ways to solve with it.

L is the graph Laplacian of the network with the weights k + damping/c. In every configuration H ≼ A ⊗ I₃ (see
bounds.py), and A is one number for each pair of particles, the same for x, y and z and for every step.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.springs import VECTORS

SMALL = 1100  # particles up to which the inverse as a whole, N² numbers, is the quickest


def constant_matrix(system, c):
    """A as a dense (N, N) array; the rows of pinned particles are those of the identity."""
    body, n = system.particles.body, system.count
    A = np.zeros((n, n))
    for force in system.all_forces:
        if force.couples:
            (i, j), weight = force.pairs(c)
            np.add.at(A, (i, j), -weight)
            np.add.at(A, (j, i), -weight)
    A[np.diag_indices(n)] = body.mass / c**2 - A.sum(1)
    A[body.pinned], A[:, body.pinned] = 0.0, 0.0
    A[body.pinned, body.pinned] = 1.0
    return A


@ti.data_oriented
class Inverse:
    """s = A⁻¹ r by the whole inverse."""

    def __init__(self, memory):
        self.memory = memory
        self.inverse = memory.numbers("solve", "inverse", (memory.padded, memory.padded))
        # The first and one past the last particle that those of a pass are tied to, by whatever many springs.
        self.tied = memory.table("solve", "tied", np.zeros((memory.passes, 2), np.int32))
        self.Lanes = memory.lane_vector

    def prepare(self, system, c):
        n, lanes = self.memory.particles, self.memory.lanes
        found = np.linalg.inv(constant_matrix(system, c))
        found[system.particles.body.pinned] = 0.0
        padded = np.zeros((self.memory.padded, self.memory.padded), self.memory.number)
        padded[:n, :n] = found
        self.inverse.from_numpy(padded)
        tied = np.zeros((self.memory.passes, 2), np.int32)
        for pass_ in range(self.memory.passes):
            others = np.flatnonzero(found[pass_ * lanes : (pass_ + 1) * lanes].any(0))
            if len(others):
                tied[pass_] = others[0], others[-1] + 1
        self.tied.from_numpy(tied)

    @ti.func
    def apply(self, system, first, last, r, s):
        system.wait_for_team()  # until r of all particles is there
        for pass_ in range(first // system.lanes, (last + system.lanes - 1) // system.lanes):
            start = pass_ * system.lanes
            sx, sy, sz = self.Lanes(0.0), self.Lanes(0.0), self.Lanes(0.0)
            for j in range(self.tied[pass_][0], self.tied[pass_][1]):
                u = r[j]
                for half in ti.static(range(0, system.lanes, VECTORS)):
                    for lane in range(half, ti.static(min(half + VECTORS, system.lanes))):
                        a = self.inverse[j, start + lane]
                        sx[lane] += a * u[0]
                        sy[lane] += a * u[1]
                        sz[lane] += a * u[2]
            for i in range(start, ti.min(start + system.lanes, last)):
                s[i] = ti.Vector([sx[i - start], sy[i - start], sz[i - start]])


@ti.data_oriented
class Diagonal:
    """s = diag(A)⁻¹ r."""

    def __init__(self, memory):
        self.memory = memory
        self.inverse = memory.table("solve", "diagonal", np.zeros(memory.padded))

    def prepare(self, system, c):
        body = system.particles.body
        found = body.mass / c**2
        for force in system.all_forces:
            if force.couples:
                (i, j), weight = force.pairs(c)
                found = found + np.bincount(i, weight, len(body)) + np.bincount(j, weight, len(body))
        found = np.where(body.pinned, 0.0, 1.0 / found)
        self.inverse.from_numpy(np.pad(found, (0, self.memory.padded - len(body))).astype(self.memory.number))

    @ti.func
    def apply(self, system, first, last, r, s):
        for i in range(first, last):
            s[i] = self.inverse[i] * r[i]


def inner_solver(memory):
    return Inverse(memory) if memory.particles <= SMALL else Diagonal(memory)
