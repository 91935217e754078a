"""Jellos that have gone through each other come apart again: sheets, ropes, and solids that are slender."""

from dataclasses import replace

import numpy as np
import pytest
from touching_pairs import overlap_by_half, placed, tangles

from taichi_jello import Ball, Box, Contact, Plane, Ring, Rope, Scene, Sheet, Simulation, runtime, trajectory
from taichi_jello.advice import SceneWarning
from taichi_jello.physics.crossed import clusters, hold_each_other, way_apart
from taichi_jello.physics.cuts import parts, pierced, right_side, surface_edges
from taichi_jello.physics.ropes import FLAT
from taichi_jello.physics.tangles import SOFT
from taichi_jello.physics.touching import THICKNESS, Touching
from taichi_jello.shapes.lattice import rotation

WEIGHTLESS = {"gravity": (0.0, 0.0, 0.0)}
SHEET = Sheet(points=(9, 9), size=(1.0, 1.0))


@pytest.fixture(scope="module", autouse=True)
def taichi(request):
    runtime.start(request.config.getoption("--arch"), "f32")


def crossings(simulation):
    """How many structural springs go through triangles of the other jello, by barycentric coordinates in float64."""
    body, x, found = simulation.body, simulation.x.astype(float), 0
    for a, b in ((0, 1), (1, 0)):
        springs = body.springs[(body.family == 0) & (body.jello[body.springs[:, 0]] == a)]
        p, way = x[springs[:, 0]], x[springs[:, 1]] - x[springs[:, 0]]
        for i, j, k in body.surface[body.jello[body.surface[:, 0]] == b]:
            system = np.stack(
                [np.broadcast_to(x[j] - x[i], way.shape), np.broadcast_to(x[k] - x[i], way.shape), -way], 2
            )
            fit = np.abs(np.linalg.det(system)) > 1e-12
            u, v, t = np.linalg.solve(system[fit], (p[fit] - x[i])[:, :, None])[:, :, 0].T
            found += np.count_nonzero((u > 0.0) & (v > 0.0) & (u + v < 1.0) & (t > 0.0) & (t < 1.0))
    return found


@pytest.fixture(scope="module")
def sheets():
    return Simulation(Scene(**WEIGHTLESS, jello=[SHEET, replace(SHEET, position=(0.0, 2.0, 0.0))]), method="rk4")


def test_sheets_that_cross_come_apart_and_not_like_a_shot(sheets):
    """By the nearest side alone they would stay crossed, half of each on either side of the other."""
    crossed, stiffness = 0, sheets.tuning["contact_stiffness"]
    apart = 2.0 * THICKNESS["sheet"] / 8.0
    for pose in range(16):
        overlap_by_half(sheets, pose)
        momentum, before = sheets.body.mass @ sheets.v, sum(sheets.energies().values())
        crossed += crossings(sheets) > 0
        sheets.advance(2.0)
        after = sheets.energies()
        assert after["contact"] == 0.0 and crossings(sheets) == 0
        # What passes the other's middle is given no more than a soft spring holds that is as long as both are apart.
        assert sum(after.values()) - before <= 0.5 * SOFT * stiffness * apart**2 * len(sheets.body)
        assert sheets.body.mass @ sheets.v == pytest.approx(momentum, abs=1e-5)
    assert crossed >= 8


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.3, 0.0, 0.17)])
def test_sheets_in_one_plane_leave_it_by_two_sides(sheets, shift):
    for turn in (np.eye(3), rotation((180.0, 0.0, 0.0)), rotation((0.0, 33.0, 0.0))):
        placed(sheets, (np.eye(3), turn), np.array(shift))
        sheets.advance(0.5)
        first = sheets.body.jello == 0
        assert sheets.energies()["contact"] == 0.0 and crossings(sheets) == 0
        assert sheets.x[first, 1].mean() > sheets.x[~first, 1].mean() + 0.1


