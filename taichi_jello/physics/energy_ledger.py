"""The energy ledger: the work [J] of all that stores no energy. What remains is the error of the method.

d/dt (kinetic + stored energy) = Σ P, the powers of dashpots, friction, drag, the hand, moving colliders and fields.
Gregory's rule, the trapezoid rule with end corrections and an error ∝ dt⁴, integrates P over the substeps of one call
from the states at their ends, so it is the same for every scheme.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import MutualForce, ParticleForce
from taichi_jello.physics.state import Memory


@ti.func
def correction(k):
    """What Gregory's rule adds to the weight 1 of the k-th place from either end."""
    return ti.select(k == 0, -5.0 / 8.0, ti.select(k == 1, 1.0 / 6.0, ti.select(k == 2, -1.0 / 24.0, 0.0)))


@ti.func
def quadrature(k, n):
    """The weight of place k of 0 … n, over dt; the trapezoid rule's for n = 1 and Simpson's for n = 2."""
    return ti.select(n == 1, 0.5, 1.0 + correction(k) + correction(n - k))


@ti.data_oriented
class Ledger:
    """One account for each of `names`; fields with the work on each particle in one call of System.steps, which `take`
    sums up in float64, so that long runs do not drift in f32.

    A force has the accounts `works` and their `powers`; without them, if it stores no energy, one account and the
    power F · v. A held particle that moves at v does so against all forces, with the power -F · v (without contact
    with other jellos). Contact between jellos along another direction than its depth has no potential: it stays in
    the residual.
    """

    def __init__(self, forces: tuple[ParticleForce, ...], memory: Memory, handles: bool = False):
        self.names: list[str] = []
        self.columns_of: tuple[tuple[ParticleForce, int], ...] = ()  # each force's first column
        for force in forces:
            if force.works:
                self.columns_of += ((force, len(self.names)),)
                self.names += force.works
        self.plain = tuple(f for f in forces if not f.works and f.energy_kind is None and not f.in_passes)
        self.plain_start = len(self.names)
        self.names += [force.title for force in self.plain]
        self.handles, self.alone = handles, tuple(force for force in forces if not force.prepares)
        self.impacts = len(self.names)  # the column of impacts with the cores of solids
        brakes = any(force.brake for force in forces if isinstance(force, MutualForce))
        self.names += ["impacts"] * (brakes or any(force.sweep for force in forces)) + ["handles"] * handles
        self.memory, self.count, self.columns = memory, memory.particles, len(self.names)
        self.kept: dict[str, float] = {}  # of the current call
        if self.names:
            self.work = memory.table("ledger", "work", np.zeros((self.count, self.columns)))

    @ti.func
    def book(self, system, first, last, k, n, start, dt):
        """Add the work at place k of n of the particles first … last - 1; `start` substeps of the frame came before."""
        system.wait_for_team()  # until all particles are where they are at the end of the substep
        t, weight = (start + k) * dt, quadrature(k, n) * dt
        x, v = ti.static(system.state.x, system.state.v)
        for i in range(first, last):
            for force, column in ti.static(self.columns_of):
                powers = force.powers(i, x, v, t)
                for c in ti.static(range(len(force.works))):
                    self.add(i, column + c, weight * powers[c])
                if ti.static(force.adds_mass and system.integrator.adds_mass):  # that of the hand itself
                    kinetic = 0.5 * force.added_mass(i) * v[i].dot(v[i])
                    self.add(i, column, ti.select(k == 0, kinetic, ti.select(k == n, -kinetic, 0.0)))
            for f in ti.static(range(len(self.plain))):
                force = self.plain[f].on(i, x, v, t)
                self.add(i, self.plain_start + f, weight * force.dot(v[i]))
            if ti.static(self.handles):
                if system.particles.inverse_mass(i) == 0.0 and v[i].dot(v[i]) > 0.0:
                    against = ti.Vector([0.0, 0.0, 0.0])
                    for force in ti.static(self.alone):
                        against += force.on(i, x, v, t)
                        if ti.static(force.adds_mass):
                            against += force.on_held(i, x, v, t)
                    self.add(i, self.columns - 1, -weight * against.dot(v[i]))
        system.wait_for_team()  # until nobody needs x and v any more

    @ti.func
    def add(self, i, column: ti.template(), work):
        self.work[i][column] = self.work[i][column] + work

    @ti.func
    def book_impact(self, i, mass, v, push):
        """Add the work on particle i of an impact that changed its velocity v by `push` at once."""
        self.add(i, self.impacts, mass * push.dot(v + 0.5 * push))

    @ti.kernel
    def _take(self, out: ti.types.ndarray()):
        for i in range(self.count):
            for c in ti.static(range(self.columns)):
                out[i, c] = self.work[i][c]
                self.work[i][c] = 0.0

    def keep(self) -> None:
        """Move the work in the fields to `kept`."""
        for name, work in zip(self.names, self.drop(), strict=True):
            self.kept[name] = self.kept.get(name, 0.0) + work

    def drop(self) -> list[float]:
        """Clear the fields, as for steps that are taken back. Returns the sums of their columns."""
        if not self.names:
            return []
        out = np.empty((self.count, self.columns), self.memory.number)
        self._take(out)
        return out.sum(0, dtype=np.float64).tolist()

    def take(self) -> dict[str, float]:
        """The work [J] since the last call, by account."""
        self.keep()
        kept, self.kept = self.kept, {}
        return kept


class Books:
    """The accounts of a run [J]: `works`, put into the system since they were opened; `opening`, the energy then, less
    the work of changes (see changes_over_time.py)."""

    def __init__(self, opening: float, names: list[str]):
        self.opening, self.works = opening, dict.fromkeys(names, 0.0)

    def add(self, works: dict[str, float]) -> None:
        for name, work in works.items():
            self.works[name] = self.works.get(name, 0.0) + work
