"""What is told of loads, which lie on top, fall or are pressed; and, while it runs, of what passes far into a jello."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from taichi_jello import (
    Block,
    Box,
    Contact,
    Pin,
    Plane,
    Scene,
    SceneWarning,
    Simulation,
    Snapshot,
    Sphere,
)
from taichi_jello.physics.forces.contact_law import standing_points
from taichi_jello.run.assembly import assembled
from taichi_jello.run.checks import start_warnings
from taichi_jello.run.checks.loads import Piles, presses
from taichi_jello.run.checks.watch import in_cells, turned_over
from taichi_jello.scene.keyframes import Move

SMALL = Box(points=(5, 5, 5), size=(0.4, 0.4, 0.4), stiffness=2000.0, position=(0.0, 0.2, 0.0))
HEAVY = replace(SMALL, mass=100.0, stiffness=2e5, position=(0.0, 0.62, 0.0))


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def words_of(function, *arguments):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", SceneWarning)
        function(*arguments)
    return [str(warning.message) for warning in found if issubclass(warning.category, SceneWarning)]


def told(scene):
    return words_of(start_warnings.on_contact, scene, assembled(scene))


def test_a_pile_carries_its_weight_down():
    jellos = [replace(SMALL, mass=m, position=(0.0, 0.2 + 0.45 * k, 0.0)) for k, m in enumerate((1.0, 2.0, 4.0))]
    beside, held = (
        replace(SMALL, position=(1.0, 0.3, 0.0)),
        replace(SMALL, position=(0.0, 9.0, 0.0), pin=[Pin()]),
    )
    scene = Scene(jello=[*jellos, beside, held], collider=[Plane()])
    piles = Piles.of(scene, assembled(scene))
    assert piles.lies_on.tolist() == [-1, 0, 1, -1, 2]
    assert piles.carried == pytest.approx([6.0, 4.0, 0.0, 0.0, 0.0])  # what is pinned carries itself
    assert piles.fall[:4] == pytest.approx([0.0, 0.05, 0.05, 0.1], abs=1e-3)


def test_a_heavy_jello_on_a_light_one_is_told_with_the_stiffness_that_carries_it():
    """The pair's springs are those of the softer one: m g / (k n) at both its sides."""
    scene = Scene(jello=[SMALL, HEAVY], collider=[Plane()], contact=Contact(stiffness=1000.0))
    below, pair = told(scene)
    points = standing_points(assembled(scene))[0]
    depth = 100.0 * 9.81 / (1000.0 * points)
    assert below.startswith("jello.0: 101 kg, 100 kg of them on top of it, on contact springs of 1000 N/m")
    assert pair.startswith("jello.1 on jello.0: 100 kg on contact springs of 1000 N/m of both")
    assert f"sinks in by about {depth:.2g} m; contact.stiffness = 2e+04 would carry it" in pair
    assert not told(replace(scene, contact=Contact(stiffness=2e4))) and not told(replace(scene, contact=Contact()))


def test_a_fall_too_deep_is_told():
    """½ K d² = m g h, the springs of contact and of the jello one after the other."""
    high = replace(SMALL, mass=1.0, position=(0.0, 30.2, 0.0))
    (words,) = told(Scene(jello=[high], collider=[Plane()], contact=Contact(stiffness=50.0)))
    assert words.startswith("jello.0 falls 30 m and sinks by about ")
    assert not told(Scene(jello=[replace(high, position=(0.0, 0.5, 0.0))], collider=[Plane()]))


def closing(to):
    keys = [Move(time=0.0, offset=(0.0, 0.0, 0.0)), Move(time=0.4, offset=(0.0, -to, 0.0))]
    return [
        Plane(point=(0.0, -0.25, 0.0)),
        Plane(point=(0.0, 0.25, 0.0), normal=(0.0, -1.0, 0.0), keyframe=keys),
    ]


