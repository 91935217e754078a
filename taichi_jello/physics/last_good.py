"""The last state that was good: what is looked at between frames, and what a run goes back to."""

import numpy as np
import taichi as ti

from taichi_jello.physics.state import Memory, State
from taichi_jello.scene.validation import FASTEST


@ti.data_oriented
class LastGood:
    """x [m] and v [m/s], (N, 3) each, of the last state that was set, or kept as all was finite and slower than
    FASTEST."""

    def __init__(self, memory: Memory, state: State, team: int, x: np.ndarray, v: np.ndarray):
        self.count, self.state, self.team, self.number = memory.particles, state, team, memory.number
        self._values = np.hstack([x, v]).astype(self.number)

    @property
    def x(self) -> np.ndarray:
        return self._values[:, :3]

    @property
    def v(self) -> np.ndarray:
        return self._values[:, 3:]

    def set(self, x: np.ndarray, v: np.ndarray) -> None:
        """Put both into the fields, and take them for good."""
        self._values = np.hstack([x, v]).astype(self.number)
        self.write(self._values)

    def keep(self) -> int | None:
        """Take what is in the fields for good; or, if it is not, put the last good state there again and return the
        first particle with such a number."""
        values = np.empty_like(self._values)
        self.read(values)
        with np.errstate(invalid="ignore"):
            total = values.sum(dtype=np.float64)  # one sum is cheaper than a look at each
        speeds = values[:, 3:]
        if not (np.isfinite(total) and speeds.min() > -FASTEST and speeds.max() < FASTEST):
            good = np.isfinite(values).all(1) & (np.abs(speeds) < FASTEST).all(1)
            bad = np.flatnonzero(~good)
            if len(bad):
                self.write(self._values)
                return int(bad[0])
        self._values = values
        return None

    @ti.kernel
    def write(self, values: ti.types.ndarray()):
        """Put x and v, (N, 6), into the fields."""
        if ti.static(self.team == 1):
            ti.loop_config(serialize=True)
        for i in range(self.count):
            for axis in ti.static(range(3)):
                self.state.x[i][axis] = values[i, axis]
                self.state.v[i][axis] = values[i, 3 + axis]

    @ti.kernel
    def read(self, values: ti.types.ndarray()):
        """Take x and v, (N, 6), out of the fields, good or not."""
        if ti.static(self.team == 1):
            ti.loop_config(serialize=True)
        for i in range(self.count):
            for axis in ti.static(range(3)):
                values[i, axis] = self.state.x[i][axis]
                values[i, 3 + axis] = self.state.v[i][axis]
