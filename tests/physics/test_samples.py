"""Points between the particles of what is longer from one to the next than it is thick: nothing passes between them."""

from dataclasses import replace

import numpy as np
import pytest
from touching_pairs import touch

from taichi_jello import Box, Pin, Rope, Scene, Simulation, runtime
from taichi_jello.assembly import assembled
from taichi_jello.physics.forces.skin_contact import steepest
from taichi_jello.physics.samples import MOST, samples
from taichi_jello.physics.touching import Touching, ways_out

ENDS = [Pin(max=(0.0, 1.0, 1.0)), Pin(min=(1.0, 0.0, 0.0))]
BAR = Box(points=(9, 2, 2), size=(1.6, 0.04, 0.04), stiffness=2000.0, damping=1.0, pin=ENDS)


@pytest.fixture(scope="module", autouse=True)
def taichi(request):
    runtime.start(request.config.getoption("--arch"), "f32")


def of(jello):
    body = assembled(Scene(jello=[jello, Box(points=(2, 2, 2), position=(0.0, 9.0, 0.0))]))
    return body, Touching.of(body, np.zeros(2, bool))


def test_edges_are_cut_into_parts_no_longer_than_the_body_is_thick():
    body, touching = of(BAR)
    assert len(touching.points) == touching.skin + 8 * 4 * 4  # 0.2 m in parts of 0.04 m, on four edges of 8 cells
    places = touching.places(body.x)[touching.skin :]
    lines = {tuple(place) for place in np.round(places[:, 1:], 6).tolist()}
    assert lines == {(y, z) for y in (-0.02, 0.02) for z in (-0.02, 0.02)}
    along = np.unique(np.round(places[:, 0], 6))
    assert np.diff(np.sort([*along, *np.linspace(-0.8, 0.8, 9)])) == pytest.approx(0.04, abs=1e-6)
    assert touching.weights[:, :2].sum(1) == pytest.approx(1.0) and not touching.weights[:, 2:].any()
    assert touching.share[touching.skin :] == pytest.approx(0.2)
    # All samples that a particle is part of, of two cells: its weights in them, twice Σ k/25 for k = 1 to 4 at most.
    bound = steepest(body.mass, touching.corners, touching.weights, touching.share[touching.bare :])
    assert bound * body.mass[1] == pytest.approx(2 * 0.2 * (0.2 + 0.4 + 0.6 + 0.8), rel=0.3)


def test_only_what_is_long_has_them_and_not_too_many():
    for cube in (Box(points=(5, 5, 5)), Box(points=(2, 2, 8), size=(0.2, 0.2, 1.0)), Rope(points=4, length=3.0)):
        touching = of(cube)[1]
        assert touching.skin == len(touching.points) == touching.bare
    body = assembled(Scene(jello=[Box(points=(2, 2, 2), size=(1.0, 1.0, 0.001))]))
    faces = ways_out(body.rest, body.cells)[0]
    corners, _, share = samples(body.rest, faces, np.full(len(faces), 0.001))
    assert share.min() == 1.0 / MOST and len(corners) == 8 * (MOST - 1)
    loose = Touching.of(body, np.ones(1, bool))
    assert loose.skin == len(loose.points)


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
    assert touch(simulation).near.skinned
    simulation.advance(0.4)
    bar, across = (simulation.x[simulation.body.jello == j] for j in (0, 1))
    near = across[np.abs(across[:, 2] - bar[:, 2].mean()) < 0.15]
    assert len(near) and near[:, 1].max() > bar[np.abs(bar[:, 0] - 0.1) < 0.15, 1].max()
