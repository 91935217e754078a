"""Whether a jello is wild: whether it has so much energy that its springs pass through zero length."""

from typing import Any

import numpy as np
import taichi as ti

# Energy over what all springs would store if they had no length. In a network that has shared its energy out a spring
# has no length with a chance of about exp(-1/that). Cubes with 0.04 gain nothing in a minute at √Λ dt = 0.4, with 0.12
# they gain 6 %, with 0.25 and more 14 % and up. Stretched by 2 % a cube has 0.0001, stretched to 1.4 of its length
# 0.038, to twice its length 0.26.
WILD = 0.04
COLUMNS = 5  # energy, energy with no length, momentum


@ti.data_oriented
class Heat:
    """The energy of each jello that is not its flight as a whole, against what crushes its springs to no length.

    Energy is what a motion keeps, so that it tells at any moment what will be at others."""

    def __init__(self, system: Any, springs: Any, body: Any):
        self.system, self.springs, self.count = system, springs, len(body)
        self.starts = np.unique(body.jello, return_index=True)[1]
        self.mass = np.add.reduceat(body.mass, self.starts)

    def wild(self) -> bool:
        """Whether any jello is, in the state that the system is in."""
        shares = np.zeros((self.count, COLUMNS), self.system.memory.number)
        self._shares(shares)
        sums = np.add.reduceat(shares, self.starts, axis=0, dtype=np.float64)
        flight = 0.5 * np.sum(sums[:, 2:] ** 2, 1) / self.mass
        crushed = sums[:, 1]
        return bool(np.any((crushed > 0.0) & (sums[:, 0] - flight > WILD * crushed)))

    @ti.kernel
    def _shares(self, out: ti.types.ndarray()):
        if ti.static(self.system.team == 1):
            ti.loop_config(serialize=True)
        for i in range(self.count):
            v, m = self.system.state.v[i], self.system.particles.mass(i)
            out[i, 0] = 0.5 * m * v.dot(v) + self.springs.energy(i, self.system.state.x, 0.0)
            out[i, 1] = self.springs.crushed(i)
            for axis in ti.static(range(3)):
                out[i, 2 + axis] = m * v[axis]
