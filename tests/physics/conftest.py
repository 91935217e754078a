"""What physics tests share: the forces that a simulation computes for any state."""

import pytest
import taichi as ti
from reference import read

from taichi_jello import Snapshot


@pytest.fixture(scope="module")
def forces():
    """forces(simulation, x, v) -> (N, 3) force on every particle [N] in that state."""
    compiled = {}

    def prepare(system):
        out = system.memory.vectors("test", "a")

        @ti.kernel
        def fill():
            system.find_contacts(0, system.count, system.state.x, system.state.v, 0.0)
            system.accelerations(0, system.count, system.state.x, system.state.v, 0.0, out)

        return system, fill, out

    def evaluate(simulation, x=None, v=None):
        start = simulation.snapshot()
        x, v = (start.x if x is None else x), (start.v if v is None else v)
        simulation.restore(Snapshot(simulation.time, x, v))
        system, fill, out = compiled.setdefault(id(simulation.system), None) or prepare(simulation.system)
        compiled[id(simulation.system)] = system, fill, out
        system.begin_frame(0.0, simulation.frame_dt)
        fill()
        result = read(system.memory, out) * simulation.body.mass[:, None]
        simulation.restore(start)
        return result

    return evaluate
