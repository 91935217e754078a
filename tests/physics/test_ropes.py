"""Ropes touch between their points, and are stopped there."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import taichi as ti
from test_functions import call
from touching_pairs import placed, touch

from taichi_jello import Box, Contact, Rope, Scene, Sheet, Simulation, Snapshot
from taichi_jello.physics.forces.soft_contact.contacts import ROPE_PAIR_SHARE
from taichi_jello.physics.forces.soft_contact.search import neighbour_list
from taichi_jello.physics.forces.soft_contact.search.closest_point import closest
from taichi_jello.physics.forces.soft_contact.surface.shapes import THICKNESS
from taichi_jello.run.explain import facts
from taichi_jello.shapes.lattice import rotation
from taichi_jello.studies._contact.pairs import Pair, thrown
from taichi_jello.support import runtime

FREE = {"stiffness": 0.0, "damping": 0.0}


@pytest.fixture(scope="module", autouse=True)
def taichi(request):
    runtime.start(request.config.getoption("--arch"), "f32")


@pytest.fixture(scope="module")
def crossed():
    """Two ropes of segments of 1 m that are kept 1 m apart, without springs, dashpots or friction."""
    jello = [Rope(points=4, length=3.0, **FREE), Rope(points=4, length=3.0, **FREE)]
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=jello, contact=Contact(damping=0.0, friction=0.0))
    return Simulation(scene, method="rk4", substeps=1)


def across(height, turn=70.0, along=0.1):
    """(8, 3) the particles of both: the second is turned about the middle of the first one's middle segment, and
    crosses it at `along` [m] from there, at a height."""
    first = np.stack([np.arange(4) - 1.5, np.zeros(4), np.zeros(4)], 1)
    angle = np.radians(turn)
    second = (np.arange(4) - 1.5)[:, None] * [np.cos(angle), 0.0, np.sin(angle)] + [along, -height, 0.0]
    return np.concatenate([first, second])


def energy(simulation, x):
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    return simulation.energies()["contact"]


def test_the_nearest_places_of_two_segments():
    """Against the least of many places on both; for parallel ones only the distance is given."""
    draw, steps = np.random.default_rng(4), np.linspace(0.0, 1.0, 401)
    cases = draw.standard_normal((12, 4, 3)).astype(np.float32)
    cases[8:, 3] = cases[8:, 1] * [[2.0], [-0.5], [1.0], [0.0]]
    for p, along, a, edge in cases:

        @ti.func
        def places(p, along, a, edge):
            u, s = closest(p, along, 0.5, a, edge)
            return ti.Vector([u, s])

        u, s = call(places, p, along, a, edge, length=2)
        assert 0.0 <= u <= 0.5 and 0.0 <= s <= 1.0
        ways = (p + 0.5 * steps[:, None] * along)[:, None] - (a + steps[:, None] * edge)[None]
        # Nearer than the nearest of the places by at most the way between two of them.
        assert np.linalg.norm(p + u * along - a - s * edge) <= np.linalg.norm(ways, axis=2).min() + 1e-5


def least_distance(x, i, others):
    """From particle i with half of the segments beside it to a rope with points at `others`, of 801 and 1201 places."""
    own = [x[i] + np.linspace(0.0, 0.5, 401)[:, None] * (x[r] - x[i]) for r in (i - 1, i + 1) if 0 <= r < len(x)]
    places = [a + np.linspace(0.0, 1.0, 401)[:, None] * (b - a) for a, b in pairwise(others)]
    return np.linalg.norm(np.concatenate(own)[:, None] - np.concatenate(places)[None], axis=2).min()


def test_between_its_points_a_rope_is_kept_as_far_as_at_them(crossed):
    """Kept apart by points alone, half a segment from where they cross, they had a push that went to nothing."""
    apart, k, found = 2.0 * THICKNESS["rope"], crossed.tuning["contact_stiffness"], []
    for height in (0.9, 0.5, 0.2, 0.01):
        x = across(height)
        depth = [apart - least_distance(x[4 * j :][:4], i, x[4 * (1 - j) :][:4]) for j in (0, 1) for i in range(4)]
        found.append(energy(crossed, x))
        # Places 1/800 beside the nearest are by 1e-6 / 2 distance farther, at 0.01 by 1e-4.
        assert found[-1] == pytest.approx(ROPE_PAIR_SHARE * 0.5 * k * np.sum(np.maximum(depth, 0.0) ** 2), rel=5e-4)
    assert found[-1] > 3.0 * ROPE_PAIR_SHARE * 0.5 * k * (apart - 0.01) ** 2  # from the three halves that cross


def test_forces_between_points_are_opposite_and_lead_downhill(crossed, forces):
    """The force is the slope of the energy, by differences on all that feel one."""
    x = across(0.4)
    energy(crossed, x)
    f = forces(crossed)
    assert f[:4, 1].sum() > 0.0 and np.abs(f.sum(0)).max() < 1e-5 * np.abs(f).sum()
    assert np.abs(np.cross(x, f).sum(0)).max() < 1e-5 * np.abs(f).sum()
    pushed, step = np.linalg.norm(f, axis=1), 2e-3
    assert (pushed > 0.05 * pushed.max()).sum() >= 4
    for i in np.flatnonzero(pushed > 0.05 * pushed.max()):
        way = np.zeros_like(x)
        way[i] = step * f[i] / pushed[i]
        slope = (energy(crossed, x - way) - energy(crossed, x + way)) / (2.0 * step)
        assert slope == pytest.approx(pushed[i], rel=0.02)  # of f32 energies, 4 mm apart


def test_however_many_contacts_press_on_a_point_each_has_its_weight():
    """Sixty points of a rope lie across one triangle of a cube: its corners have all of these contacts."""
    rope = Rope(points=60, length=0.5, position=(-0.05, 0.49, 0.1), **FREE)
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[Box(points=(2, 2, 2)), rope])
    simulation = Simulation(scene, method="rk4", substeps=1, check_start=False)
    simulation.energies()
    contacts = touch(simulation).contacts
    count, own, weights = (f.to_numpy() for f in (contacts.count, contacts.pressing_count, contacts.weights))
    start, weight_in = contacts.pressing_start.to_numpy(), contacts.weight_in.to_numpy()
    assert count.sum() >= 50 and own.max() >= 50
    sums = [weight_in[a : a + n].sum() for a, n in zip(start, own, strict=True)]
    assert np.sum(sums) == pytest.approx(0.0, abs=1e-4)  # what a point has its triangle has the other way
    assert own.sum() == count.sum() + np.count_nonzero(weights[:: contacts.per_point])


@pytest.mark.parametrize("contact", [{}, {"touch": False}], ids=["with each other", "with themselves"])
def test_where_the_lists_have_no_room_nothing_is_left_out(contact, monkeypatch, forces):
    """Of two ropes and a box squeezed into a ball a point has up to 40 segments near, and 8 places with the least
    room."""
    ropes = [Rope(points=24, length=3.0, self_contact=bool(contact), **FREE)] * 2
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[*ropes, Box(points=(3, 3, 3))], contact=Contact(**contact))
    start, found = 0.3 * np.random.default_rng(1).standard_normal((75, 3)), []
    for room in (neighbour_list.SLOTS_PER_POINT, 4):
        monkeypatch.setattr(neighbour_list, "SLOTS_PER_POINT", room)
        simulation = Simulation(scene, method="rk4", substeps=1, check_start=False)
        found.append(forces(simulation, start))
    assert touch(simulation).near.state[neighbour_list.FULL]
    assert np.abs(found[0]).max() > 0.0 and np.array_equal(*found)


def test_what_is_near_between_points_is_listed(crossed):
    """Stretched to six times their length, segments are far from the points of those that they cross."""
    long = across(0.5) * [6.0, 1.0, 6.0]
    assert energy(crossed, long) > 0.0
    long[:4] += [0.0, 5.0, 0.0]
    assert energy(crossed, long) == 0.0


@pytest.mark.parametrize(
    ("pair", "poses"),
    [(Pair("ring", "rope"), (43, 54, 94)), (Pair("rope", "rope"), (1, 269)), (Pair("ring", "strip"), (32,))],
    ids=lambda case: getattr(case, "other", ""),
)
def test_what_is_caught_beside_its_middle_is_not_drawn_through(pair, poses):
    """The middles are level before anything is deep. Braked only while middles came nearer, these poses went through
    the ring's bar, or the first of the ropes through the other one."""
    simulation = pair.simulation("rk4")
    for told in thrown(simulation, pair.size, poses):
        assert not told["through"], told


