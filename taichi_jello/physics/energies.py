"""The energies of a state, found outside the step."""

from typing import Any

import numpy as np
import taichi as ti

ENERGIES = ("kinetic", "elastic", "gravity", "contact")


@ti.data_oriented
class Probe:
    """Asks the forces of a System about its current state."""

    def __init__(self, system: Any):
        self.system, self.count = system, system.count
        self.storing = [tuple(f for f in system.all_forces if f.energy_kind == kind) for kind in ENERGIES]

    def make_ready(self, t: float) -> None:
        """Have the forces find contacts, and all else that they prepare, `t` seconds after the current frame began."""
        for r in range(self.system.rounds):
            self._look(r)
        if self.system.prepared:
            self._prepare(t)

    def energies(self, t: float) -> dict[str, float]:
        """Energy [J] of every kind `t` seconds after the current frame began, summed over the particles in float64."""
        shares = np.zeros((self.count, len(ENERGIES)), self.system.memory.number)
        self.make_ready(t)
        self._shares(t, shares)
        return dict(zip(ENERGIES, shares.sum(0, dtype=np.float64).tolist(), strict=True))

    @ti.kernel
    def _look(self, r: ti.template()):
        """One round of System.find_contacts without a team, whose other members it would wait for."""
        for force in ti.static(self.system.mutual):
            if ti.static(r < force.rounds):
                force.find_contacts(r, self.system, 0, self.count, self.system.state.x, self.system.state.v, 0.0)

    @ti.kernel
    def _prepare(self, t: float):
        for force in ti.static(self.system.prepared):
            force.prepare(0, force.points, self.system.state.x, self.system.state.v, t)

    @ti.kernel
    def _shares(self, t: float, out: ti.types.ndarray()):
        for i in range(self.count):
            v = self.system.state.v[i]
            out[i, 0] = 0.5 * self.system.particles.mass(i) * v.dot(v)
            for slot in ti.static(range(1, len(ENERGIES))):
                for force in ti.static(self.storing[slot]):
                    out[i, slot] += force.energy(i, self.system.state.x, t)