def test_what_colliders_close_on_is_told():
    cube = Box(points=(6, 6, 6), size=(0.5, 0.5, 0.5), stiffness=20000.0, position=(0.0, 0.0, 0.0))
    scene = Scene(gravity=(0.0, 0.0, 0.0), seconds=1.0, jello=[cube], collider=closing(0.4))
    (press,) = presses(scene, assembled(scene))
    assert (press.jello, press.colliders, press.size) == (0, (0, 1), pytest.approx(0.5))
    assert press.gap == pytest.approx(0.1, abs=1e-3)
    (words,) = told(scene)
    assert words.startswith("jello.0: collider.0 and collider.1 close to 0.1 m around its 0.5 m and go into it by")
    assert not told(replace(scene, collider=closing(0.02))) and not presses(
        replace(scene, collider=closing(-0.2)), assembled(scene)
    )
    assert not told(replace(scene, seconds=0.0))


def test_a_collider_too_small_for_the_points_is_told():
    scene = Scene(jello=[SMALL], collider=[Plane(), Sphere(radius=0.01, center=(0.0, -1.0, 0.0))])
    (words,) = words_of(start_warnings.on_thin_colliders, scene, assembled(scene))
    assert words.startswith("collider.1, a sphere 0.02 m thick, may pass between the points of jello.0: make it ")
    least = float(words.split("make it ")[1].split(" m")[0])
    larger = replace(scene, collider=[Sphere(radius=0.5 * 1.05 * least)])
    assert not words_of(start_warnings.on_thin_colliders, larger, assembled(larger))


@pytest.fixture(scope="module")
def cube():
    """A cube without `volume` between a floor and a needle that it does not touch."""
    jello = Box(points=(4, 4, 4), position=(0.0, 2.0, 0.0), damping=2.0)
    needle = Block(size=(0.2, 1.0, 0.2), center=(9.0, 2.0, 0.0))
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[jello], collider=[Plane(), needle])
    return Simulation(scene, method="symplectic-euler")


def test_cells_left_inside_out_are_told_once(cube):
    """Mirrored, its springs hold it as well as before."""
    cube.reset()
    x = cube.body.x * [-1.0, 1.0, 1.0]
    assert turned_over(x, cube.body.cells).all() and not turned_over(cube.body.x, cube.body.cells).any()
    cube.restore(Snapshot(0.0, x, np.zeros_like(x)))
    found = words_of(cube.advance, 0.5)
    assert not found
    found = words_of(cube.advance, 0.5)
    assert found == ["jello.0 has been left with 27 cells inside out for 0.5 s; volume = 1 brings them back"]
    assert not words_of(cube.advance, 1.0)
    guarded = Scene(gravity=(0.0, 0.0, 0.0), jello=[replace(SMALL, volume=1.0)])
    assert not len(Simulation(guarded).watch.cells)


def test_what_passes_more_than_halfway_is_told_once(cube):
    watch, x = cube.watch, cube.body.x
    for height, expected in ((1.0, False), (0.15, False), (-0.1, True)):
        found = words_of(watch.look, 1.0, x - [0.0, 2.0 - height, 0.0], None)
        assert [words.startswith("at 1 s collider.0, a plane, is more than halfway in jello.0") for words in found] == [
            True
        ] * expected
    for across, expected in ((8.55, False), (9.0, True), (9.0, False)):
        found = words_of(watch.look, 1.0, x + [across, 0.0, 0.0], None)
        assert ["collider.1, a block, is more than halfway in jello.0" in words for words in found] == [True] * expected


def test_a_jello_whose_middle_is_in_another_is_told():
    scene = Scene(jello=[SMALL, replace(SMALL, position=(0.0, 1.0, 0.0))], contact=Contact(stiffness=1.0))
    simulation = Simulation(replace(scene, gravity=(0.0, 0.0, 0.0)))
    x = simulation.body.x.copy()
    assert not words_of(simulation.watch.look, 1.0, x, None)
    x[125:, 1] -= 0.65  # its middle is 0.05 m below the upper side of the other
    (words,) = words_of(simulation.watch.look, 1.0, x, None)
    assert words.startswith("at 1 s jello.1 is more than halfway in jello.0")


def test_points_in_cells():
    body = SMALL.body()
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.4, 0.4, (200, 3))
    assert np.array_equal(in_cells(points, body.rest, body.cells), (np.abs(points) < 0.2).all(1))
    assert not in_cells(np.zeros((0, 3)), body.rest, body.cells).size
    assert not in_cells(points, np.zeros_like(body.rest), body.cells).any()
