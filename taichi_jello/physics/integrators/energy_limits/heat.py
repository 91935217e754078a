"""Whether a jello is wild: whether it has enough energy for its springs to pass through zero length."""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.scene.body import Body

# Deformation energy over the energy of all springs at zero length. In a network in equilibrium a spring has no length
# with a probability of about exp(-1/ratio). In a minute at √Λ dt = 0.4, cubes with a ratio of 0.04 gain nothing, with
# 0.12 they gain 6 %, with 0.25 and more at least 14 %. A cube stretched by 2 % has 0.0001, stretched to 1.4 of its
# length 0.038, to twice its length 0.26.
WILD = 0.04


@ti.data_oriented
class Heat:
    """The energy of each jello apart from its translation, against that of its springs at zero length."""

    def __init__(self, system: Any, springs: Any, body: Body):
        self.system, self.springs, self.count = system, springs, len(body)
        self.starts = np.unique(body.jello, return_index=True)[1]
        self.mass = np.add.reduceat(body.mass, self.starts)

    def wild(self) -> bool:
        """Whether any jello is wild in the present state."""
        shares = np.zeros((self.count, 5), self.system.memory.number)
        self._shares(shares)
        sums = np.add.reduceat(shares, self.starts, axis=0, dtype=np.float64)
        energy, crushed, momentum = sums[:, 0], sums[:, 1], sums[:, 2:]
        translation = 0.5 * np.sum(momentum**2, 1) / self.mass
        return bool(np.any((crushed > 0.0) & (energy - translation > WILD * crushed)))

    @ti.kernel
    def _shares(self, out: ti.types.ndarray()):
        """Energy, energy at zero length and momentum of each particle."""
        if ti.static(self.system.team == 1):
            ti.loop_config(serialize=True)
        for i in range(self.count):
            v, m = self.system.state.v[i], self.system.particles.mass(i)
            out[i, 0] = 0.5 * m * v.dot(v) + self.springs.energy(i, self.system.state.x, 0.0)
            out[i, 1] = self.springs.crushed(i)
            for axis in ti.static(range(3)):
                out[i, 2 + axis] = m * v[axis]
