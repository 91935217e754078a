"""Particles: the masses of a body as kernels see them."""

import numpy as np
import taichi as ti

from taichi_jello.physics.state import Memory
from taichi_jello.scene.body import Body


@ti.data_oriented
class Particles:
    """count N; `mass(i)` [kg] and `inverse_mass(i)` [1/kg], zero for a pinned particle. Equal masses and no pins
    need no field: the number is compiled in. origin (3,) [m] of the positions in fields."""

    def __init__(self, body: Body, memory: Memory, origin: np.ndarray):
        self.body, self.memory, self.count, self.origin = body, memory, len(body), origin
        self.uniform = bool(np.ptp(body.mass) <= 1e-12 * body.mass[0])
        self.pinned = bool(body.pinned.any())
        self.one_mass = float(body.mass[0])
        spare = memory.padded - len(body)
        if not self.uniform:
            self.masses = memory.table("mass", "mass", np.pad(body.mass, (0, spare), constant_values=1.0))
        if self.pinned:
            self.free = memory.table("pins", "free", np.pad(1 - body.pinned.astype(np.int32), (0, spare)))

    def traits(self) -> list[str]:
        """What is compiled in."""
        return ["unequal masses"] * (not self.uniform) + ["pins"] * self.pinned

    def absent_traits(self) -> list[str]:
        return ["unequal masses"] * self.uniform + ["pins"] * (not self.pinned)

    @ti.func
    def mass(self, i):
        m = ti.cast(self.one_mass, float)
        if ti.static(not self.uniform):
            m = self.masses[i]
        return m

    @ti.func
    def inverse_mass(self, i):
        w = 1.0 / self.mass(i)
        if ti.static(self.pinned):
            w *= self.free[i]
        return w
