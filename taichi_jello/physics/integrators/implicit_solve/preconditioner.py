"""The preconditioner: a two-level approximation of A⁻¹, where A = M/c² + L is the matrix of projective dynamics.

L is the graph Laplacian of the network with the weights k + damping/c. In every configuration H ≼ A ⊗ I₃ (see
stable_step.py). A is constant, and has one number for each pair of particles, the same for x, y and z.

Each jello has a coarse grid over its rest shape, and P interpolates displacements from its nodes, trilinearly. With the
diagonal D of A and A꜀ = Pᵀ A P, s = D⁻¹ r + P A꜀⁻¹ Pᵀ r (two levels of Bramble, Pasciak & Xu 1990). This takes as
many iterations as the exact A⁻¹: with 8³ particles 20 to come within 1 % of a step, where 3×3 diagonal blocks take 384.

A resists all directions alike, H may not: stiff springs along one line leave a particle free across it, as in sheets,
ropes and bodies with stiff parts. There D consists of the 3×3 diagonal blocks of H itself, updated with H.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.springs.hooke import VECTORS
from taichi_jello.physics.integrators.implicit_solve import ldl
from taichi_jello.physics.state import Memory
from taichi_jello.scene.body import Body

MAX_NODES = 256  # of all coarse grids together, unless one cell for each jello has more
MAX_CELLS = 4  # along the longest side of a jello
MIN_ISOTROPY = 0.02  # smallest eigenvalue of a diagonal block over its trace, for one number to stand for the block
MAX_RATIO = 100.0  # between the traces of two such blocks
MOVES = 1e-5  # eigenvalue, relative to the largest, above which a motion of nodes moves particles
CHUNK = 1 << 22  # numbers in a dense piece of Pᵀ A P

Grid = tuple[np.ndarray, np.ndarray, int]


def coarse_grid(body: Body, cells: int) -> Grid:
    """Nodes and trilinear weights of each particle, (N, 8) each, and the number of nodes, numbered through all jellos,
    for grids over the rest shapes with `cells` along the longest sides."""
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


def finest_grid(body: Body) -> Grid:
    """The finest grid with at most MAX_NODES nodes, and no more than there are particles."""
    for cells in range(MAX_CELLS, 0, -1):
        grid = coarse_grid(body, cells)
        if grid[2] <= min(MAX_NODES, len(body)):
            break
    return grid


def sum_of_squares(m: int, nodes: np.ndarray, weights: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """(m, m) Σ scale pᵀp over the rows p with these weights at these nodes."""
    total = np.zeros((m, m))
    for first in range(0, len(nodes), max(1, CHUNK // m)):
        piece = slice(first, first + max(1, CHUNK // m))
        rows = np.arange(len(nodes[piece]))[:, None] * m + nodes[piece]
        dense = np.bincount(rows.ravel(), weights[piece].ravel(), len(rows) * m).reshape(-1, m)
        total += (dense * scales[piece, None]).T @ dense
    return total


def null_space(m: int, nodes: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(m, m) projection onto the motions of nodes that move no free particle, as where few are between the nodes."""
    values, motions = np.linalg.eigh(sum_of_squares(m, nodes, weights, np.ones(len(nodes))))
    null = motions[:, values <= MOVES * values[-1]]
    return np.round(null @ null.T, 9)  # so that rounding couples no two jellos


def is_isotropic(body: Body) -> bool:
    """Whether springs hold each particle in all directions, and none much more than another."""
    free = ~body.pinned[body.springs]
    stiff = body.stiffness[:, None, None] * body.direction[:, :, None] * body.direction[:, None]
    blocks = np.zeros((len(body), 3, 3))
    for end in (0, 1):
        np.add.at(blocks, body.springs[free[:, end], end], stiff[free[:, end]])
    smallest, trace = np.linalg.eigvalsh(blocks)[:, 0], np.trace(blocks, axis1=1, axis2=2)
    alike = trace.max() <= MAX_RATIO * trace[trace > 0.0].min(initial=np.inf)
    return bool(np.all(smallest >= MIN_ISOTROPY * trace) and alike)


def coupled_pairs(system: Any, c: float) -> tuple[np.ndarray, np.ndarray]:
    """All pairs (2, S) of particles that forces couple and the weights (S,) of the couplings [N/m]."""
    found = [force.pairs(c) for force in system.all_forces if force.couples]
    pairs = np.concatenate([np.zeros((2, 0), int), *(pair for pair, _ in found)], 1)
    return pairs, np.concatenate([np.zeros(0), *(weight for _, weight in found)])


