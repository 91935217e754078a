"""Ropes that go through solids come apart from them; ropes that are wound round them stay."""

from dataclasses import replace

import numpy as np
import pytest
from touching_pairs import overlap_by_half, tangles

from taichi_jello import Box, Pin, Plane, Ring, Rope, Scene, Sheet, Simulation, runtime
from taichi_jello.assembly import assembled
from taichi_jello.physics.threads import AGAINST, Threads, at, crossings, distances, outward, passes, prolonged
from taichi_jello.physics.touching import Touching
from taichi_jello.studies._pairs import Pair, go_on, overlapped

CUBE = Box(points=(2, 2, 2), size=(1.0, 1.0, 1.0))


@pytest.fixture(scope="module", autouse=True)
def taichi(request):
    runtime.start(request.config.getoption("--arch"), "f32")


@pytest.fixture(scope="module")
def slab():
    return Pair("rope", "slab").simulation("rk4")


@pytest.fixture(scope="module")
def rabbit():
    return Pair("rope", "rabbit").simulation("rk4")


@pytest.mark.parametrize(("other", "poses"), [("slab", (5, 12, 16, 22)), ("rabbit", (3,))])
def test_a_rope_that_goes_through_comes_apart(other, poses, request):
    """By the nearest faces alone all of these stayed in each other, and did not come free when pulled."""
    for told in overlapped(request.getfixturevalue(other), poses):
        assert not told["pulled"] and told["gained"] < 2.0, told


def test_a_rope_round_a_bar_is_left_alone():
    """Its axis goes in by one side of the bar and out by the other, near the upper face."""
    rope = Rope(points=24, length=2.0, mass=3.0, damping=0.1, stiffness=3000.0, position=(0.0, 0.4, 0.0))
    bar = Box(points=(3, 3, 10), size=(0.2, 0.2, 1.0), position=(0.0, 0.2, 0.0), pin=[Pin()])
    simulation = Simulation(Scene(jello=[rope, bar]), method="rk4")
    found, across = tangles(simulation), 0
    points = found.near.touching.points
    for _ in range(120):
        simulation.frame()
        assert not found.tangled
        x = simulation.x.astype(float)
        _, enters, normal = crossings(x[found.threads.ropes[0]], x[points[found.threads.solids[1]]])
        across += np.any((normal[:-1] * normal[1:]).sum(1)[enters[:-1] & ~enters[1:]] < AGAINST)
    assert across > 0
    low, high = np.sort(simulation.x[:24, 1])[[0, -1]]
    assert low < 0.0 and 0.3 <= high < 0.45  # it hangs over the upper face, at 0.3


def test_a_rope_that_comes_to_lie_on_a_ring_feeds_no_energy():
    """Where its points came between two of the ring's they were pressed deeper and out again: 0.36 J at 0.7 s, 14 J
    at 3 s, of 1.4 J that there are."""
    ring = Ring(radius=0.3, thickness=0.15, points=(20, 3), rotation=(90.0, 0.0, 0.0), position=(0.0, 0.076, 0.0))
    ring = replace(ring, mass=0.5, stiffness=150.0, damping=0.1)
    rope = Rope(points=25, length=1.6, position=(0.0, 0.35, 0.02), rotation=(0.0, 30.0, 0.0), mass=0.3, stiffness=200.0)
    scene = Scene(jello=[ring, replace(rope, damping=0.1)], collider=[Plane()])
    simulation = Simulation(scene, method="rk4", ledger=True)
    energy = sum(simulation.energies().values())
    simulation.advance(0.7)
    assert simulation.energies()["contact"] > 0.0 and simulation.energy_residual < 0.01 * energy


def test_a_rope_that_falls_on_a_ring_feeds_no_energy():
    """The ring's points pushed its segments as well, as long as that was not farther in: 1.7 J in the first second, of
    3.8 J that there are. What there is now is from the ring, which begins off the ground."""
    ring = Ring(radius=0.5, thickness=0.2, points=(24, 3), rotation=(90.0, 0.0, 0.0), position=(0.0, 0.15, 0.0))
    rope = Rope(points=24, length=2.0, position=(0.3, 0.8, 0.1), rotation=(0.0, 20.0, 0.0), mass=0.3)
    jello = [replace(one, stiffness=300.0, damping=0.2) for one in (ring, rope)]
    simulation, fed = Simulation(Scene(jello=jello, collider=[Plane()]), method="rk4", ledger=True), 0.0
    energy = sum(simulation.energies().values())
    for _ in range(60):
        simulation.frame()
        fed = max(fed, simulation.energy_residual)
    assert fed < 0.01 * energy
    lies = simulation.x[simulation.body.jello == 1]
    assert np.any((np.abs(np.hypot(lies[:, 0], lies[:, 2]) - 0.5) < 0.1) & (lies[:, 1] > 0.19))


