"""Static friction: what Coulomb's law holds stays where it is, what it does not slides with g (sin α - μ cos α)."""

from math import atan, cos, sin

import numpy as np
import pytest

from taichi_jello import Block, Box, Contact, Mesh, Pin, Plane, Scene, Simulation, Snapshot
from taichi_jello.scene.keyframes import Move

G = 9.81


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def on_a_slope(slope, friction, method=None, points=5, jello=None, **options):
    """A box on a plane that is level while gravity leans: tan α = slope, downhill along +x."""
    angle = atan(slope)
    box = jello or Box(points=(points,) * 3, size=(0.5, 0.5, 0.5), position=(0.0, 0.25, 0.0), damping=1.0)
    scene = Scene(
        gravity=(G * sin(angle), -G * cos(angle), 0.0),
        jello=[box],
        collider=[Plane()],
        contact=Contact(friction=friction),
    )
    return Simulation(scene, method=method, **options)


def middle(simulation):
    return np.average(simulation.x.astype(float), axis=0, weights=simulation.body.mass)


METHODS = ["rk4", "symplectic-euler", "verlet", "xpbd", "backward-euler", "adaptive"]


@pytest.mark.parametrize("method", METHODS)
def test_a_box_rests_where_friction_holds_it_and_slides_where_not(method):
    slope, slippery = 0.495, 0.3
    simulation = on_a_slope(slope, 0.5, method)
    simulation.advance(2.0)
    before = middle(simulation)
    simulation.advance(2.0)
    assert np.linalg.norm(middle(simulation) - before) / 2.0 < 1e-4
    simulation.tune(friction=slippery)
    mass = simulation.body.mass[:, None]

    def speed():
        return float((mass * simulation.v.astype(float)).sum(0)[0] / mass.sum())

    simulation.advance(1.0)
    before = speed()
    simulation.advance(1.0)
    expected = G * (sin(atan(slope)) - slippery * cos(atan(slope)))
    assert speed() - before == pytest.approx(expected, rel=0.01)


