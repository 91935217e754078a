"""The method `auto`: explicit for the workshop's cube, implicit for one that an explicit method could hardly follow."""

import pytest

from taichi_jello import Box, Scene, Simulation, Solver
from taichi_jello.explain import facts, text


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def cube(stiffness, **solver):
    return Scene(jello=[Box(points=(3, 3, 3), stiffness=stiffness)], solver=Solver(**solver))


def test_auto_is_the_default_and_says_why():
    soft, stiff = Simulation(cube(200.0)), Simulation(cube(1e7))
    assert soft.method == "rk4" and stiff.method == "backward-euler" and stiff.substeps == 1
    evaluations = 4 * soft.substeps
    assert f"a frame takes rk4 {evaluations} evaluations" in text(facts(soft))
    assert "method: backward-euler: a frame takes rk4" in text(facts(stiff))


@pytest.mark.filterwarnings("ignore:dt = ")
def test_who_gives_the_step_or_the_method_gets_it():
    assert Simulation(cube(1e7), dt=1e-3).method == "rk4"
    assert Simulation(cube(1e7), substeps=7).method == "rk4"
    assert Simulation(cube(1e7), method="verlet").method == "verlet"
    assert Simulation(cube(1e7, method="rk2")).choice is None