def test_what_holds_one_jello_is_firm_towards_others():
    """A rope is through one cube and lies beside another one: only in the first it is soft."""
    rope = Rope(points=12, length=1.5, rotation=(0.0, 0.0, 90.0))
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[rope, CUBE, Box(points=(2, 2, 2), position=(1.1, 0.0, 0.0))])
    simulation = Simulation(scene, method="euler")
    simulation.frame()
    found = tangles(simulation)
    cut, beside, way = found.now
    whose = simulation.body.jello[found.near.touching.points]
    assert (beside[whose == 0] == 2).all() and (beside[whose == 1] == 1).all()
    assert (beside[whose == 2] == 0).all() and (cut[whose == 2] < 0.0).all()
    assert way[whose == 0] == pytest.approx(-way[whose == 1][:1].repeat(12, 0))


def test_a_run_goes_on_to_the_same_bits_while_a_rope_is_led_out(slab):
    simulation = slab
    overlap_by_half(simulation, 22)
    go_on(simulation, 0.05)
    middle = simulation.snapshot()
    assert tangles(simulation).tangled and "tangle_way" in middle.memory
    simulation.advance(0.2)
    whole = simulation.snapshot()
    simulation.reset()
    simulation.frame()
    simulation.restore(middle)
    simulation.advance(0.2)
    assert np.array_equal(simulation.x, whole.x) and np.array_equal(simulation.v, whole.v)


def test_a_rope_passes_if_it_is_deep_between_two_sides():
    body = assembled(Scene(jello=[CUBE, Rope(points=4, length=3.0, position=(0.0, 5.0, 0.0))]))
    touching = Touching.of(body, np.zeros(2, bool))
    corners = body.x[touching.points[outward(touching, body.rest)]]

    def rope(*places):
        ends = prolonged(np.stack([places[:-1], places[1:]], 1).astype(float))
        return passes(ends, corners, 1.0, *crossings(ends, corners))

    assert len(corners) == 12
    assert rope((-1, 0.1, 0.0), (1, 0.1, 0.0)) and rope((-1, 0.1, 0.0), (-0.2, 0.1, 0.0), (0.3, 0, 0), (1, 0.1, 0.0))
    assert not rope((-1, 0.45, 0.0), (1, 0.45, 0.0))  # near its face
    assert not rope((-1, 0.1, 0.0), (-0.4, 0.1, 0.0), (0, 0.1, 0.0))  # ends within, far from where it would leave
    assert rope((-1, 0.1, 0.0), (-0.2, 0.1, 0.0), (0.4, 0.1, 0.0))  # just before it would leave
    assert not rope((-1, 0.1, 0.0), (0, 0.1, 0.0), (0, 1, 0.1))  # in by one side, out by one beside it
    assert not rope((-1, 0.6, 0.0), (1, 0.6, 0.0))


def test_triangles_are_seen_from_outside():
    body = assembled(Scene(jello=[Ring(), Rope()]))
    touching = Touching.of(body, np.zeros(2, bool))
    corners = body.rest[touching.points[outward(touching, body.rest)]]
    # Gauss: the volume within, that of the bar's cells with their flat sides.
    volume = np.einsum("td,td->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    n, radius, thickness = 24, 0.5, 0.25
    assert volume == pytest.approx(n * np.sin(2.0 * np.pi / n) * radius * thickness**2, rel=1e-9)


def test_distances_to_a_triangle():
    triangle = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    places = np.array([(0.2, 0.2, 0.3), (0.5, -0.4, 0.3), (-0.3, -0.4, 0.0), (1.0, 1.0, 0.0)])  # over it, edges, corner
    for corners in (triangle, triangle[:, ::-1]):
        assert distances(places, corners) == pytest.approx([0.3, 0.5, 0.5, 0.5**0.5])
    ends = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0], [1.0, 2.0, 0.0]]])
    assert at(ends, np.array([0.5, 1.25, 2.0])).tolist() == [[0.5, 0.0, 0.0], [1.0, 0.5, 0.0], [1.0, 2.0, 0.0]]


def test_only_ropes_beside_solids_are_looked_for():
    def made(*jello):
        return Simulation(Scene(jello=list(jello)), method="rk4")

    far = Rope(points=4, length=1.0, position=(0.0, 3.0, 0.0))
    found = tangles(made(far, CUBE))
    assert isinstance(found.threads, Threads) and not found.has_sheets and not found.has_slender
    assert found.threads.close(found.body.x, True) == []
    single = made(Box(points=(1, 1, 1)), CUBE)  # a single point has no segments
    single.frame()
    assert tangles(single) is None
    assert tangles(made(Rope(), Sheet(points=(3, 3)))).threads is None and tangles(made(Rope(), far)) is None
