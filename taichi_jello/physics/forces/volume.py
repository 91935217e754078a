"""Resistance of cells to a change of volume, which also turns cells right side out.

A cell's signed volume is V = det(a, b, c) with the mean edges a, b, c along its three axes; it is negative where the
cell is inside out (Irving, Teran & Fedkiw 2004). With J = V/V₀ a cell stores κ V₀ ψ(J). For 0 ≤ J ≤ 1 this is the
energy of Teschner, Heidelberger, Müller & Gross (2004); outside it is softer, which bounds the stiffness:

    ψ'(J) = -1 for J < 0,   J - 1 for 0 ≤ J ≤ 1,   ln J / J for J > 1.

κ is `volume` times Young's modulus of the lattice of springs. The force on a corner is -κ ψ'(J) times an area vector.
The areas of a cell sum to zero and the energy does not depend on how the cell is turned, so momentum and angular
momentum stay. Melting softens springs, not this: a melted jello flows and keeps its volume.
"""

from itertools import combinations
from math import ceil
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce, Rates, block, even_block
from taichi_jello.physics.forces.springs.spring_state import SpringState
from taichi_jello.physics.forces.springs.tearing import still_there
from taichi_jello.physics.particles import Particles
from taichi_jello.physics.stable_step import lanczos
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.scene.material import CORNERS

SIGNS = 2 * CORNERS - 1  # of a corner along each axis of its cell
MEAN = 0.25  # edges along an axis are the mean of four
PRESSURE, STIFFNESS = 0, 1  # -κ ψ' [Pa] and κ ψ''/V₀ [Pa/m³] of a cell
STRETCHED = 2.0  # times the stiffness of undeformed cells: room for areas √2 as large, in the safe step


