"""Fitted orders of every scheme that there is, against SciPy's DOP853."""

import numpy as np
import pytest
from reference import solve, twisted

from taichi_jello import Box, Scene, Simulation, Snapshot
from taichi_jello.physics.integrators import schemes

STILL = (0.0, 0.0, 0.0)
TOLERANCE = {1: 0.1, 2: 0.15, 4: 0.25}
SECONDS = 0.04


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


@pytest.fixture(scope="module", params=[0.0, 0.05], ids=["undamped", "damped"])
def smooth(request):
    """A small cube, twisted and stretched, with its reference state after SECONDS."""
    body = cube(request.param).jello[0].body()
    x, v = twisted(body.x), np.zeros_like(body.v)
    return request.param, x, v, solve(body, x, v, SECONDS)[0]


def cube(damping):
    return Scene(gravity=STILL, jello=[Box(points=(4, 4, 4), mass=0.125, damping=damping)])


def made(name, damping):
    """What solves takes long to compile: its dashpots, where it should have none, are tuned to nothing."""
    tuned = schemes()[name].solves and not damping
    simulation = Simulation(cube(0.05 if tuned else damping), method=name, substeps=100_000)
    if tuned:
        simulation.tune(damping=0.0)
    return simulation


@pytest.mark.filterwarnings("ignore:dt = ")  # undamped Euler has no safe step, but an order
@pytest.mark.parametrize("name", sorted(name for name, scheme in schemes().items() if scheme.fixed_step))
def test_error_falls_with_the_order_of_the_scheme(name, smooth, anew):
    damping, x, v, exact = smooth
    order = schemes()[name].order
    coarsest = 4e-4 / (5 - order) ** 2 * (2 if schemes()[name].solves and order == 2 else 1)
    errors, steps = [], []
    anew()
    simulation = made(name, damping)
    for halvings in range(4):
        count = round(SECONDS / coarsest) * 2**halvings
        simulation.restore(Snapshot(0.0, x, v))
        simulation.clock.frame_dt = SECONDS / count * simulation.substeps  # an exact divisor of the time compared at
        simulation.step(count)
        errors.append(np.sqrt(np.mean((simulation.x - exact) ** 2)))
        steps.append(simulation.dt)
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=TOLERANCE[order]), errors


def test_rk4_agrees_with_dop853_on_the_whole_cube():
    scene = Scene(gravity=STILL, jello=[Box()])
    simulation = Simulation(scene, method="rk4", dt=1e-4)
    body = simulation.body
    x, v = twisted(body.x), np.zeros_like(body.v)
    simulation.restore(Snapshot(0.0, x, v))
    seconds = 6 * simulation.frame_dt
    simulation.advance(seconds)
    exact, _ = solve(body, x, v, seconds)
    # (ω dt)⁴ = (57·√512·1e-4)⁴ of the amplitude would be 3e-4 for the fastest mode; damping leaves the slow ones.
    assert np.abs(simulation.x - exact).max() <= 1e-8
