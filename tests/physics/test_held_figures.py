"""What bars that fall across each other and cubes that melt are held to."""

from dataclasses import replace

import numpy as np
import pytest
from reference import twisted
from surfaces import heights

from taichi_jello import Box, Keyframe, Pin, Scene, Simulation, Snapshot
from taichi_jello.studies._contact.through import watched
from taichi_jello.support import runtime

HEIGHT, MASS = 0.3, 0.3  # m, kg of the bar that falls


@pytest.fixture(autouse=True)
def taichi(request):
    runtime.start(request.config.getoption("--arch"), "f32")


@pytest.mark.parametrize("points", [17, 9])
def test_a_bar_that_falls_across_a_held_one_stays_above_and_gains_no_energy(points):
    """Its points come down in the planes of the other's sides, or between its few points: both went through once."""
    thick, aside = (0.1, 0.05) if points == 17 else (0.04, 0.1)
    bar = Box(points=(points, 2, 2), size=(1.6, thick, thick), stiffness=2000.0, damping=1.0)
    falls = replace(bar, position=(aside, HEIGHT, aside), rotation=(0.0, 90.0, 0.0), mass=MASS, stiffness=500.0)
    ends = [Pin(max=(0.001, 1.0, 1.0)), Pin(min=(0.999, 0.0, 0.0))]
    scene = Scene(jello=[replace(bar, pin=ends), replace(falls, damping=0.2)])
    simulation, fed = Simulation(scene, ledger=True), 0.0
    watch = watched(simulation.body)
    for _ in range(45):
        watch.look(simulation.x.astype(float), False)
        simulation.frame()
        fed = max(fed, simulation.energy_residual)
    watch.look(simulation.x.astype(float), False)
    assert not watch.went and fed < 0.05 * MASS * 9.81 * HEIGHT


def test_a_cube_that_melts_falls_freely():
    """However it is twisted at first: springs add no momentum."""
    melt = [Keyframe(time=0.1), Keyframe(time=0.2, stiffness=1.0), Keyframe(time=0.4, stiffness=0.0)]
    simulation = Simulation(Scene(jello=[Box(points=(4, 4, 4), keyframe=melt)]))
    simulation.restore(Snapshot(0.0, twisted(simulation.body.x), simulation.v))
    start = simulation.x.astype(float).mean(0)
    for _ in range(60):
        simulation.frame()
        fallen = [0.0, -0.5 * 9.81 * simulation.time**2, 0.0]
        assert np.abs(simulation.x.astype(float).mean(0) - start - fallen).max() < 1e-6 * 4.905


def test_heights_are_those_of_faces_that_lie():
    """A roof over a floor: the steep side of the roof counts for nothing."""
    x = np.array([[0, 0, 0], [4, 0, 0], [0, 0, 4], [0, 1, 0], [4, 3, 0], [0, 1, 4], [4, 9, 4]], float)
    floor, roof, wall = [0, 1, 2], [3, 4, 5], [4, 5, 6]
    columns = np.array([[1.0, 1.0], [3.9, 3.9], [9.0, 0.0]])
    found = [heights(x, np.array([floor, roof, wall]), columns, side) for side in (-1.0, 1.0)]
    assert found[0] == pytest.approx([0.0, np.nan, np.nan], nan_ok=True)
    assert found[1] == pytest.approx([1.5, np.nan, np.nan], nan_ok=True)