def test_sides_are_kept_only_where_something_thin_meets_solids_or_ropes():
    def told(*jello):
        return facts(Simulation(Scene(jello=list(jello)), method="rk4"))["fields"]["touch"]

    rope, far = Rope(points=4, length=1.0), Rope(points=4, length=1.0, position=(0.0, 3.0, 0.0))
    box = Box(points=(2, 2, 2), position=(0.0, 9.0, 0.0))
    assert "sides of cores" in told(rope, box) and "sides of cores" in told(rope, far)
    assert "sides of cores" not in told(box, Box(points=(2, 2, 2), position=(0.0, 5.0, 0.0)))
    sheet = Sheet(points=(3, 3))
    assert "sides of cores" in told(box, sheet) and "sides of cores" not in told(rope, sheet)
    assert "ropes" not in told(box, sheet) and "ropes" in told(rope, sheet)


def test_the_same_bits_in_every_form_where_ropes_are_braked(request):
    """Members of a team add up the sides of a core in any order."""
    thrown_one = Rope(points=24, length=1.0, position=(0.05, 0.1, 0.5), velocity=(0.0, 0.0, -20.0))
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[thrown_one, Rope(points=24, length=1.0, rotation=(0.0, 0.0, 75.0))])
    found = []
    for threads, form in ((1, {}), (2, {"team": 2}), (2, {"team": 0})):
        runtime.start(request.config.getoption("--arch"), "f32", threads)
        simulation = Simulation(scene, method="verlet", ledger=True, **form)
        simulation.advance(0.1)
        found.append((*simulation.x.ravel(), *simulation.v.ravel(), simulation.work["impacts"]))
        # What the brake takes from one it gives to the other, to 1e-6 of 20 m/s.
        assert simulation.v.mean(0) == pytest.approx([0.0, 0.0, -10.0], abs=2e-5)
    assert found[0][-1] < -1.0 and found[1] == found[0] and found[2] == found[0]
    assert simulation.energies()["contact"] == 0.0 and not touch(simulation).brake.sides.to_numpy().any()


