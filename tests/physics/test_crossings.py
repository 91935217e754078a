"""Jellos that begin crossed: what is thin is refused, solids are warned of, by closed small cases."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

from taichi_jello import Ball, Box, Contact, Ring, Rope, Scene, SceneError, SceneWarning, Sheet, Simulation, Snapshot
from taichi_jello.physics.forces.soft_contact.surface.crossings import (
    Surfaces,
    crossings,
    goes_through,
    pierced,
    where_through,
)
from taichi_jello.run.assembly import assembled
from taichi_jello.scenefiles import demos, load
from taichi_jello.support import runtime

BOX = Box(points=(5, 5, 5))
SHEET = Sheet(points=(9, 9), size=(2.0, 2.0))
ROPE = Rope(points=9, length=2.0)


@pytest.fixture(scope="module", autouse=True)
def taichi(request):
    runtime.start(request.config.getoption("--arch"), "f32")


def found(*jello):
    """The places (3,) at which two jellos cross, by both."""
    return {(a, b): place for a, b, place in crossings(Surfaces.of(assembled(Scene(jello=jello))))}


@pytest.mark.parametrize("thin", [SHEET, ROPE], ids=lambda jello: jello.shape)
def test_what_is_thin_may_not_begin_through_another(thin):
    words = r"jello\.1: expected a start apart from jello\.0, got one through it at \[(.*)\]"
    with pytest.raises(SceneError, match=words) as told:
        Simulation(Scene(jello=[BOX, thin]), method="rk4")
    x, y, z = (float(word) for word in re.search(words, str(told.value)).group(1).split(","))
    assert max(abs(x), abs(z)) == pytest.approx(0.5, abs=2e-3) and y == pytest.approx(0.0, abs=1e-3)
    upright = replace(thin, rotation=(0.0, 0.0, 90.0))
    with pytest.raises(SceneError, match=r"jello\.1: expected a start apart from jello\.0"):
        Simulation(Scene(jello=[SHEET, upright]), method="rk4")


def test_solids_that_begin_in_each_other_are_warned_of():
    half = replace(BOX, position=(0.5, 0.1, 0.2))
    with pytest.warns(SceneWarning, match=r"jello\.1 begins partly in jello\.0, at \[") as told:
        Simulation(Scene(jello=[BOX, half, replace(half, position=(1.2, 0.3, 0.1))]), method="rk4")
    assert "(and 1 more pair)" in str(told[0].message) and len(told) == 1


def test_what_does_not_touch_is_not_looked_at():
    jello = [BOX, SHEET]
    with warnings.catch_warnings():
        warnings.simplefilter("error", SceneWarning)
        for contact in (Contact(touch=False), Contact(stiffness=0.0)):
            Simulation(Scene(jello=jello, contact=contact), method="rk4")
        Simulation(Scene(jello=[BOX, replace(BOX, position=(1.5, 0.0, 0.0))]), method="rk4")


def test_a_state_is_taken_as_it_is(tmp_path, here):
    """The scene begins apart, the state is crossed; and with `--from` a crossed scene is not looked at."""
    apart = Simulation(Scene(jello=[BOX, replace(SHEET, position=(0.0, 3.0, 0.0))]), method="euler")
    x = assembled(Scene(jello=[BOX, SHEET])).x
    apart.restore(Snapshot(0.0, x, np.zeros_like(x)))
    np.savez(tmp_path / "state.npz", x=x, v=np.zeros_like(x))
    (tmp_path / "crossed.toml").write_text(
        'collider = []\n[[jello]]\nshape = "box"\npoints = [5, 5, 5]\n'
        '[[jello]]\nshape = "sheet"\npoints = [9, 9]\nsize = [2.0, 2.0]\n'
    )
    refused = here("run", "crossed.toml", "--seconds", "0", "-o", "a.npz")
    assert refused.returncode == 2 and "jello.1: expected a start apart from jello.0" in refused.stderr
    taken = here("run", "crossed.toml", "--from", "state.npz", "--seconds", "0", "-o", "a.npz")
    assert taken.returncode == 0, taken.stderr


def test_boxes_cross_where_an_edge_goes_through_a_face():
    for shift in ((0.5, 0.0, 0.0), (0.5, 0.1, 0.2), (0.5, 0.5, 0.5)):  # with and without sides in one plane
        (place,) = found(BOX, replace(BOX, position=shift)).values()
        assert np.all(np.abs(place) <= 0.5 + 1e-9) and np.all(np.abs(place - shift) <= 0.5 + 1e-9)
    small = Box(points=(3, 3, 3), size=(0.5, 0.5, 0.5))
    assert not found(BOX, small)  # within it
    for position in ((1.0, 0.0, 0.0), (0.75, 0.25, 0.25), (0.75, 0.1, 0.2)):  # face on face
        size = BOX.size if position[0] == 1.0 else small.size
        assert not found(BOX, replace(small, size=size, position=position))


def test_sheets_cross_even_where_points_of_one_lie_in_the_other():
    upright = replace(SHEET, rotation=(90.0, 0.0, 0.0))
    assert found(SHEET, upright) and found(SHEET, replace(upright, position=(0.1, 0.3, 0.2)))
    assert not found(SHEET, replace(upright, position=(0.0, 1.0, 0.0)))  # it stands on it
    assert not found(SHEET, SHEET) and not found(SHEET, replace(SHEET, position=(0.3, 0.0, 0.1)))  # in one plane
    assert not found(BOX, replace(SHEET, position=(0.0, 0.5, 0.0)))  # it lies on it


def test_ropes_have_no_faces_and_rings_may_hang_in_each_other():
    assert not found(ROPE, replace(ROPE, rotation=(0.0, 90.0, 0.0)))
    linked = Ring(position=(0.5, 0.0, 0.0), rotation=(90.0, 0.0, 0.0))
    assert not found(Ring(), linked) and not found(Ring(), replace(ROPE, rotation=(0.0, 90.0, 0.0)))
    assert found(Ring(), replace(linked, position=(0.8, 0.0, 0.0)))
    assert found(Ball(radius=0.5, resolution=5), ROPE)  # by its skin
    assert not found(Ball(radius=0.5, resolution=5), replace(ROPE, position=(0.0, 0.51, 0.0)))


def test_where_a_line_goes_through_a_triangle():
    corners = np.array([(0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (0.0, 1.0, 1.0)])
    through, beside = np.array([(0.2, 0.2, 0.0), (0.4, 0.2, 4.0)]), np.array([(0.9, 0.9, 0.0), (0.9, 0.9, 4.0)])
    short = np.array([(0.2, 0.2, 0.0), (0.2, 0.2, 0.9)])
    assert goes_through(np.stack([through, beside, short]), corners).tolist() == [True, False, False]
    assert where_through(through, corners) == pytest.approx([0.25, 0.2, 1.0])


def test_among_many_the_one_that_goes_through_is_found():
    """More pairs than are looked at together; the same answer as of every line with every triangle."""
    draw = np.random.default_rng(3)
    corners = draw.uniform(-1.0, 1.0, (900, 1, 3)) + 0.05 * draw.standard_normal((900, 3, 3))
    ends = draw.uniform(-1.0, 1.0, (900, 1, 3)) + 0.05 * draw.standard_normal((900, 2, 3))
    through = goes_through(ends[:, None], corners)
    assert through.any()
    place = pierced(ends, corners)
    i, j = np.nonzero(through)
    assert min(np.abs(where_through(ends[a], corners[b]) - place).max() for a, b in zip(i, j, strict=True)) < 1e-9
    i = np.flatnonzero(~through.any(1))
    assert pierced(ends[i], corners) is None


@pytest.mark.parametrize("name", demos())
def test_no_demo_begins_crossed(name):
    assert not list(crossings(Surfaces.of(assembled(load(name)))))
