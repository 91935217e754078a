"""For stiff jellos: implicit steps where the motion is smooth, RK4 where something hits (as Petzold 1983, LSODA)."""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.adaptive_stepper import AdaptiveStepper
from taichi_jello.physics.integrators.rk4 import RK4
from taichi_jello.physics.integrators.sdirk2 import SDIRK2


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
        self.past: dict[str, np.ndarray] = {}  # what the stepper goes on from

    def meet(self, forces):
        self.explicit.meet(forces)

    def bound(self, forces, drag):
        self.limit = self.explicit.bound(forces, drag).dt  # [s] of RK4
        return super().bound(forces, drag)

    def make_stepper(self, system: Any) -> AdaptiveStepper:
        return AdaptiveStepper(system, self)

    def remembered(self):
        return {f"adaptive.{name}": values for name, values in self.past.items()}

    def recall(self, memory):
        self.past = {n.removeprefix("adaptive."): v for n, v in memory.items() if n.startswith("adaptive.")}