def edges(x: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(3, C, 3) [m] the mean edges along each axis of cells (C, 8) with the particles at x (N, 3)."""
    return np.einsum("ckd,ke->ecd", x[cells], MEAN * SIGNS)


def volumes(x: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(C,) [m³] signed volumes of cells (C, 8) with the particles at x (N, 3)."""
    a, b, c = edges(x, cells)
    return np.einsum("cd,cd->c", a, np.cross(b, c))


def slopes(x: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(C, 8, 3) [m²] how the volume of each cell grows as a corner moves."""
    a, b, c = edges(x, cells)
    return np.einsum("ke,ecd->ckd", MEAN * SIGNS, np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)]))


def young(body: Body) -> np.ndarray:
    """(J,) [Pa] Young's modulus of the springs of each solid jello: E V = Σ k L²/6 (see material.py)."""
    jellos = int(body.jello.max()) + 1
    stored = np.bincount(body.jello[body.springs[:, 0]], body.stiffness * body.rest_length**2, jellos) / 6.0
    whole = np.bincount(body.jello[body.cells[:, 0]], np.abs(volumes(body.rest, body.cells)), jellos)
    return np.divide(stored, whole, out=np.zeros(jellos), where=whole > 0.0)


@ti.data_oriented
class Volume(ParticleForce):
    """`corners` (C, 8) of the cells; `numbers` (C, 2): 1/(64 V₀) and κ; by `prepare`: `areas`, V's derivatives
    by the sums of edges, and `state`; `around`: 8 cell + corner for the cells at each particle, from `first`."""

    title = "volume"
    energy_kind = "elastic"
    prepares = couples = internal = True

    def __init__(self, scene: Scene, particles: Particles):
        self.body, self.memory = particles.body, particles.memory
        self.value = np.array([jello.volume for jello in scene.jello])
        self.young = young(self.body)
        self.cells = self.body.cells[self.value[self.body.jello[self.body.cells[:, 0]]] > 0.0]
        self.rest_volume = np.abs(volumes(self.body.rest, self.cells))
        self.owner, self.whole = self.body.jello[self.cells[:, 0]], np.ones(len(self.cells), bool)
        self.rest_slopes = (slopes(self.body.rest, self.cells) ** 2).sum((1, 2))
        self.points = len(self.cells)
        order = np.argsort(self.cells.ravel(), kind="stable")
        first = np.searchsorted(self.cells.ravel()[order], np.arange(len(self.body) + 1))
        self.corners = self.memory.table(self.title, "corners", self.cells)
        self.numbers = self.memory.table(self.title, "numbers", self._numbers())
        self.first = self.memory.table(self.title, "first", first)
        self.around = self.memory.table(self.title, "around", order)
        self.signs = self.memory.table(self.title, "signs", SIGNS.astype(float))
        self.areas = self.memory.zeros(self.title, "areas", (3 * self.points, 3))
        self.state = self.memory.zeros(self.title, "pressure and stiffness", (self.points, 2))

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list["Volume"]:
        return [cls(scene, particles)] if any(jello.volume > 0.0 for jello in scene.jello) else []

    def kappa(self) -> np.ndarray:
        """(C,) [Pa]; zero for cells that are torn."""
        return self.whole * (self.value * self.young)[self.owner]

    def _numbers(self) -> np.ndarray:
        return np.column_stack([1.0 / (64.0 * self.rest_volume), self.kappa()])

    def _write(self) -> None:
        self.numbers.from_numpy(self._numbers().astype(self.memory.number))

    def tuning(self) -> dict[str, Any]:
        """The largest `volume` of a jello."""
        return {self.title: float(self.value.max())}

    def tune(self, name: str, value: float) -> None:
        """Change it. Where jellos differ their ratios stay."""
        self.value = (
            self.value * (value / self.value.max()) if self.value.max() > 0.0 else np.full_like(self.value, value)
        )
        self._write()

    def set_state(self, state: SpringState) -> None:
        """Drop the cells that are torn (see tearing.py)."""
        if state.whole is not None:
            whole = still_there(self.body, state.whole, self.cells, np.zeros((0, 3), int))
            if not np.array_equal(whole, self.whole):
                self.whole = whole
                self._write()

    @ti.func
    def mean_edges(self, cell, x):
        """Four times the mean edges along each axis."""
        a, b, c = ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0])
        for k in ti.static(range(8)):
            p = x[self.corners[cell][k]]
            a += ti.static(float(SIGNS[k, 0])) * p
            b += ti.static(float(SIGNS[k, 1])) * p
            c += ti.static(float(SIGNS[k, 2])) * p
        return a, b, c

    @ti.func
    def prepare(self, first, last, x, v, t):
        for cell in range(first, last):
            a, b, c = self.mean_edges(cell, x)
            bc, numbers = b.cross(c), self.numbers[cell]
            j = a.dot(bc) * numbers[0]
            above = ti.max(j, 1.0)
            slope = ti.select(j > 1.0, ti.log(above) / above, ti.max(j, 0.0) - 1.0)
            second = ti.max(0.0, 1.0 - ti.log(above)) / (above * above) * ti.cast(j > 0.0, float)
            self.state[cell] = ti.Vector([-numbers[1] * slope, numbers[1] * second * 64.0 * numbers[0]])
            self.areas[3 * cell] = bc / 64.0
            self.areas[3 * cell + 1] = c.cross(a) / 64.0
            self.areas[3 * cell + 2] = a.cross(b) / 64.0

    @ti.func
    def on(self, i, x, v, t):
        force = ti.Vector([0.0, 0.0, 0.0])
        for e in range(self.first[i], self.first[i + 1]):
            cell = self.around[e] // 8
            force += self.state[cell][PRESSURE] * self.slope(e, cell)
        return force

    @ti.func
    def slope(self, e, cell):
        """∂V/∂x of the corner that entry e of `around` is, in its cell."""
        sign, g = self.signs[self.around[e] % 8], ti.Vector([0.0, 0.0, 0.0])
        for k in ti.static(range(3)):
            g += sign[k] * self.areas[3 * cell + k]
        return g

    @ti.func
    def resist_on_pass(self, first, last, x, p, h, q):
        """κ ψ''/V₀ g gᵀ p with the slopes g = ∂V/∂x of a cell's corners where `prepare` saw them. How g itself turns
        may soften the cell, and is left out."""
        for i in range(first, last):
            total = q[i]
            for e in range(self.first[i], self.first[i + 1]):
                cell = self.around[e] // 8
                a, b, c = self.mean_edges(cell, p)
                areas = 3 * cell
                change = self.areas[areas].dot(a) + self.areas[areas + 1].dot(b) + self.areas[areas + 2].dot(c)
                total += self.state[cell][STIFFNESS] * change * self.slope(e, cell)
            q[i] = total

    @ti.func
    def hold(self, i, x, h):
        total = even_block(ti.cast(0.0, float))
        for e in range(self.first[i], self.first[i + 1]):
            cell = self.around[e] // 8
            g = self.slope(e, cell)
            size = g.norm()
            if size > 0.0:
                total += block(0.0, self.state[cell][STIFFNESS] * size * size, g / size)
        return total

    def pairs(self, h: float) -> tuple[np.ndarray, np.ndarray]:
        """All corners of a cell with each other. A seventh of κ/V₀ |g|² for each pair adds up to that of the corner."""
        weight = self.kappa() / self.rest_volume * self.rest_slopes / (8.0 * 7.0)
        ends = np.array(list(combinations(range(8), 2))).T
        return self.cells[:, ends].transpose(1, 0, 2).reshape(2, -1), np.repeat(weight, 28)

    @ti.func
    def energy(self, i, x, t):
        """A cell's energy is that of its first corner."""
        total = ti.cast(0.0, float)
        for e in range(self.first[i], self.first[i + 1]):
            if self.around[e] % 8 == 0:
                a, b, c = self.mean_edges(self.around[e] // 8, x)
                numbers = self.numbers[self.around[e] // 8]
                j = a.dot(b.cross(c)) * numbers[0]
                log, inner = ti.log(ti.max(j, 1.0)), ti.math.clamp(j, 0.0, 1.0) - 1.0
                total += numbers[1] / (64.0 * numbers[0]) * (0.5 * (log * log + inner * inner) - ti.min(j, 0.0))
        return total

    def rates(self) -> Rates:
        """The stiffness matrix of undeformed cells is G Gᵀ with a column √(κ/V₀) ∂V/∂x for each cell."""
        scale = np.sqrt(self.kappa() / self.rest_volume)[:, None] / np.sqrt(self.body.mass)[self.cells]
        columns = slopes(self.body.rest, self.cells) * scale[..., None]  # of M^-½ G

        def apply(u: np.ndarray) -> np.ndarray:
            force = np.zeros((len(self.body), 3))
            np.add.at(force, self.cells, columns * u[:, None, None])
            return np.einsum("ckd,ckd->c", columns, force[self.cells])

        return Rates(squared_frequency=STRETCHED * lanczos(apply, len(self.cells)))

    def parts(self, x: np.ndarray, v: np.ndarray, frame_dt: float, dt: float) -> int:
        """A cell that is stretched is as much stiffer as the squares of its areas are larger."""
        stiffer = (slopes(x, self.cells) ** 2).sum((1, 2)) / self.rest_slopes
        return ceil(np.sqrt(max(1.0, float(stiffer.max()) / STRETCHED)) - 1e-6)
