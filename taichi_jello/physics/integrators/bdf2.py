"""The two-step backward differentiation formula of order 2: x' = (4x - x₋)/3 + ⅔ dt v', and v' alike."""

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators.implicit_solve._implicit import Implicit
from taichi_jello.physics.state import State


@ti.data_oriented
class BDF2(Implicit):
    """It needs the step before. The first step, the first of another length and the first after anything came to touch
    or let go is one of backward Euler."""

    name, order = "bdf2", 2
    share = 2.0 / 3.0

    def __init__(self, memory, state, damped, body):
        super().__init__(memory, state, damped, body)
        self.before = State.made_in(memory, "step before")
        self.knows = memory.table(self.name, "knows the step before", np.zeros(1, np.int32))
        self.shape = (memory.particles, 3)

    def meet(self, forces):
        self.watch_contact(forces)

    def prepare(self, system, dt):
        if dt != self.last_dt:
            self.knows[0] = 0
        super().prepare(system, dt)

    def remembered(self):
        told = super().remembered()
        if not self.knows[0]:
            return told
        x, v = np.zeros((2, *self.shape), self.number)
        self._read(x, v)
        return told | {"before.x": x, "before.v": v, "before.dt": np.array(self.last_dt)}

    def recall(self, memory):
        super().recall(memory)
        self.knows[0] = int("before.dt" in memory)
        if self.knows[0]:
            self.last_dt = float(memory["before.dt"])
            self.prepared = False
            self._write(*(np.ascontiguousarray(memory[f"before.{name}"], self.number) for name in "xv"))

    @ti.kernel
    def _read(self, x: ti.types.ndarray(), v: ti.types.ndarray()):
        for i in range(x.shape[0]):
            for axis in ti.static(range(3)):
                x[i, axis], v[i, axis] = self.before.x[i][axis], self.before.v[i][axis]

    @ti.kernel
    def _write(self, x: ti.types.ndarray(), v: ti.types.ndarray()):
        for i in range(x.shape[0]):
            for axis in ti.static(range(3)):
                self.before.x[i][axis], self.before.v[i][axis] = x[i, axis], v[i, axis]

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        system.wait_for_team()  # until everybody knows whether the step before is known
        knows, wanted, c = self.knows[0], 1, dt
        if ti.static(len(self.contacts) > 0):
            begins = ti.cast(s == 0, ti.i32)
            again = self.strikes(system, first, last, t + dt, begins) & knows
            wanted = again | begins
            knows = knows & (1 - again)
        if knows:
            c = self.share * dt
        for i in range(first, last):
            x, v = self.state.x[i], self.state.v[i]
            if knows:
                x += (x - self.before.x[i]) / 3.0
                v += (v - self.before.v[i]) / 3.0
            if wanted:
                self.solver.z[i] = x
                self.solver.w[i] = self.solver.at.v[i] = v
        self.solver.start(system, first, last, c, t + dt, wanted)

    @ti.func
    def finish(self, system, first, last, t, dt):
        x, v = ti.static(self.solver.at.x, self.solver.at.v)
        struck = 0
        if ti.static(len(self.contacts) > 0):
            struck = self.strikes(system, first, last, t + dt)
            self.end_touch(system, first, last)
        struck = struck | system.stop_at_solids(first, last, self.state.x, x, v, t, dt)
        for i in range(first, last):
            self.before.x[i], self.before.v[i] = self.state.x[i], self.state.v[i]
            self.state.x[i], self.state.v[i] = self.solver.at.x[i], self.solver.at.v[i]
        for _ in range(1):
            if first == 0 and last > 0:
                self.knows[0] = 1 - struck  # across an impact nothing may be extrapolated

    @classmethod
    def amplification(cls, a, zeta):
        """The larger root of both steps' matrix is what grows: (…, 2, 2) with that radius, since x and v of two steps
        would be (…, 4, 4). For x'' = -x - 2ζx' every mode y' = λy has ρ² - (4ρ - 1)/(3 - 2λa) = 0."""
        a, zeta = np.broadcast_arrays(np.asarray(a, float), np.asarray(zeta, float))
        root = np.sqrt(zeta.astype(complex) ** 2 - 1.0)
        largest = np.zeros(a.shape)
        for rate in (-zeta + root, -zeta - root):
            half = 2.0 / (3.0 - 2.0 * rate * a)
            swing = np.sqrt(half**2 - half / 2.0)
            largest = np.maximum(largest, np.maximum(abs(half + swing), abs(half - swing)))
        return largest[..., None, None] * np.eye(2)