@ti.data_oriented
class TwoLevel:
    """s = (D⁻¹ + P A꜀⁻¹ Pᵀ) r. by_blocks: D consists of the diagonal blocks of H, and `set_block` sets them first."""

    def __init__(self, memory: Memory, body: Body):
        self.memory, self.body = memory, body
        self.by_blocks = not is_isotropic(body)
        self.nodes, self.weights, self.count = finest_grid(body)
        self.null_space = null_space(self.count, self.nodes, self.weights)
        self.passes = -(-self.count // VECTORS)
        padded = self.passes * VECTORS
        particle, corner = np.nonzero(self.weights)
        node, weight = self.nodes[particle, corner], self.weights[particle, corner]
        if not len(node):  # all particles are pinned
            particle, node, weight = np.zeros(1, int), np.zeros(1, int), np.zeros(1)
        order = np.argsort(node, kind="stable")

        def table(name: str, values: np.ndarray) -> Any:
            return memory.table("solve", f"coarse {name}", values)

        self.start = table("start", np.searchsorted(node[order], np.arange(self.count + 1)))
        self.particles_of, self.weights_of = table("particles", particle[order]), table("shares", weight[order])
        self.nodes_at, self.weights_at = table("nodes", self.nodes), table("weights", self.weights)
        self.right, self.left = table("right", np.zeros((padded, 3))), table("left", np.zeros((padded, 3)))
        if self.by_blocks:
            self.pivots, self.lower = (memory.vectors("solve", name) for name in ("pivots", "lower"))
        else:
            self.diagonal = table("diagonal", np.zeros(memory.padded))
        self.inverse = memory.numbers("solve", "coarse inverse", (padded, padded))
        self.coupled = table("coupled", np.zeros((self.passes, 2), np.int32))  # first and last + 1 node, by any springs
        self.Lanes = ti.types.vector(VECTORS, ti.f32 if memory.number is np.float32 else ti.f64)
        self.forget()

    def forget(self) -> None:
        """Call when a stiffness, a damping or a mass has changed."""
        self.parts: list[tuple[np.ndarray, np.ndarray]] = []
        self.prepared: dict[float, tuple[np.ndarray, ...]] = {}

    def prepare(self, system: Any, c: float) -> None:
        """Write the tables for this c [s]."""
        self.parts = self.parts or self.constant_parts(system)
        if c not in self.prepared:
            self.prepared[c] = self.tables_for(c)
        diagonal, inverse, coupled = self.prepared[c]
        if not self.by_blocks:
            self.diagonal.from_numpy(diagonal)
        self.inverse.from_numpy(inverse)
        self.coupled.from_numpy(coupled)

    def constant_parts(self, system: Any) -> list[tuple[np.ndarray, np.ndarray]]:
        """M, K and C of A = M/c² + K + C/c: of each the diagonal (N,) and the coarse matrix."""
        pairs, stiffness = coupled_pairs(system, np.inf)
        damping = coupled_pairs(system, 1.0)[1] - stiffness
        made = [(self.body.mass, sum_of_squares(self.count, self.nodes, self.weights, self.body.mass))]
        i, j = pairs
        ends = np.hstack([self.nodes[i], self.nodes[j]]), np.hstack([self.weights[i], -self.weights[j]])
        for weight in (stiffness, damping):
            degree = np.bincount(i, weight, len(self.body)) + np.bincount(j, weight, len(self.body))
            made.append((degree, sum_of_squares(self.count, *ends, weight)))
        return made

    def tables_for(self, c: float) -> tuple[np.ndarray, ...]:
        """1 over the diagonal of A; the inverse of the coarse matrix, with its largest stiffness in the null space; and
        the nodes that those of each pass are coupled to."""
        diagonal, coarse = (
            sum(part[k] * power for part, power in zip(self.parts, (c**-2.0, 1.0, 1.0 / c), strict=True))
            for k in (0, 1)
        )
        found = np.pad(np.where(self.body.pinned, 0.0, 1.0 / diagonal), (0, self.memory.padded - len(self.body)))
        inverse = np.linalg.inv(coarse + (np.diag(coarse).max() or 1.0) * self.null_space)
        padded = np.zeros(self.inverse.shape, self.memory.number)
        padded[: self.count, : self.count] = inverse
        coupled = np.zeros((self.passes, 2), np.int32)
        for pass_ in range(self.passes):
            others = np.flatnonzero(inverse[pass_ * VECTORS : (pass_ + 1) * VECTORS].any(0))
            coupled[pass_] = others[0], others[-1] + 1
        return found.astype(self.memory.number), padded, coupled

    @ti.func
    def set_block(self, i, B):
        self.pivots[i], self.lower[i] = ldl.factorise(B, self.memory.owner.epsilon)

    @ti.func
    def fine(self, system, i, r):
        """D⁻¹ r of particle i."""
        found = r
        if ti.static(self.by_blocks):
            found = ldl.substitute(self.pivots[i], self.lower[i], r)
            if ti.static(system.particles.pinned):
                found *= system.particles.free[i]
        else:
            found *= self.diagonal[i]
        return found

    @ti.func
    def apply(self, system, first, last, r, s):
        system.wait_for_team()  # until r is complete
        for node in range(system.share_of(first, self.count), system.share_of(last, self.count)):
            total = ti.Vector([0.0, 0.0, 0.0])
            for k in range(self.start[node], self.start[node + 1]):
                total += self.weights_of[k] * r[self.particles_of[k]]
            self.right[node] = total
        system.wait_for_team()
        for pass_ in range(system.share_of(first, self.passes), system.share_of(last, self.passes)):
            sx, sy, sz = self.Lanes(0.0), self.Lanes(0.0), self.Lanes(0.0)
            for k in range(self.coupled[pass_][0], self.coupled[pass_][1]):
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
            total = self.fine(system, i, r[i])
            nodes, weights = self.nodes_at[i], self.weights_at[i]
            for k in ti.static(range(8)):
                total += weights[k] * self.left[nodes[k]]
            s[i] = total
