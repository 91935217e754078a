"""When numbers go bad: what grew is named, a spring, a contact or another force."""

import numpy as np
import pytest

from taichi_jello import Box, CallableField, Contact, Diverged, Room, Scene, Simulation

pytestmark = pytest.mark.filterwarnings("ignore:dt = ")


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def failure(simulation):
    with pytest.raises(Diverged) as caught:
        for _ in range(2000):
            simulation.frame()
    good = simulation.snapshot()
    found = caught.value.culprit
    now = simulation.snapshot()
    assert np.array_equal(now.x, good.x) and np.array_equal(now.v, good.v) and now.clock == good.clock
    assert found.words in str(caught.value)
    return found


def test_a_step_too_long_names_a_spring():
    """One spring of two is a hundred times as stiff: it is what a step of 2.5/√(k/m) is too long for."""
    soft = Box(points=(2, 1, 1), mass=0.02, stiffness=10.0, position=(3.0, 0.0, 0.0))
    stiff = Box(points=(2, 1, 1), mass=0.02, stiffness=1000.0, velocity=(0.0, 0.0, 1e-3), spin=(0.0, 1.0, 0.0))
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[soft, stiff], contact=Contact(touch=False))
    simulation = Simulation(scene, method="symplectic-euler", dt=1.0 / 60.0)
    found = failure(simulation)
    assert found.what == "spring" and found.particles == (2, 3) and found.jello == 1
    assert found.newtons > 1e6 and "k = 1e+03 N/m" in found.words


def test_a_contact_too_stiff_is_named():
    box = Box(points=(2, 1, 1), mass=0.02, stiffness=10.0, position=(0.0, 0.2, 0.0), velocity=(0.0, -1.0, 0.0))
    room = Room(min=(-1.0, 0.0, -1.0), max=(1.0, 0.5, 1.0))
    scene = Scene(jello=[box], collider=[room], contact=Contact(stiffness=1e6, damping=0.0, friction=0.0))
    found = failure(Simulation(scene, method="symplectic-euler", dt=2e-3))
    assert found.what == "contact" and "contact on particle" in found.words and found.newtons > 100.0


@pytest.mark.parametrize("others", [[], [Box(points=(2, 2, 2), position=(5.0, 0.0, 0.0))]])
def test_a_force_that_is_no_number_is_named(others):
    """Also where jellos can touch."""

    def broken(x, v, t):
        return x / (x[0] - x[0])

    scene = Scene(jello=[Box(points=(2, 2, 2)), *others], force=[CallableField(function=broken)])
    found = failure(Simulation(scene, method="symplectic-euler", dt=1e-3))
    assert found.what == "force" and "the callable field on particle 0 of jello 0 is no number" in found.words
