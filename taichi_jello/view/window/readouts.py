"""Numbers that the panel shows of a simulation while it runs: energies over the last seconds, the largest force."""

import time
from collections import deque
from typing import Any

import numpy as np

from taichi_jello.physics.forces.springs.spring_state import springs_at
from taichi_jello.view.drawing.springs import loads

SPAN = 5.0  # s of the past that is kept
LEISURE = 10.0  # how many times as long as one reading of the force took, none is taken
ENERGIES = ("kinetic", "elastic", "gravity")


class Gauges:
    """`past`: rows of time [s] and the ENERGIES [J], the oldest first; `force`: the largest spring force [N];
    `books`: of a simulation with a ledger, all work done on the jellos and the residual [J]."""

    def __init__(self) -> None:
        self.past: deque[tuple[float, ...]] = deque()
        self.force = 0.0
        self.books: tuple[float, float] | None = None
        self._next = 0.0

    def read(self, simulation: Any, x: np.ndarray, v: np.ndarray) -> None:
        """Take a reading, with the particles at x [m] and moving at v [m/s], unless the last one is of this moment."""
        now = simulation.time
        if self.past and self.past[-1][0] == now:
            return
        if self.past and now < self.past[-1][0]:
            self.past.clear()
        energies = simulation.energies()
        self.past.append((now, *(energies[name] for name in ENERGIES)))
        if simulation.keeps_ledger:
            self.books = sum(simulation.work.values()), simulation.energy_residual
        while now - self.past[0][0] > SPAN:
            self.past.popleft()
        start = time.perf_counter()
        if start >= self._next:  # among many springs it takes longer than a picture
            self.force = largest_force(simulation, x, v)
            end = time.perf_counter()
            self._next = end + LEISURE * (end - start)


def largest_force(simulation: Any, x: np.ndarray, v: np.ndarray) -> float:
    """Of all springs [N]."""
    body, tuning = simulation.body, simulation.tuning
    if not len(body.springs):
        return 0.0
    i, j = body.springs.T
    law = springs_at(simulation.scene, body, simulation.time, simulation.snapshot().memory)
    stiffness, damping = (tuning.get(name, 1.0) * getattr(law, name) for name in ("stiffness", "damping"))
    return float(loads(x[j] - x[i], v[j] - v[i], law.rest_length, stiffness, damping).max())
