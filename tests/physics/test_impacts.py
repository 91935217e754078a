"""Fast impacts: nothing gets to the wrong side of the ground, a thin slab or a small ball, and nothing gains energy."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_jello import Block, Box, Grab, Plane, Scene, Simulation, Sphere
from taichi_jello.support import runtime

SLAB = Block(center=(0.0, -0.025, 0.0), size=(4.0, 0.05, 4.0))
BALL = Sphere(center=(0.0, -0.05, 0.0), radius=0.05)


@pytest.fixture(scope="module", autouse=True)
def single_precision(request):
    runtime.start(request.config.getoption("--arch"), "f32")


def dropped(collider, *, fall, points=(3, 3, 3), **options):
    """A cube half a metre over the origin, to be thrown down at each speed [m/s] in turn."""
    box = Box(points=points, size=(0.5, 0.5, 0.5), mass=0.1, position=(0.001, 0.8, 0.0), **fall)
    return Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=[box], collider=[collider]), **options)


def thrown(simulation, speed, frames=20):
    """Frame by frame: the lowest point [m], and all the energy [J]."""
    simulation.reset()
    simulation.push((0.0, -speed, 0.0))
    low, energy = [], [sum(simulation.energies().values())]
    for _ in range(frames):
        simulation.frame()
        low.append(float(simulation.x[:, 1].min()))
        energy.append(sum(simulation.energies().values()))
    return min(low), np.array(energy)


STEPS = {"xpbd": "auto", "symplectic-euler": "auto", "verlet": "auto", "rk4": "auto", "backward-euler": 1 / 60}
SOFT = {"stiffness": 1000.0}


@pytest.mark.parametrize("method", STEPS)
def test_nothing_passes_a_slab(method):
    """Its core begins a quarter of its 5 cm below its face and is never entered. An impact takes energy away; what is
    moved back into the shell gains less contact energy than that."""
    simulation = dropped(SLAB, fall=SOFT, method=method, dt=STEPS[method])
    for speed in (100.0, 1000.0):
        low, energy = thrown(simulation, speed)
        assert low > -0.0126
        assert energy.max() < energy[0] * (1.0 + 1e-4) and energy[-1] < 0.6 * energy[0]
    if method == "backward-euler":  # a stiff cube half over the edge: its springs are not stretched around it
        simulation.tune(stiffness=1000.0)
        simulation.reset()
        beside = replace(simulation.snapshot(), x=simulation.x + [2.05, -0.5, 0.0])
        simulation.restore(beside)
        simulation.push((0.0, -20.0, 0.0))
        before = sum(simulation.energies().values())
        for _ in range(10):
            simulation.frame()
            assert sum(simulation.energies().values()) < 1.2 * before


def test_nothing_gets_below_the_ground():
    """A half-space can only be pressed in: by v √(m/k) if one point has to stop the mass m of all."""
    simulation = dropped(Plane(), fall=SOFT, method="rk4")
    for speed in (100.0, 1000.0):
        low, energy = thrown(simulation, speed)
        assert low > -speed * np.sqrt(0.1 / simulation.tuning["contact_stiffness"])
        assert simulation.x[:, 1].min() > -0.01 and energy.max() < energy[0] * (1.0 + 1e-4)


@pytest.mark.parametrize("method", ["rk4", "backward-euler"])
def test_a_point_does_not_pass_a_small_ball(method):
    """Nearly head on: it is stopped and then slides around the ball, at a small part of its speed."""
    simulation = dropped(BALL, fall={}, points=(1, 1, 1), method=method, dt=STEPS[method])
    for speed in (100.0, 1000.0):
        simulation.reset()
        simulation.push((0.0, -speed, 0.0))
        for _ in range(6):
            simulation.frame()
            away = np.linalg.norm(simulation.x[0] - np.array(BALL.center))
            assert away > 0.025 - 1e-6
        assert np.linalg.norm(simulation.v) < 0.5 * speed and simulation.v[0, 1] > -0.2 * speed


def test_what_meets_a_core_is_booked():
    """A point that is stopped in one step loses all its energy to the impact."""
    box = Box(points=(1, 1, 1), mass=2.0, position=(0.0, 0.4, 0.0), velocity=(0.0, -60.0, 0.0))
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[box], collider=[SLAB])
    simulation = Simulation(scene, method="symplectic-euler", substeps=2, ledger=True)
    simulation.step()
    assert simulation.work["impacts"] == pytest.approx(-3600.0) and abs(simulation.energy_residual) < 1e-3


def test_a_fast_ball_takes_a_point_along():
    """At 200 m/s it would pass the point, whose step is a whole frame long, by 17 of its diameters."""
    ball = Sphere(center=(0.0, -5.0, 0.0), radius=0.1, velocity=(0.0, 200.0, 0.0))
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[Box(points=(1, 1, 1), mass=2.0)], collider=[ball])
    simulation = Simulation(scene, method="rk4")
    for _ in range(3):
        simulation.frame()
    assert simulation.v[0, 1] >= 200.0 and simulation.x[0, 1] > ball.origin(simulation.time)[1] + 0.05


def test_the_way_into_a_core():
    """A block's core is met at the side that it is entered by, and only from outside."""
    import taichi as ti

    @ti.kernel
    def entry(ax: float, ay: float, bx: float, by: float) -> ti.types.vector(4, ti.f32):
        a, b = ti.Vector([ax, ay, 0.0]), ti.Vector([bx, by, 0.0])
        return ti.static(Block.core_entry)(a, b, ti.Vector([1.0, 0.5, 1.0, 0.25]))

    assert np.allclose(entry(0.0, 1.25, 0.0, -0.75), [0.0, 1.0, 0.0, 0.5])  # straight down: the top of half height 0.25
    assert np.allclose(entry(-1.75, 0.0, 0.25, 0.0), [-1.0, 0.0, 0.0, 0.5])
    assert entry(0.0, 1.25, 0.0, 0.3)[3] == 2.0  # stops short
    assert entry(0.0, 0.0, 0.0, 2.0)[3] == 2.0  # out of it
    assert entry(2.0, 1.0, -2.0, 1.0)[3] == 2.0  # beside it


def test_far_from_the_origin_it_is_as_near_it(anew):
    """10 km away f32 has steps of 1 mm; positions are kept relative to a point near by."""
    found = []
    for away in (np.zeros(3), np.array([10000.0, 2500.0, -5000.0])):
        anew()
        box = Box(points=(3, 3, 3), mass=0.1, position=tuple(away + [0.0, 0.6, 0.0]), rotation=(3.0, 4.0, 5.0))
        ball = Sphere(center=tuple(away + [0.3, -0.2, 0.0]), radius=0.4)
        scene = Scene(jello=[box], collider=[Plane(point=tuple(away)), ball], force=[Grab()])
        simulation = Simulation(scene, method="rk4")
        simulation.advance(0.2)
        simulation.grab([0], [1.0], tuple(away + [0.1, 1.0, 0.0]))
        simulation.advance(0.1)
        energies = simulation.energies()
        energies["gravity"] -= 9.81 * 0.1 * away[1]
        found.append((simulation.x - away, list(energies.values()), simulation.held.force))
        simulation.restore(simulation.snapshot())
        assert np.array_equal(simulation.x - away, found[-1][0])
    for near, far in zip(*found, strict=True):
        assert np.allclose(near, far, rtol=1e-4, atol=1e-5)
