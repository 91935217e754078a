"""Everything that a run needs to go on to the same bits."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Snapshot:
    """Everything a run needs to go on to the same bits: time [s], x [m] and v [m/s], (N, 3), and a memory of what has
    changed in the springs and of what the method keeps from step to step, empty where there is neither. Without it a
    run goes on as if nothing had changed before and this step were the first. Where a simulation has made it, also the
    clock that `time` is the sum of, and what the hand does."""

    time: float
    x: np.ndarray
    v: np.ndarray
    memory: dict[str, np.ndarray] = field(default_factory=dict)
    clock: tuple[float, int, int, float] | None = None  # time before the frames [s], frames, substeps, dt [s]
    grip: tuple[Any, ...] | None = None