CUBE = """v -0.25 -0.25 -0.25
v 0.25 -0.25 -0.25
v 0.25 0.25 -0.25
v -0.25 0.25 -0.25
v -0.25 -0.25 0.25
v 0.25 -0.25 0.25
v 0.25 0.25 0.25
v -0.25 0.25 0.25
f 4 3 2 1
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""


def test_an_embedded_skin_rests_too(tmp_path):
    (tmp_path / "cube.obj").write_text(CUBE)
    mesh = Mesh(
        file=str(tmp_path / "cube.obj"), resolution=5, size=0.5, position=(0.0, 0.25, 0.0), stiffness=800.0, damping=1.0
    )
    simulation = on_a_slope(0.3, 0.5, jello=mesh)
    assert len(simulation.body.skin_corners) > 0
    simulation.advance(3.0)
    before = middle(simulation)
    simulation.advance(3.0)
    assert np.linalg.norm(middle(simulation) - before) / 3.0 < 1e-4


def test_a_snapshot_of_what_friction_holds_goes_on_to_the_same_bits():
    simulation = on_a_slope(0.45, 0.5)
    simulation.advance(1.0)
    now = simulation.snapshot()
    simulation.advance(0.5)
    expected = simulation.x.copy()
    simulation.advance(0.2)
    simulation.restore(now)
    simulation.advance(0.5)
    assert np.array_equal(simulation.x, expected)


def test_a_moving_surface_carries_what_stands_on_it():
    keyframes = [Move(time=t, offset=(0.25 * t * t, 0.0, 0.0)) for t in np.linspace(0.0, 2.0, 41)]
    block = Block(center=(0.0, -0.5, 0.0), size=(8.0, 1.0, 8.0), keyframe=keyframes)
    box = Box(points=(4, 4, 4), size=(0.5, 0.5, 0.5), position=(0.0, 0.25, 0.0), damping=1.0)
    simulation = Simulation(Scene(jello=[box], collider=[block], contact=Contact(friction=0.5)))
    simulation.advance(2.0)
    assert middle(simulation)[0] == pytest.approx(1.0, abs=0.05)


def test_the_ledger_books_what_friction_takes():
    simulation = on_a_slope(0.5, 0.3, "rk4", ledger=True)
    before = sum(simulation.energies().values())
    simulation.advance(1.0)
    assert simulation.work["friction"] < -0.1
    assert abs(simulation.energy_residual) < 1e-3 * abs(before + simulation.work["friction"])


def test_without_friction_there_are_no_anchors():
    simulation = on_a_slope(0.1, 0.0)
    names = {name for owner, name, _ in simulation.system.memory.fields if owner == "contact"}
    assert "anchors" not in names
    assert "anchors" in {name for owner, name, _ in on_a_slope(0.1, 0.5).system.memory.fields if owner == "contact"}


def on_a_pinned_slab(slope, friction, method="rk4"):
    """A box on a slab that is held still, under gravity that leans: tan α = slope, downhill along +x."""
    angle = atan(slope)
    slab = Box(points=(13, 3, 5), size=(1.8, 0.3, 0.6), position=(0.0, -0.15, 0.0), pin=[Pin()])
    box = Box(points=(4, 4, 4), size=(0.3, 0.3, 0.3), position=(-0.5, 0.151, 0.0), damping=1.0)
    gravity = (G * sin(angle), -G * cos(angle), 0.0)
    return Simulation(Scene(gravity=gravity, jello=[slab, box], contact=Contact(friction=friction)), method=method)


def of_the_box(simulation, values):
    return values.astype(float)[simulation.body.jello == 1].mean(0)


@pytest.mark.parametrize("method", ["rk4", "xpbd", "adaptive"])
def test_a_box_rests_on_another_jello(method):
    simulation = on_a_pinned_slab(0.45, 0.5, method)
    simulation.advance(2.0)
    before = of_the_box(simulation, simulation.x)
    simulation.advance(2.0)
    assert np.linalg.norm(of_the_box(simulation, simulation.x) - before) / 2.0 < 2e-4


def test_a_box_slides_down_another_jello():
    simulation = on_a_pinned_slab(0.4, 0.2)
    simulation.advance(0.3)
    before = of_the_box(simulation, simulation.v)[0]
    simulation.advance(0.4)
    expected = G * (sin(atan(0.4)) - 0.2 * cos(atan(0.4)))
    # It comes from point to point and triangle to triangle of the slab: a few per cent of a bump.
    assert (of_the_box(simulation, simulation.v)[0] - before) / 0.4 == pytest.approx(expected, rel=0.05)


def test_a_stack_of_five_stands():
    boxes = [
        Box(points=(5, 5, 5), size=(0.4, 0.4, 0.4), position=(0.0, 0.2 + 0.41 * n, 0.0), stiffness=1000.0)
        for n in range(5)
    ]
    simulation = Simulation(Scene(jello=boxes, collider=[Plane()]))

    def top():
        return simulation.x.astype(float)[simulation.body.jello == 4].mean(0)

    simulation.advance(8.0)
    before = top()
    simulation.advance(3.0)
    assert before[1] > 1.75
    assert np.linalg.norm(before[[0, 2]]) < 0.04
    assert np.linalg.norm(top() - before) < 2e-3


def test_a_snapshot_of_jellos_that_stick_goes_on_to_the_same_bits():
    simulation = on_a_pinned_slab(0.3, 0.5)
    simulation.advance(0.5)
    now = simulation.snapshot()
    simulation.advance(0.3)
    expected = simulation.x.copy()
    simulation.restore(now)
    simulation.advance(0.3)
    assert np.array_equal(simulation.x, expected)


def test_a_spinning_pair_that_sticks_keeps_its_spin():
    """No torque acts: friction between the two must not brake a pair that turns as one."""
    boxes = [
        Box(points=(4, 4, 4), size=(0.3, 0.3, 0.3), position=(0.0, y, 0.0), velocity=(0.0, -np.sign(y) * 0.2, 0.0))
        for y in (-0.151, 0.151)
    ]
    simulation = Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=boxes, contact=Contact(friction=1.0)), method="rk4")
    x, mass = simulation.body.x, simulation.body.mass[:, None]
    simulation.restore(Snapshot(0.0, x, simulation.v + np.cross((0.0, 3.0, 1.0), x)))

    def spin():
        return (mass * np.cross(simulation.x.astype(float), simulation.v.astype(float))).sum(0)

    before = spin()
    simulation.advance(2.0)
    assert np.linalg.norm(spin() - before) < 1e-3 * np.linalg.norm(before)
