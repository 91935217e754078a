"""For stiff jellos: SDIRK2 where the motion is smooth, RK4 in impacts (as LSODA does, Petzold 1983)."""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.adaptive.adaptive_stepper import AdaptiveStepper
from taichi_jello.physics.integrators.rk4 import RK4
from taichi_jello.physics.integrators.sdirk2 import SDIRK2


@ti.data_oriented
class Adaptive(SDIRK2):
    """AdaptiveStepper halves steps of SDIRK2 until they are accurate, and takes RK4 at its own safe step where that
    costs no more. It does not repeat steps in which contacts change: it halves those that are inaccurate."""

    name, order = "adaptive", 2
    fixed_step = repeats_steps = False
    pushes = True
    automatic = "a frame, cut where the motion asks for it"

    def allocate(self) -> None:
        super().allocate()
        self.explicit = RK4(self.memory, self.state, self.damped, self.body)
        self.push = self.memory.vectors(self.name, "push")
        self.past: dict[str, np.ndarray] = {}  # see AdaptiveStepper
        self.explicit_passes = 0  # of RK4's steps through all springs

    @property
    def passes_so_far(self) -> int:
        return super().passes_so_far + self.explicit_passes

    @ti.kernel
    def set_push(self, push: ti.types.ndarray()):
        for i in range(push.shape[0]):
            for axis in ti.static(range(3)):
                self.push[i][axis] = push[i, axis]

    def make_stepper(self, system: Any) -> AdaptiveStepper:
        return AdaptiveStepper(system, self)

    def remembered(self) -> dict[str, np.ndarray]:
        return {f"adaptive.{name}": values for name, values in self.past.items()}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        self.past = {n.removeprefix("adaptive."): v for n, v in memory.items() if n.startswith("adaptive.")}
