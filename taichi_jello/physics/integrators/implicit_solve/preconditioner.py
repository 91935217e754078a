"""The constant matrix of projective dynamics, A = M/c² + L, and a quick approximation of its inverse.

L is the graph Laplacian of the network with the weights k + damping/c. In every configuration H ≼ A ⊗ I₃ (see
stable_step.py), and A is one number for each pair of particles, the same for x, y and z and for every step.

What a few numbers describe is solved for by them: every jello has a coarse grid over its rest shape, a displacement is
its values P y, trilinear between the grid's nodes, and A꜀ = Pᵀ A P is inverted as a whole. What is finer is left to the
diagonal: s = D⁻¹ r + P A꜀⁻¹ Pᵀ r (two levels of Bramble, Pasciak and Xu 1990). Counted in iterations this is as good
as the exact A⁻¹ at 8³ and at 16³ points, for a hundredth of its work. A cube of 8³ points comes to 1 % of a converged
step in 20 passes over the springs, with 3×3 diagonal blocks alone in 384. L-BFGS from the same two levels takes a third
of the passes, but does not converge where dashpots and friction of a hit make the force jump.

A resists all directions alike. Where H does not, it is no measure of it: a particle that stiff springs hold along one
line only, beside a stiff part of a soft body or in a sheet or rope, is free across it, and each such freedom would take
conjugate gradients iterations of its own. Such bodies have for D the 3×3 blocks of H itself, made anew with H.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.springs.hooke import VECTORS

NODES = 256  # of all coarse grids together, at most, unless one cell for each jello has more
CELLS = 4  # along the longest side of a jello, at most
EVEN = 0.02  # of all that holds a particle, the least there is in a direction for one number to stand for its block
ALIKE = 100.0  # times as much as another particle, the most that one is held for the same
APART = 1e-5  # of the most that nodes move particles, the least to count as moving them
CHUNK = 1 << 22  # numbers of a dense piece while PᵀLP is summed up


def coarse_grid(body, cells):
    """Nodes and trilinear weights, (N, 8) each, of grids over the rest shapes with `cells` along their longest sides;
    nodes are counted through all jellos."""
    nodes, weights, count = np.zeros((len(body), 8), int), np.zeros((len(body), 8)), 0
    corners = np.array([[k >> 2, k >> 1 & 1, k & 1] for k in range(8)])
    for jello in range(int(body.jello[-1]) + 1):
        own = np.flatnonzero(body.jello == jello)
        rest = body.rest[own] - body.rest[own].min(0)
        extent = np.ptp(rest, axis=0)
        along = np.maximum(np.round(cells * extent / (extent.max() or 1.0)), extent > 0.0).astype(int)
        place = rest * np.divide(along, extent, out=np.zeros(3), where=extent > 0.0)
        low = np.clip(place.astype(int), 0, np.maximum(along - 1, 0))
        part = (place - low)[:, None]
        corner = np.minimum(low[:, None] + corners, along)
        found, which = np.unique(corner @ [(along[1] + 1) * (along[2] + 1), along[2] + 1, 1], return_inverse=True)
        nodes[own] = count + which.reshape(-1, 8)
        weights[own] = np.where(corners, part, 1.0 - part).prod(2)
        count += len(found)
    return nodes, np.where(body.pinned[:, None], 0.0, weights), count


def fitting_grid(body):
    """The finest of these grids that has no more than NODES, and no more than there are particles."""
    for cells in range(CELLS, 0, -1):
        grid = coarse_grid(body, cells)
        if grid[2] <= min(NODES, len(body)):
            break
    return grid


def products(m, nodes, weights, scales):
    """Σ scale pᵀp (m, m) of the rows p that have these weights at these nodes."""
    total = np.zeros((m, m))
    for part in range(0, len(nodes), max(1, CHUNK // m)):
        piece = slice(part, part + max(1, CHUNK // m))
        rows = np.arange(len(nodes[piece]))[:, None] * m + nodes[piece]
        dense = np.bincount(rows.ravel(), weights[piece].ravel(), len(rows) * m).reshape(-1, m)
        total += (dense * scales[piece, None]).T @ dense
    return total


def unmoving(m, nodes, weights):
    """(m, m): projection onto the motions of nodes that move no free particle, as where there are few between nodes."""
    moved, motions = np.linalg.eigh(products(m, nodes, weights, np.ones(len(nodes))))
    none = motions[:, moved <= APART * moved[-1]]
    return np.round(none @ none.T, 9)  # that no rounding ties one jello's nodes to another's


def held_evenly(body):
    """Whether its springs hold every particle in all directions, and none much more than another."""
    free = ~body.pinned[body.springs]
    stiff = body.stiffness[:, None, None] * body.direction[:, :, None] * body.direction[:, None]
    blocks = np.zeros((len(body), 3, 3))
    for end in (0, 1):
        np.add.at(blocks, body.springs[free[:, end], end], stiff[free[:, end]])
    least, total = np.linalg.eigvalsh(blocks)[:, 0], np.trace(blocks, axis1=1, axis2=2)
    return bool(np.all(least >= EVEN * total) and total.max() <= ALIKE * total[total > 0.0].min(initial=np.inf))


def ties(system, c):
    """All pairs (2, S) that forces tie together and how much they stiffen each [N/m]."""
    found = [force.pairs(c) for force in system.all_forces if force.couples]
    pairs = np.concatenate([np.zeros((2, 0), int), *(pair for pair, _ in found)], 1)
    return pairs, np.concatenate([np.zeros(0), *(weight for _, weight in found)])


@ti.data_oriented
class TwoLevel:
    """s = (D⁻¹ + P A꜀⁻¹ Pᵀ) r. by_blocks: D are the 3×3 blocks on H's diagonal, and `factor` is told them first."""

    def __init__(self, memory, body):
        self.memory, self.body = memory, body
        self.by_blocks = not held_evenly(body)
        self.nodes, self.weights, self.count = fitting_grid(body)
        self.unmoving = unmoving(self.count, self.nodes, self.weights)
        self.passes = -(-self.count // VECTORS)
        padded = self.passes * VECTORS
        particle, corner = np.nonzero(self.weights)
        node, weight = self.nodes[particle, corner], self.weights[particle, corner]
        if not len(node):  # all is pinned
            particle, node, weight = np.zeros(1, int), np.zeros(1, int), np.zeros(1)
        order = np.argsort(node, kind="stable")
        tables = {
            "start": np.searchsorted(node[order], np.arange(self.count + 1)),  # of each node's particles
            "below": particle[order],
            "share": weight[order],
            "above": self.nodes,  # and each particle's nodes
            "of": self.weights,
            "right": np.zeros((padded, 3)),
            "left": np.zeros((padded, 3)),
        }
        self.diagonal = None
        if self.by_blocks:
            self.factors = memory.vectors("solve", "factors", 2)
        else:
            tables["diagonal"] = np.zeros(memory.padded)
        for name, values in tables.items():
            setattr(self, name, memory.table("solve", f"coarse {name}", values))
        self.inverse = memory.numbers("solve", "coarse inverse", (padded, padded))
        # The first and one past the last node that those of a pass are tied to, by whatever many springs.
        self.tied = memory.table("solve", "coarse tied", np.zeros((self.passes, 2), np.int32))
        self.Lanes = ti.types.vector(VECTORS, ti.f32 if memory.number is np.float32 else ti.f64)
        self.forget()

    def forget(self):
        self.parts, self.prepared = None, {}

    def prepare(self, system, c):
        if self.parts is None:
            self.parts = self.constant_parts(system)
        if c not in self.prepared:
            self.prepared[c] = self.tables_for(c)
        for field, values in zip((self.diagonal, self.inverse, self.tied), self.prepared[c], strict=True):
            if field is not None:
                field.from_numpy(values)

    def constant_parts(self, system):
        """What A is made of, A = M/c² + K + C/c: of each the diagonal (N,) and the coarse matrix PᵀAP."""
        stiff, all_ties = ties(system, np.inf), ties(system, 1.0)
        mass = products(self.count, self.nodes, self.weights, self.body.mass)
        made = [(self.body.mass, mass)]
        for (i, j), weight in (stiff, (all_ties[0], all_ties[1] - stiff[1])):
            ends = np.hstack([self.nodes[i], self.nodes[j]]), np.hstack([self.weights[i], -self.weights[j]])
            degree = sum(np.bincount(end, weight, len(self.body)) for end in (i, j))
            made.append((degree, products(self.count, *ends, weight)))
        return made

    def tables_for(self, c):
        """1 over the diagonal of A; the inverse of its coarse matrix, as stiff as its stiffest what moves no particle;
        and which nodes those of each pass are tied to."""
        diagonal, coarse = (
            sum(part[k] * power for part, power in zip(self.parts, (c**-2.0, 1.0, 1.0 / c), strict=True))
            for k in (0, 1)
        )
        found = np.pad(np.where(self.body.pinned, 0.0, 1.0 / diagonal), (0, self.memory.padded - len(self.body)))
        inverse = np.linalg.inv(coarse + (np.diag(coarse).max() or 1.0) * self.unmoving)
        padded = np.zeros(self.inverse.shape, self.memory.number)
        padded[: self.count, : self.count] = inverse
        tied = np.zeros(self.tied.shape + (2,), np.int32)
        for pass_ in range(self.passes):
            others = np.flatnonzero(inverse[pass_ * VECTORS : (pass_ + 1) * VECTORS].any(0))
            tied[pass_] = others[0], others[-1] + 1
        return found.astype(self.memory.number), padded, tied

    @ti.func
    def factor(self, system, i, B):
        """B = L diag(d) Lᵀ, as 1/d and what L has below its diagonal of ones. A pivot smaller than the rounding of what
        it is left over from is that."""
        least = ti.static(4.0 * self.memory.owner.epsilon)
        a, b = B[5] / B[0], B[4] / B[0]
        second = ti.max(B[1] - a * B[5], least * B[1])
        e = (B[3] - a * B[4]) / second
        third = ti.max(B[2] - b * B[4] - e * e * second, least * B[2])
        pivots = ti.Vector([1.0 / B[0], 1.0 / second, 1.0 / third])
        if ti.static(system.particles.pinned):
            pivots *= system.particles.free[i]
        self.factors[0, i], self.factors[1, i] = pivots, ti.Vector([a, b, e])

    @ti.func
    def divided(self, i, u):
        """D⁻¹ u of particle i."""
        pivots, L = self.factors[0, i], self.factors[1, i]
        found = u
        found[1] -= L[0] * found[0]
        found[2] -= L[1] * found[0] + L[2] * found[1]
        found *= pivots
        found[1] -= L[2] * found[2]
        found[0] -= L[0] * found[1] + L[1] * found[2]
        return found

    @ti.func
    def own(self, i, u):
        """D⁻¹ u of particle i."""
        found = u
        if ti.static(self.by_blocks):
            found = self.divided(i, u)
        else:
            found *= self.diagonal[i]
        return found

    @ti.func
    def apply(self, system, first, last, r, s):
        system.wait_for_team()  # until r of all particles is there
        here, there = system.share_of(first, self.count), system.share_of(last, self.count)
        for node in range(here, there):
            total = ti.Vector([0.0, 0.0, 0.0])
            for k in range(self.start[node], self.start[node + 1]):
                total += self.share[k] * r[self.below[k]]
            self.right[node] = total
        system.wait_for_team()
        for pass_ in range(system.share_of(first, self.passes), system.share_of(last, self.passes)):
            sx, sy, sz = self.Lanes(0.0), self.Lanes(0.0), self.Lanes(0.0)
            for k in range(self.tied[pass_][0], self.tied[pass_][1]):
                u = self.right[k]
                for lane in range(VECTORS):
                    a = self.inverse[k, pass_ * VECTORS + lane]
                    sx[lane] += a * u[0]
                    sy[lane] += a * u[1]
                    sz[lane] += a * u[2]
            for lane in range(VECTORS):
                self.left[pass_ * VECTORS + lane] = ti.Vector([sx[lane], sy[lane], sz[lane]])
        system.wait_for_team()
        for i in range(first, last):
            total = self.own(i, r[i])
            nodes, weights = self.above[i], self.of[i]
            for k in ti.static(range(8)):
                total += weights[k] * self.left[nodes[k]]
            s[i] = total
