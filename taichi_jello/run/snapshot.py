"""Snapshots of a running simulation."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Snapshot:
    """Everything a run needs to continue bit for bit: time [s], x [m] and v [m/s], (N, 3), and a memory of what springs
    and integrator keep from step to step, if anything. Without a memory the springs are as at the beginning and the
    next step is the integrator's first. A snapshot of a simulation also has its clock and what the hand holds."""

    time: float
    x: np.ndarray
    v: np.ndarray
    memory: dict[str, np.ndarray] = field(default_factory=dict)
    clock: tuple[float, int, int, float] | None = None  # time before the frames [s], frames, substeps, dt [s]
    grip: tuple[Any, ...] | None = None
