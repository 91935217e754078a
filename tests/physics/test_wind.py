"""Wind takes a free body along: closed form, and nothing at all while it is calm."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_jello import Box, Scene, Simulation
from taichi_jello.physics.forces.wind import Wind, with_wind

pytestmark = pytest.mark.usefixtures("best_precision")
SCENE = Scene(gravity=(0.0, 0.0, 0.0), jello=[Box(points=(2, 2, 2), velocity=(0.0, 1.0, 0.0))])


def test_speed_nears_the_wind_s_exponentially():
    """v(t) = w + (v(0) - w) e^(-γt), exact up to RK4's error, (γh)^5/120 a step, far below rounding here."""
    simulation = Simulation(with_wind(SCENE))
    simulation.advance(0.5)
    assert simulation.v.mean(0) == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)  # calm
    wind, before = np.array([4.0, 0.0, -2.0]), simulation.time
    simulation.tune(wind=wind)
    simulation.advance(0.7)
    left = np.exp(-Wind().rate * (simulation.time - before))
    assert simulation.v.mean(0) == pytest.approx(wind + (np.array([0.0, 1.0, 0.0]) - wind) * left, abs=1e-5)
    simulation.tune(wind=(0.0, 0.0, 0.0))
    calm = simulation.v.mean(0)
    simulation.advance(0.5)
    assert simulation.v.mean(0) == pytest.approx(calm, abs=1e-5)


def test_a_wind_of_the_scene_blows_from_the_start_and_is_kept():
    scene = replace(SCENE, force=[Wind(velocity=(3.0, 0.0, 0.0), rate=2.0)])
    assert with_wind(scene) is scene
    simulation = Simulation(scene)
    simulation.advance(0.25)
    assert simulation.v.mean(0)[0] == pytest.approx(3.0 * (1.0 - np.exp(-2.0 * simulation.time)), rel=1e-5)
    with pytest.raises(ValueError, match="wind: expected finite numbers"):
        simulation.tune(wind=(np.inf, 0.0, 0.0))