def test_sides_that_do_not_agree_brake_nothing():
    """A rope lies in a box, longer than it, and goes on lengthwise: the normals of 15 contacts all round cancel but for
    rounding, which said that it goes deeper."""
    rope = Rope(points=31, length=2.0, position=(0.37, 1.0, 0.0), velocity=(1.0, 0.0, 0.0))
    jello = [rope, Box(points=(5, 5, 5), size=(1.0, 1.0, 1.0), position=(0.0, 1.0, 0.0))]
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=jello, contact=Contact(friction=0.0, damping=0.0))
    simulation = Simulation(scene, method="rk4", substeps=400, ledger=True, check_start=False)
    simulation.step(20)  # later some are in no cell, by rounding: they lie where four meet
    assert touch(simulation).contacts.count.to_numpy()[:31].sum() >= 10
    simulation.step(20)
    assert simulation.work["impacts"] == 0.0


def test_ropes_far_away_change_nothing_between_solids():
    """The most that may press on a point is counted in whole contacts, whatever else there is in the scene."""
    boxes = [Box(points=(5, 5, 5)), Box(points=(5, 5, 5), position=(0.3, 0.6, 0.2), rotation=(0.0, 30.0, 25.0))]
    far = [Rope(points=4, length=1.0, position=(50.0, y, 0.0)) for y in (0.0, 9.0)]
    stored = []
    for jello in (boxes, [*boxes, *far]):
        simulation = Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=jello), method="rk4", substeps=50)
        stored.append(simulation.energies()["contact"])
    assert stored[0] > 100.0 and stored[1] == pytest.approx(stored[0], rel=1e-6)


ITSELF, TEARS = {"self_contact": True}, {"tear_strain": 0.2}
ROPE, ROUND = Rope(points=10, length=1.0), Rope(points=10, length=1.0, **ITSELF)


@pytest.mark.parametrize(
    "jello",
    [
        [ROUND],
        [Sheet(points=(4, 4), **ITSELF)],
        [ROUND, Box(points=(2, 2, 2), position=(0.0, 3.0, 0.0))],
        [ROUND, replace(ROPE, **TEARS)],
        [replace(ROUND, **TEARS)],
        [replace(ROPE, **TEARS), replace(ROPE, **TEARS)],
        [ROPE, Rope(points=1, position=(0.0, 3.0, 0.0))],
    ],
    ids=["itself", "a sheet itself", "itself and a box", "itself and a loose one", "loose itself", "loose", "a point"],
)
def test_whatever_ropes_there_are_it_is_compiled(jello):
    apart = [replace(one, position=(0.0, float(3 * j), 0.0)) for j, one in enumerate(jello)]
    simulation = Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=apart), method="verlet", substeps=4)
    simulation.frame()
    assert simulation.energies()["contact"] == 0.0


def test_in_a_plane_that_leans_rounding_does_not_choose_the_side():
    """Where they cross, every contact leads the second rope to one side, whatever the noise in how far they are."""
    simulation = Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=[Rope(points=9, length=1.0)] * 2), method="rk4")
    draw = np.random.default_rng(5)
    for _ in range(8):
        plane = np.linalg.qr(draw.standard_normal((3, 3)))[0]
        placed(simulation, (plane, plane @ rotation((0.0, 75.0, 0.0))), plane @ [0.11, 0.0, 0.07])
        simulation.energies()
        contacts = touch(simulation).contacts
        up = contacts.normal.to_numpy()[:: contacts.per_point] @ plane[:, 1]
        where = (contacts.count.to_numpy() > 0) & (np.abs(up) > 0.9)
        assert where[:9].any() and where[9:].any() and len(set(np.sign(up * np.repeat([1.0, -1.0], 9))[where])) == 1