def test_ropes_in_one_line_leave_it_by_two_sides():
    ropes = [Rope(points=8, length=1.0), Rope(points=8, length=1.0, position=(0.5, 0.0, 0.0))]
    simulation = Simulation(Scene(**WEIGHTLESS, jello=ropes), method="rk4")
    with pytest.warns(SceneWarning, match="nearer to a sheet or rope than these are thick"):
        simulation.advance(0.5)
    first = simulation.body.jello == 0
    assert simulation.energies()["contact"] == 0.0
    assert np.linalg.norm(simulation.x[first].mean(0) - simulation.x[~first].mean(0) + [0.5, 0.0, 0.0]) > 0.1


@pytest.fixture(scope="module")
def ropes():
    """Two ropes, and a box far away, for which it is looked what is tangled."""
    far = Box(points=(2, 2, 2), position=(50.0, 0.0, 0.0))
    return Simulation(Scene(**WEIGHTLESS, jello=[*[Rope(points=9, length=1.0)] * 2, far]), method="rk4")


@pytest.mark.parametrize(
    ("angle", "shift"),
    [(90.0, (0.0, 0.0, 0.0)), (30.0, (0.0, 0.0, 0.0)), (70.0, (0.2, 0.0, 0.1)), (90.0, (0, 0, 0.45))],
)
def test_ropes_that_cross_in_one_plane_leave_it_by_two_sides(angle, shift, ropes):
    """Pressed to both sides of each other all of these stayed."""
    apart, energy = 2.0 * THICKNESS["rope"] / 8.0, []
    for height in (2.0 * FLAT * apart, 0.0):
        placed(ropes, (np.eye(3), rotation((0.0, angle, 0.0))), np.add(shift, (0.0, -height, 0.0)))
        energy.append(sum(ropes.energies().values()))
    assert energy[1] == pytest.approx(energy[0], rel=0.01)
    ropes.advance(0.5)
    assert ropes.energies()["contact"] == 0.0 and sum(ropes.energies().values()) < energy[1]
    first, second = (ropes.x[ropes.body.jello == j, 1].mean() for j in (0, 1))
    assert first > second + 0.1


def test_a_rope_that_comes_end_first_stays_in_the_plane(ropes):
    """Its line goes through the other rope; itself it does not."""
    v = np.where((ropes.body.jello == 1)[:, None], [0.0, 0.0, -0.5], 0.0)
    placed(ropes, (np.eye(3), rotation((0.0, 90.0, 0.0))), (0.02, 0.0, 0.7), v)
    energy = sum(ropes.energies().values())
    for _ in range(60):
        ropes.frame()
        assert sum(ropes.energies().values()) < energy * (1.0 + 1e-5)
    assert np.abs(ropes.x[:18, 1]).max() < 1e-6
    assert ropes.v[ropes.body.jello == 0, 2].mean() < -0.1  # it was hit


@pytest.mark.parametrize(
    "other",
    [
        Rope(points=12, length=1.1),
        Box(points=(6, 6, 2), size=(1.0, 1.0, 0.2)),
        Ball(radius=0.5, resolution=5),
        Ring(),
    ],
    ids=lambda jello: jello.shape,
)
def test_what_a_sheet_cuts_comes_apart_from_it(other):
    simulation = Simulation(Scene(**WEIGHTLESS, jello=[SHEET, other]), method="rk4")
    for pose in range(4):
        overlap_by_half(simulation, pose)
        simulation.advance(2.0)
        assert simulation.energies()["contact"] == 0.0
        assert simulation.body.embedded.any() or crossings(simulation) == 0  # cells reach out of a ball's skin


@pytest.fixture(scope="module")
def ring():
    slab = Box(points=(6, 6, 2), size=(1.0, 1.0, 0.2))
    return Simulation(Scene(**WEIGHTLESS, jello=[Ring(), replace(slab, position=(0.0, 0.0, 2.0))]), method="rk4")


