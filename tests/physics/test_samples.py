"""Points between the particles of what is longer from one to the next than it is thick: nothing passes between them."""

from dataclasses import replace

import numpy as np
import pytest
from touching_pairs import touch

from taichi_jello import Box, Pin, Rope, Scene, Sheet, Simulation
from taichi_jello.physics.forces.collider_contact.surface_points import steepest
from taichi_jello.physics.forces.soft_contact.surface.edge_samples import MAX_PARTS, edges, samples
from taichi_jello.physics.forces.soft_contact.surface.exits import ways_out
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import Touching
from taichi_jello.run.assembly import assembled
from taichi_jello.support import runtime

ENDS = [Pin(max=(0.0, 1.0, 1.0)), Pin(min=(1.0, 0.0, 0.0))]
BAR = Box(points=(9, 2, 2), size=(1.6, 0.04, 0.04), stiffness=2000.0, damping=1.0, pin=ENDS)


@pytest.fixture(scope="module", autouse=True)
def taichi(request):
    runtime.start(request.config.getoption("--arch"), "f32")


def of(jello):
    body = assembled(Scene(jello=[jello, Box(points=(3, 3, 3), position=(0.0, 9.0, 0.0))]))
    return body, Touching.of(body, np.zeros(2, bool))


def test_edges_are_cut_into_parts_shorter_than_the_body_is_thick():
    body, touching = of(BAR)
    # Of 0.04 m, ¾: 0.2 m in 7 parts on four edges of 8 cells; 0.04 m in 2 on those around 9 sections.
    assert len(touching.points) == touching.skin + 8 * 4 * 6 + 9 * 4
    places, share = touching.places(body.x)[touching.skin :], touching.share[touching.skin :]
    halves, sevenths = (places[np.isclose(share, 1 / parts)] for parts in (2, 7))
    assert len(halves) == 9 * 4 and len(sevenths) == 8 * 4 * 6
    lines = {tuple(place) for place in np.round(sevenths[:, 1:], 6).tolist()}
    assert lines == {(y, z) for y in (-0.02, 0.02) for z in (-0.02, 0.02)}
    lines = {tuple(place) for place in np.round(halves[:, 1:], 6).tolist()}
    assert lines == {(0.0, -0.02), (0.0, 0.02), (-0.02, 0.0), (0.02, 0.0)}
    along, ends = np.unique(np.round(sevenths[:, 0], 6)), np.linspace(-0.8, 0.8, 9)
    assert np.diff(np.sort([*along, *ends])) == pytest.approx(0.2 / 7, abs=1e-6)
    assert np.unique(np.round(halves[:, 0], 6)) == pytest.approx(ends, abs=1e-6)
    assert touching.weights[:, :2].sum(1) == pytest.approx(1.0) and not touching.weights[:, 2:].any()
    # All samples that a particle is part of, their share times its weight: those beside it along the bar, twice
    # 1/7 Σ k/7 for k = 1 to 6, and those of two edges across it, 1/2 · 1/2 each.
    bound = steepest(body.mass, touching.corners, touching.weights, touching.share[touching.bare :])
    assert bound * body.mass[1] == pytest.approx(2 * 21 / 49 + 2 / 4, rel=0.3)


def test_only_what_is_long_has_them_and_not_too_many():
    for cube in (Box(points=(5, 5, 5)), Box(points=(3, 3, 8), size=(0.2, 0.2, 1.0)), Rope(points=6, length=3.0)):
        touching = of(cube)[1]
        assert touching.skin == len(touching.points) == touching.bare
    body = assembled(Scene(jello=[Box(points=(2, 2, 2), size=(1.0, 1.0, 0.001))]))
    faces = ways_out(body.rest, body.cells)[0]
    corners, _, share = samples(body.rest, edges(faces), np.full(12, 0.001))
    assert share.min() == 1.0 / MAX_PARTS and len(corners) == 8 * (MAX_PARTS - 1)
    loose = Touching.of(body, np.ones(1, bool))
    assert loose.skin == len(loose.points)


