"""The two-step backward differentiation formula of order 2:

x' = x + (x - x₋)/3 + ⅔ dt v',    v' = v + (v - v₋)/3 + ⅔ dt a(x', v')."""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.integrators._base import serial
from taichi_jello.physics.integrators.implicit_solve._implicit import Implicit
from taichi_jello.physics.state import State


@ti.data_oriented
class BDF2(Implicit):
    """Backward Euler takes the first step, the first of another length, and the first after a contact has begun or
    ended: there is no earlier step to extrapolate from."""

    name, order = "bdf2", 2
    share = 2.0 / 3.0
    repeats_steps = True

    def allocate(self) -> None:
        super().allocate()
        self.before = State.made_in(self.memory, "step before")
        self.knows = self.memory.table(self.name, "knows the step before", np.zeros(1, np.int32))

    def prepare(self, system: Any, dt: float) -> None:
        if dt != self.last_dt:
            self.knows[0] = 0
        super().prepare(system, dt)

    def remembered(self) -> dict[str, np.ndarray]:
        found = super().remembered()
        if not self.knows[0]:
            return found
        x, v = (field.to_numpy()[self._own_places()] for field in (self.before.x, self.before.v))
        return found | {"before.x": x, "before.v": v, "before.dt": np.array(self.last_dt)}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        super().recall(memory)
        self.knows[0] = int("before.dt" in memory)
        if self.knows[0]:
            self.last_dt = float(memory["before.dt"])
            self.prepared = False
            for field, name in ((self.before.x, "before.x"), (self.before.v, "before.v")):
                values = np.zeros((*field.shape, 3), self.memory.number)
                values[self._own_places()] = memory[name]
                field.from_numpy(values)

    def _own_places(self) -> slice:
        """Of the particles in the array of a field, which begins with the guard."""
        return slice(self.memory.guard, self.memory.guard + self.memory.particles)

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        system.wait_for_team()  # until every thread has set `knows`
        knows, solves, c = self.knows[0], 1, dt
        if ti.static(len(self.contacts) > 0):
            begins = ti.cast(s == 0, ti.i32)
            repeats = self.contacts_changed(system, first, last, t + dt, begins) & knows
            solves = repeats | begins
            knows = knows & (1 - repeats)
        if knows:
            c = self.share * dt
        for i in range(first, last):
            x, v = self.state.x[i], self.state.v[i]
            if knows:
                x += (x - self.before.x[i]) / 3.0
                v += (v - self.before.v[i]) / 3.0
            if solves:
                self.solver.z[i] = x
                self.solver.w[i] = self.solver.at.v[i] = v
        self.solver.start(system, first, last, c, t + dt, solves)

    @ti.func
    def finish(self, system, first, last, t, dt):
        hit = 0
        if ti.static(len(self.contacts) > 0):
            hit = self.contacts_changed(system, first, last, t + dt)
            self.keep_contacts(system, first, last)
        hit = hit | system.stop_at_solids(first, last, self.state.x, self.solver.at.x, self.solver.at.v, t, dt)
        for i in range(first, last):
            self.before.x[i], self.before.v[i] = self.state.x[i], self.state.v[i]
            self.state.x[i], self.state.v[i] = self.solver.at.x[i], self.solver.at.v[i]
        if serial(first, last):
            self.knows[0] = 1 - hit  # no extrapolation across an impact

    @classmethod
    def amplification(cls, a: np.ndarray, zeta: np.ndarray) -> np.ndarray:
        """(…, 2, 2) diagonal matrices with the spectral radius of the method's (…, 4, 4) ones, which map two steps of x
        and v. For x'' = -x - 2ζx' each mode y' = λy has the roots of ρ² - (4ρ - 1)/(3 - 2λa) = 0."""
        a, zeta = np.broadcast_arrays(np.asarray(a, float), np.asarray(zeta, float))
        root = np.sqrt(zeta.astype(complex) ** 2 - 1.0)
        largest = np.zeros(a.shape)
        for rate in (-zeta + root, -zeta - root):
            half = 2.0 / (3.0 - 2.0 * rate * a)
            offset = np.sqrt(half**2 - half / 2.0)
            largest = np.maximum(largest, np.maximum(abs(half + offset), abs(half - offset)))
        return largest[..., None, None] * np.eye(2)