def test_rings_and_what_crosses_their_bar_come_apart(ring):
    """By the nearest faces alone these stayed in each other, half of the bar on either side."""
    simulation = ring
    for turn, shift in (
        ((0.0, 0.0, 0.0), (0.5, 0.0, 0.0)),
        ((90.0, 0.0, 0.0), (0.7, 0.0, 0.0)),
        ((90.0, 0.0, 45.0), (0.5, 0.0, 0.0)),
        ((90.0, 30.0, 0.0), (0.9, 0.0, 0.1)),
        ((60.0, 0.0, 20.0), (0.5, 0.0, 0.0)),
    ):
        placed(simulation, (np.eye(3), rotation(turn)), np.array(shift))
        before, spins = sum(simulation.energies().values()), 0
        for _ in range(90):
            simulation.frame()
            spins += tangles(simulation).tangled
        after = simulation.energies()
        # What leaves by another than the nearest place is not driven by a potential; a tenth may come of that here.
        assert after["contact"] == 0.0 and sum(after.values()) <= 1.1 * before
        assert 0 < spins < 90


def test_a_cloth_on_an_edge_is_not_tangled():
    """Its triangles cut the edge between two points of the box, which goes in and out again."""
    cloth = Sheet(points=(13, 13), size=(0.8, 0.8), position=(0.0, 0.62, 0.0), mass=0.2, damping=0.2)
    box = Box(points=(4, 4, 4), size=(0.5, 0.5, 0.5), position=(0.0, 0.25, 0.0))
    simulation = Simulation(Scene(jello=[cloth, box], collider=[Plane()]), method="rk4")
    simulation.advance(1.0)
    assert simulation.energies()["contact"] > 0.0 and not tangles(simulation).tangled


@pytest.mark.parametrize("within", [0, 5])
@pytest.mark.parametrize("name", ["sheets", "ring"])
def test_a_run_goes_on_to_the_same_bits_while_tangled(name, within, request, tmp_path):
    simulation = request.getfixturevalue(name)
    turn = rotation((90.0, 0.0, 45.0))
    placed(simulation, (np.eye(3), turn), np.array([0.5, 0.0, 0.03]))
    simulation.frame()
    simulation.step(within)
    simulation.energies()  # looks at the frame that follows
    middle = simulation.snapshot()
    assert tangles(simulation).tangled and any(name.startswith("tangle_") for name in middle.memory)
    run = trajectory.Trajectory(simulation)
    run.add()
    run.save(tmp_path / "tangled.npz")
    simulation.frame()
    simulation.frame()
    whole = simulation.snapshot()
    for start in (middle, trajectory.last_moment(tmp_path / "tangled.npz", simulation.body)):
        simulation.reset()
        simulation.frame()
        simulation.restore(start)
        simulation.frame()
        simulation.frame()
        assert np.array_equal(simulation.x, whole.x) and np.array_equal(simulation.v, whole.v)


def test_only_scenes_in_which_something_can_be_held_look_for_it(sheets):
    cubes = [Box(points=(3, 3, 3)), Box(points=(3, 3, 3), position=(2.0, 0.0, 0.0))]

    def made(**scene):
        return Simulation(Scene(**scene), method="rk4")

    assert tangles(made(jello=cubes)) is None and tangles(made(jello=[Ring(self_contact=True)])) is None
    for slender in (Ring(), Box(points=(9, 3, 3), size=(2.1, 0.5, 0.5))):
        found = tangles(made(jello=[slender, cubes[1]]))
        assert found.has_slender and not found.has_sheets
    assert tangles(sheets).has_sheets and not tangles(sheets).has_slender
    torn = replace(SHEET, tear_strain=0.5)
    assert tangles(made(jello=[torn, SHEET])) is None
    alone = made(jello=[Sheet(self_contact=True), SHEET], contact=Contact(touch=False))
    assert tangles(alone) is None


