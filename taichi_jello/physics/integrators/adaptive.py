"""For stiff jellos: implicit steps where the motion is smooth, RK4 where something hits (as Petzold 1983, LSODA)."""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.adaptive.adaptive_stepper import AdaptiveStepper
from taichi_jello.physics.integrators.rk4 import RK4
from taichi_jello.physics.integrators.sdirk2 import GAMMA, SDIRK2


@ti.data_oriented
class Adaptive(SDIRK2):
    """SDIRK2 whose steps are halved until they are accurate, each checked by AdaptiveStepper, and RK4 at its own safe
    step where that costs no more than the implicit steps that would be needed: in impacts. No step of it is made again
    for what touches: those that are not right are halved."""

    name, order = "adaptive", 2
    fixed_step = False
    automatic = "a frame, cut where the motion asks for it"

    def __init__(self, memory, state, damped, body):
        super().__init__(memory, state, damped, body)
        self.body, self.explicit = body, RK4(memory, state, damped, body)
        self.push = memory.vectors(self.name, "push")  # [m/s²] besides what forces do, constant in a step
        self.past: dict[str, np.ndarray] = {}  # what the stepper goes on from

    def meet(self, forces):
        self.explicit.meet(forces)

    def bound(self, forces, drag):
        self.limit = self.explicit.bound(forces, drag).dt  # [s] of RK4
        return super().bound(forces, drag)

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        """As SDIRK2's, which is not made again; the push is a part of both accelerations."""
        for i in range(first, last):
            x, v = self.state.x[i], self.state.v[i]
            if s == 1:
                v1 = self.solver.at.v[i]
                x += (1.0 - GAMMA) * dt * v1
                v += (1.0 - GAMMA) / GAMMA * (v1 - v)
            self.solver.z[i] = x
            self.solver.w[i] = self.solver.at.v[i] = v + GAMMA * dt * self.push[i]
        self.solver.start(system, first, last, GAMMA * dt, t + (GAMMA + s * (1.0 - GAMMA)) * dt)

    @ti.kernel
    def set_push(self, push: ti.types.ndarray()):
        for i in range(push.shape[0]):
            for axis in ti.static(range(3)):
                self.push[i][axis] = push[i, axis]

    def make_stepper(self, system: Any) -> AdaptiveStepper:
        return AdaptiveStepper(system, self)

    def remembered(self):
        return {f"adaptive.{name}": values for name, values in self.past.items()}

    def recall(self, memory):
        self.past = {n.removeprefix("adaptive."): v for n, v in memory.items() if n.startswith("adaptive.")}
