"""What happens when numbers go bad: the simulation goes back to its last good state and tells what grew."""

from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_jello.run.find_culprit import Blame, Culprit

if TYPE_CHECKING:
    from taichi_jello.run.simulation import Simulation
    from taichi_jello.run.snapshot import Snapshot


class Diverged(RuntimeError):
    """Numbers stopped being finite. The simulation is back at its last good state; `record` says what happened."""

    def __init__(self, record: dict[str, Any], find: Callable[[], Culprit | None] = lambda: None):
        self.record, self._find = record, find
        super().__init__(record)

    @cached_property
    def culprit(self) -> Culprit | None:
        """What grew first (see run/find_culprit.py), found when first asked for, which has to be before the simulation
        goes on; None if it has, or if nothing is known."""
        return self._find()

    def __str__(self) -> str:
        told = (
            "the numbers went bad at {time:.6g} s: particle {particle} of jello {jello} first, "
            "dt = {dt:.3g} s, safe dt = {safe_dt:.3g} s".format(**self.record)
        )
        return f"{told}; {self.culprit.told}" if self.culprit else told


def diverged(simulation: "Simulation", particle: int, part: int) -> Diverged:
    """The error to raise where `part` substeps that made no finite numbers of `particle` have been taken back."""
    clock, dt = simulation.clock, simulation.dt
    record = {
        "time": simulation.time + part * dt,
        "particle": particle,
        "jello": int(simulation.body.jello[particle]),
        "dt": dt,
        "safe_dt": simulation.safe_dt,
        "last_good_time": simulation.time,
    }
    _forget(simulation)
    return Diverged(record, partial(_blame, simulation, simulation.snapshot(), clock.done, clock.done + part))


def _blame(simulation: "Simulation", good: "Snapshot", first: int, last: int) -> Culprit | None:
    """Go through the failed substeps once more, and back."""
    now = simulation.snapshot()
    if now.clock != good.clock or not np.array_equal(now.x, good.x):
        return None
    found = Blame(simulation).find(first, last)
    if simulation.system.ledger:
        simulation.system.ledger.take()
    _forget(simulation)
    return found


def _forget(simulation: "Simulation") -> None:
    """Nothing of bad numbers stays in what the method keeps from step to step."""
    x, v = simulation.system.read()
    simulation.system.write(x, v)
    simulation.system.integrator.recall({})