def test_surface_edges_of_every_shape():
    body_of = Simulation(
        Scene(jello=[SHEET, Rope(points=5), Box(points=(3, 3, 3)), Ball(radius=0.5, resolution=4)])
    ).body
    touching = Touching.of(body_of, np.zeros(4, bool))
    edges, whose = surface_edges(touching), body_of.jello[touching.points]
    assert (whose[edges[:, 0]] == whose[edges[:, 1]]).all() and (edges[:, 0] < edges[:, 1]).all()
    count = np.bincount(whose[edges[:, 0]])
    skin = len(body_of.skin_points(body_of.x))
    # A sheet of 8 × 8 squares: 2 · 8 · 9 sides, 64 diagonals. Closed surfaces of V points have 3V - 6 edges (Euler).
    assert count.tolist() == [208, 4, 3 * 26 - 6, 3 * skin - 6]


def test_parts_and_clusters():
    assert parts(5, np.array([[0, 3], [3, 4]])).tolist() == [0, 1, 2, 0, 0]
    assert parts(3, np.zeros((0, 2), int)).tolist() == [0, 1, 2]
    line = np.arange(1000)[:, None] * [0.1, -0.1, 0.0]
    line[600:] += [1.5, 0.0, 0.0]
    for places in (line, line[::9]):  # 1.3 m apart, and 2.4 m in the gap
        label = clusters(places, 1.5)
        assert len(np.unique(label)) == 2 and len(np.unique(label[places[:, 1] > -59.95])) == 1


def test_the_larger_part_is_right_and_the_way_leads_there():
    """A strip of 2 × 6 points that stands upright, cut by a level plane at a height of 0.5 above its lowest points."""
    place = np.array([(x, y, 0.0) for y in range(6) for x in range(2)], float)
    edges = np.array(
        [(2 * y + x, 2 * y + x + 2) for y in range(5) for x in range(2)] + [(2 * y, 2 * y + 1) for y in range(6)]
    )
    cut = np.flatnonzero((place[edges][:, :, 1].min(1) < 0.5) & (place[edges][:, :, 1].max(1) > 0.5))
    where = place[edges[cut]].mean(1)
    for up in (1.0, -1.0):  # whichever side the triangles face
        wrong, way = right_side(place, edges, cut, where, np.tile([0.0, up, 0.0], (2, 1)))
        assert wrong == pytest.approx(2 / 12) and way == pytest.approx([0.0, 1.0, 0.0])
    # Cut only halfway it hangs together: then the plane of the cut decides, with 2 of 12 points below it.
    wrong, way = right_side(place, edges, cut[:1], where[:1], np.array([[0.0, -1.0, 0.0]]))
    assert wrong == pytest.approx(2 / 12) and way == pytest.approx([0.0, 1.0, 0.0])


def test_where_a_line_goes_through_a_triangle():
    a, b, c = (np.array([p], float) for p in ((0, 0, 1), (1, 0, 1), (0, 1, 1)))
    where, normal = pierced(a, b, c, np.array([[0.2, 0.2, 0.0]]), np.array([[0.4, 0.2, 4.0]]))
    assert where[0] == pytest.approx([0.25, 0.2, 1.0]) and normal[0] == pytest.approx([0.0, 0.0, 1.0])


def test_two_bars_that_cross_part_along_the_way_square_to_both():
    bar = np.array([(x, y, z) for x in np.linspace(-2, 2, 21) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    across = bar[:, [1, 0, 2]] + [0.3, 0.2, 0.4]
    # 0.6 to go down, 1.4 up, more along either bar; the nearest of 300 directions is within 8 degrees.
    assert way_apart(bar, across) @ [0.0, 0.0, -1.0] > np.cos(np.radians(8.0))
    deep, flat = np.array([0.1, 0.3]), np.array([0.2, 0.2])
    against = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert hold_each_other(against, deep, flat) and not hold_each_other(against, 0.5 * deep, flat)
    assert not hold_each_other(np.abs(against), deep, flat)
