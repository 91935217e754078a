"""A run that is saved and gone on with, where springs remember."""

import numpy as np
import pytest

from taichi_jello import Box, Keyframe, Move, Pin, Scene, Simulation
from taichi_jello.run.trajectory import Trajectory, last_moment


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def test_torn_and_frozen_it_goes_on_from_its_file_to_the_same_bits(tmp_path):
    path = [Move(time=0.0, offset=(0.0, 0.0, 0.0)), Move(time=0.3, offset=(0.9, 0.0, 0.0))]
    pins = [Pin(max=(0.0, 1.0, 1.0)), Pin(min=(1.0, 0.0, 0.0), keyframe=path)]
    frozen = [Keyframe(time=0.0, stiffness=0.5), Keyframe(time=0.2, freeze=True)]
    scene = Scene(
        jello=[Box(points=(4, 2, 2), damping=1.0, yield_strain=0.3, tear_strain=0.6, pin=pins, keyframe=frozen)]
    )
    simulation = Simulation(scene)
    trajectory = Trajectory(simulation)
    simulation.step(14 * simulation.substeps + 1)
    trajectory.add()
    file = tmp_path / "half.npz"
    trajectory.save(file)
    with np.load(file) as arrays:
        assert {"memory_rest_length", "memory_whole", "memory_frozen"} <= set(arrays)
    simulation.step(9 * simulation.substeps)
    end = simulation.snapshot()
    assert not end.memory["whole"].all()
    simulation.reset()
    simulation.restore(last_moment(file, simulation.body))
    simulation.step(9 * simulation.substeps)
    assert np.array_equal(simulation.x, end.x) and np.array_equal(simulation.v, end.v)
    assert simulation.work == pytest.approx({name: float(end.memory[f"work.0.{name}"]) for name in simulation.work})


def test_bdf2_goes_on_from_its_file_to_the_same_bits(tmp_path):
    """It remembers a whole step, x and v of all particles."""
    simulation = Simulation(Scene(jello=[Box(points=(3, 3, 3), spin=(1.0, 2.0, 0.0))]), method="bdf2")
    simulation.frame()
    simulation.frame()
    trajectory = Trajectory(simulation)
    trajectory.add()
    trajectory.save(tmp_path / "half.npz")
    simulation.frame()
    x = simulation.x
    simulation.restore(last_moment(tmp_path / "half.npz", simulation.body))
    simulation.frame()
    assert np.array_equal(simulation.x, x)


def test_a_memory_of_another_scene_is_refused(tmp_path):
    body = Simulation(Scene(jello=[Box(points=(2, 2, 2))])).body
    np.savez(tmp_path / "odd.npz", x=body.x, v=body.v, memory_whole=np.ones(3, bool))
    with pytest.raises(ValueError, match="memory: expected a state of this scene"):
        last_moment(tmp_path / "odd.npz", body)
