"""The error for a simulation that diverged. It is back at its last good state and can find what grew first."""

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_jello.run.find_culprit import Blame, Culprit

if TYPE_CHECKING:
    from taichi_jello.run.simulation import Simulation


class Diverged(RuntimeError):
    """Numbers stopped being finite. The simulation is back at its last good state; `record` has the details."""

    def __init__(self, record: dict[str, Any], find: Callable[[], Culprit | None] = lambda: None):
        self.record, self._find = record, find
        super().__init__(record)

    @cached_property
    def culprit(self) -> Culprit | None:
        """What grew first (see find_culprit.py); None if unknown. Must be read before the simulation goes on."""
        return self._find()

    def __str__(self) -> str:
        text = (
            "the numbers went bad at {time:.6g} s: particle {particle} of jello {jello} first, "
            "dt = {dt:.3g} s, safe dt = {safe_dt:.3g} s".format(**self.record)
        )
        return f"{text}; {self.culprit.words}" if self.culprit else text


def diverged(simulation: "Simulation", particle: int, part: int) -> Diverged:
    """The error for `part` substeps that gave `particle` numbers that are not finite and were taken back."""
    clock, system = simulation.clock, simulation.system

    def forget() -> None:
        """Restore the last good state also in what the integrator keeps from step to step."""
        system.write(*system.read())
        system.integrator.recall({})

    forget()
    good, first = simulation.snapshot(), clock.done

    def find() -> Culprit | None:
        now = simulation.snapshot()
        if now.clock != good.clock or not np.array_equal(now.x, good.x):
            return None
        found = Blame(simulation).find(first, first + part)
        if system.ledger:
            system.ledger.take()
        forget()
        return found

    record = {
        "time": simulation.time + part * simulation.dt,
        "particle": particle,
        "jello": int(simulation.body.jello[particle]),
        "dt": simulation.dt,
        "safe_dt": simulation.safe_dt,
        "last_good_time": simulation.time,
    }
    return Diverged(record, find)
