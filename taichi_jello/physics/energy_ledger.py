"""The energy ledger: the work [J] of everything that stores no energy, so that what is left over is the method's error.

d/dt (kinetic + stored energy) = Σ P, the powers of dashpots, friction, drag, the hand, moving colliders and fields. The
integral of P over the substeps of one call is Gregory's rule, the trapezoid rule with end corrections, whose error
falls with dt⁴: the state at the end of every substep is all it needs, so that it is the same for every scheme.
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
    """One account for each of `names`. The fields hold the work of one call of System.steps for each particle; `take`
    sums it up in float64, so that long runs do not drift in f32 either.

    A force has the accounts `works` and their `powers`; one that has none, stores no energy and is asked one by one
    has the account of its title and the power F · v. Where there are handles they have one too: a held particle that
    moves at v does so against all forces on it, with the power -F · v (what other jellos press on it is left out).
    Where jellos touch, what pushes a point to another than its nearest way out has no potential: that stays in the
    residual.
    """

    def __init__(self, forces: tuple[ParticleForce, ...], memory: Memory, handles: bool = False):
        self.own = tuple(force for force in forces if force.works)
        self.plain = tuple(f for f in forces if not f.works and f.energy_kind is None and not f.in_passes)
        self.names = [name for force in self.own for name in force.works] + [force.title for force in self.plain]
        self.handles, self.alone = handles, tuple(force for force in forces if not force.prepares)
        self.impacts = len(self.names)  # the column of what is lost in the cores of solids
        brakes = any(force.brake for force in forces if isinstance(force, MutualForce))
        self.names += ["impacts"] * (brakes or any(force.sweep for force in forces)) + ["handles"] * handles
        self.starts = tuple(int(n) for n in np.cumsum([0] + [len(force.works) for force in self.own]))
        self.memory, self.count, self.columns = memory, memory.particles, len(self.names)
        self.kept: dict[str, float] = {}  # of the call that runs
        if self.names:
            self.work = memory.table("ledger", "work", np.zeros((self.count, self.columns)))

    @ti.func
    def book(self, system, first, last, k, n, start, dt):
        """Add the work at place k of n of the particles first … last - 1; `start` substeps of the frame came before."""
        system.wait_for_team()  # until all particles are where they are at the end of the substep
        t, weight = (start + k) * dt, quadrature(k, n) * dt
        x, v = ti.static(system.state.x, system.state.v)
        for i in range(first, last):
            for f in ti.static(range(len(self.own))):
                powers = self.own[f].powers(i, x, v, t)
                for c in ti.static(range(len(self.own[f].works))):
                    column = ti.static(self.starts[f] + c)
                    self.work[i][column] = self.work[i][column] + weight * powers[c]
                if ti.static(self.own[f].burdens and system.integrator.loads):  # what moves its own mass moves no jello
                    own, column = 0.5 * self.own[f].added_mass(i) * v[i].dot(v[i]), ti.static(self.starts[f])
                    self.work[i][column] = self.work[i][column] + ti.select(k == 0, own, ti.select(k == n, -own, 0.0))
            for f in ti.static(range(len(self.plain))):
                column = ti.static(self.starts[-1] + f)
                force = self.plain[f].on(i, x, v, t)
                self.work[i][column] = self.work[i][column] + weight * force.dot(v[i])
            if ti.static(self.handles):
                if system.particles.inverse_mass(i) == 0.0 and v[i].dot(v[i]) > 0.0:
                    against = ti.Vector([0.0, 0.0, 0.0])
                    for force in ti.static(self.alone):
                        against += force.on(i, x, v, t)
                        if ti.static(force.burdens):
                            against += force.on_held(i, x, v, t)
                    column = ti.static(self.columns - 1)
                    self.work[i][column] = self.work[i][column] - weight * against.dot(v[i])
        system.wait_for_team()  # until nobody needs x and v any more

    @ti.func
    def book_impact(self, i, mass, v, push):
        """Add the work on particle i, which moved at v, of an impact that changed that by `push` at once."""
        self.work[i][self.impacts] = self.work[i][self.impacts] + mass * push.dot(v + 0.5 * push)

    @ti.kernel
    def _take(self, out: ti.types.ndarray()):
        for i in range(self.count):
            for c in ti.static(range(self.columns)):
                out[i, c] = self.work[i][c]
                self.work[i][c] = 0.0

    def keep(self) -> None:
        """Add what is in the fields to what is kept."""
        for name, work in zip(self.names, self._sums(), strict=True):
            self.kept[name] = self.kept.get(name, 0.0) + work

    def drop(self) -> None:
        """Forget what is in the fields: the work of steps that are taken back."""
        self._sums()

    def take(self) -> dict[str, float]:
        """The work [J] since the last time, by account."""
        self.keep()
        kept, self.kept = self.kept, {}
        return kept

    def _sums(self) -> list[float]:
        """The columns of the fields, which begin anew."""
        if not self.names:
            return []
        out = np.empty((self.count, self.columns), self.memory.number)
        self._take(out)
        return out.sum(0, dtype=np.float64).tolist()


class Books:
    """The accounts of a run [J]: `works`, put into the system since they were opened; `opening`, the energy there was
    then, less the work of changes (see changes_over_time.py)."""

    def __init__(self, opening: float, names: list[str]):
        self.opening, self.works = opening, dict.fromkeys(names, 0.0)

    def add(self, works: dict[str, float]) -> None:
        for name, work in works.items():
            self.works[name] = self.works.get(name, 0.0) + work