def test_a_rope_has_them_where_it_may_lie_across_what_is_thin():
    rope, bar = Rope(points=4, length=0.3), Box(points=(9, 3, 3), size=(1.6, 0.04, 0.04))
    body = assembled(Scene(jello=[rope, bar, Sheet(points=(3, 3))]))
    touching = Touching.of(body, np.zeros(3, bool))
    own = touching.points[touching.skin :] < 4
    places = touching.places(body.x)[touching.skin :][own]
    assert len(places) == 3 * 3 and touching.share[touching.skin :][own] == pytest.approx(0.25)  # 0.1 m, in 0.03 m
    assert np.sort([*places[:, 0], *body.x[:4, 0]]) == pytest.approx(np.linspace(-0.15, 0.15, 13), abs=1e-7)
    for loose in ([True, False, False], [False, True, False]):
        touching = Touching.of(body, np.array(loose))
        assert not np.any(touching.points[touching.skin :] < 4)


def test_what_may_tear_feels_a_rope_whatever_else_there_is():
    """A rope lies over a bar between its points: those of one that may tear touch its segments, since it may have no
    cells left, and they did not where there was a firm solid too."""
    bar = Box(points=(5, 2, 2), size=(1.6, 0.2, 0.2), tear_strain=9.0)
    rope = Rope(points=9, length=1.6, position=(0.0, 0.15, 0.1))
    stored = []
    for others in ([], [Box(points=(3, 3, 3), position=(0.0, 9.0, 0.0))]):
        simulation = Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=[bar, rope, *others]), method="rk4", substeps=50)
        stored.append(simulation.energies()["contact"])
    assert stored[0] > 0.0 and stored[1] == pytest.approx(stored[0], rel=1e-5)


def test_the_end_of_a_rope_has_no_segment_beside_a_point_between():
    """Straight, a rope that touches itself does not: its last particle was followed by the first of those between."""
    rope = Rope(points=12, length=3.0, self_contact=True)
    scene = Scene(
        gravity=(0.0, 0.0, 0.0), jello=[Box(points=(5, 5, 5), size=(0.2, 0.2, 0.2), position=(0, 9.0, 0)), rope]
    )
    simulation = Simulation(scene, method="rk4", substeps=50)
    touching = touch(simulation).surface.touching
    assert touching.skin == touching.bare and (simulation.body.jello[touching.points[-1]] == 1)
    assert simulation.energies()["contact"] == 0.0


def test_a_point_between_those_of_a_rope_touches_only_solids():
    """Beside another rope and a sheet, nearer than they are kept apart, only the particles have contacts."""
    rope, bar = Rope(points=4, length=0.3), Box(points=(9, 3, 3), size=(1.6, 0.04, 0.04), position=(0.0, 0.0, 0.0))
    near = [
        Rope(points=9, length=0.3, position=(0.0, 0.01, 0.0)),
        Sheet(points=(9, 9), size=(0.4, 0.4), rotation=(90.0, 0.0, 0.0)),
    ]
    far = (0.0, 9.0, 0.0)
    for others, some in (([replace(bar, position=far), *near], False), ([bar], True)):
        simulation = Simulation(Scene(jello=[rope, *others]), method="rk4", substeps=100)
        simulation.step(1)
        found = touch(simulation)
        own = found.contacts.count.to_numpy()[found.surface.first_sample :]
        mine = simulation.body.jello[found.surface.touching.points[found.surface.first_sample :]] == 0
        assert found.contacts.count.to_numpy()[:4].all() and mine.any() and own[mine].any() == some


@pytest.mark.parametrize(
    "other",
    [
        Box(points=(9, 2, 2), size=(1.6, 0.04, 0.04), mass=0.3, stiffness=500.0, rotation=(0.0, 90.0, 0.0)),
        Rope(points=20, length=2.0, mass=0.3, stiffness=500.0, rotation=(0.0, 90.0, 0.0)),
    ],
    ids=["bar", "rope"],
)
def test_what_falls_across_a_bar_between_its_points_is_held(other):
    """Both fell through, 0.1 m from the nearest particle of the bar; free fall is 0.78 m."""
    falls = replace(other, position=(0.1, 0.1, 0.1))
    simulation = Simulation(Scene(jello=[BAR, falls]), method="rk4")
    assert touch(simulation).surface.blended
    simulation.advance(0.4)
    bar, across = (simulation.x[simulation.body.jello == j] for j in (0, 1))
    near = across[np.abs(across[:, 2] - bar[:, 2].mean()) < 0.15]
    assert len(near) and near[:, 1].max() > bar[np.abs(bar[:, 0] - 0.1) < 0.15, 1].max()
