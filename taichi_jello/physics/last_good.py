"""The last state with finite, bounded numbers, which a run returns to."""

import numpy as np
import taichi as ti

from taichi_jello.physics.state import Memory, State
from taichi_jello.scene.validation import FASTEST


@ti.data_oriented
class LastGood:
    """x [m] and v [m/s], (N, 3) each, of the last state that was set, or kept since it was finite and slower than
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
        """Write both to the fields and keep them."""
        self._values = np.hstack([x, v]).astype(self.number)
        self.write(self._values)

    def keep(self) -> int | None:
        """Keep what is in the fields; or restore them, if it is bad, and return the first particle with such a
        number."""
        values = np.empty_like(self._values)
        self.read(values)
        with np.errstate(invalid="ignore"):
            total = values.sum(dtype=np.float64)  # cheaper than np.isfinite
        speeds = values[:, 3:]
        if not (np.isfinite(total) and speeds.min() > -FASTEST and speeds.max() < FASTEST):
            bad = np.flatnonzero(~(np.isfinite(values).all(1) & (np.abs(speeds) < FASTEST).all(1)))
            if len(bad):
                self.write(self._values)
                return int(bad[0])
        self._values = values
        return None

    @ti.kernel
    def write(self, values: ti.types.ndarray()):
        """Copy x and v, (N, 6), to the fields."""
        if ti.static(self.team == 1):
            ti.loop_config(serialize=True)
        for i in range(self.count):
            for axis in ti.static(range(3)):
                self.state.x[i][axis] = values[i, axis]
                self.state.v[i][axis] = values[i, 3 + axis]

    @ti.kernel
    def read(self, values: ti.types.ndarray()):
        """Copy x and v, (N, 6), from the fields."""
        if ti.static(self.team == 1):
            ti.loop_config(serialize=True)
        for i in range(self.count):
            for axis in ti.static(range(3)):
                values[i, axis] = self.state.x[i][axis]
                values[i, 3 + axis] = self.state.v[i][axis]
