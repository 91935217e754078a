"""The same run gives the same bits: twice, by one thread, a team of two or in parallel tasks."""

import numpy as np
import pytest

from taichi_jello import Box, Plane, Room, Scene, Simulation, Sphere, runtime
from taichi_jello.physics.integrators import schemes

SCENE = Scene(
    jello=[
        Box(points=(5, 6, 7), position=(0.0, 0.9, 0.0), rotation=(10.0, 20.0, 30.0)),
        Box(position=(0.5, 2.2, 0.1)),
    ],
    collider=[
        Plane(),
        Sphere(center=(0.2, 0.0, 0.0), radius=0.3, swing=(0.1, 0.0, 0.0)),
        Room(min=(-3, -1, -3), max=(3, 6, 3)),
    ],
    drag=0.1,
)


def final_state(arch, precision, threads, **form):
    runtime.start(arch, precision, threads)
    simulation = Simulation(SCENE, substeps=60, **form)
    simulation.step(60 * 12)
    return simulation.x, simulation.v


CASES = [(method, "f32") for method in sorted(schemes())] + [("rk4", "f64"), ("verlet", "f64")]


@pytest.mark.filterwarnings("ignore:dt = ")
@pytest.mark.parametrize("method, number", CASES)
def test_same_bits_in_every_form(method, number, request):
    arch = request.config.getoption("--arch")
    number = "f32" if arch in ("vulkan", "metal") else number
    one = final_state(arch, number, 1, method=method)
    assert np.isfinite(one).all()
    for form in ({"team": 2}, {"team": 0}) if arch == "cpu" else ({},):
        assert np.array_equal(one, final_state(arch, number, 2, method=method, **form))


def test_same_bits_twice_from_the_same_simulation(best_precision):
    simulation = Simulation(SCENE)
    simulation.advance(0.2)
    once = simulation.snapshot()
    simulation.reset()
    simulation.advance(0.2)
    assert np.array_equal(once.x, simulation.x) and np.array_equal(once.v, simulation.v)
