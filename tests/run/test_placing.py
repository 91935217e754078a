"""Where jellos without a position begin."""

import numpy as np
import pytest

from taichi_jello import Ball, Block, Box, Plane, Room, Rope, Scene, Sheet, Sphere, scenefiles
from taichi_jello.run.assembly import assembled
from taichi_jello.run.placing import outline
from taichi_jello.scene.override import override

SMALL = {"points": (3, 3, 3)}


def gaps(scene):
    """(colliders,) [m] between the jellos' surface and each collider."""
    points, _ = outline(assembled(scene))
    return np.array([c.distance(points - c.place(0.0)).min() for c in scene.collider])


def test_the_smallest_scene_stands_on_level_ground(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text('[[jello]]\nshape = "box"\n')
    scene = scenefiles.load(str(path))
    assert scene.collider == (Plane(),)
    low, high = assembled(scene).extent(0)
    assert low == pytest.approx([-0.5, 0.02, -0.5]) and high == pytest.approx([0.5, 1.02, 0.5])
    path.write_text('collider = []\n[[jello]]\nshape = "box"\n')
    scene = scenefiles.load(str(path))
    assert scene.collider == () and assembled(scene).extent(0)[1] == pytest.approx([0.5, 0.5, 0.5])
    scenefiles.save(scene, str(path))
    assert scenefiles.load(str(path)) == scene


@pytest.mark.parametrize("jello", [Box(**SMALL), Ball(radius=0.3, resolution=4), Sheet(), Rope(rotation=(0, 0, 40))])
@pytest.mark.parametrize(
    "collider",
    [
        [Plane(point=(0, -3, 0), normal=(0.2, 1, -0.3))],
        [Block(center=(5, 2, 1), size=(2, 1, 2))],
        [Plane(), Sphere(center=(0.1, 0, 0), radius=0.3)],
        [Room(min=(3, 1, 3), max=(6, 4, 6)), Sphere(center=(4.5, 1, 4.5), radius=0.4)],
        [Plane(normal=(1, 0, 0), point=(-3, 0, 0)), Plane()],
    ],
)
def test_it_stands_just_above_what_carries_it(jello, collider):
    gap = gaps(Scene(jello=[jello], collider=collider)).min()
    assert 0.0 < gap < 0.15  # under a corner of a coarse ball there is a little more


def test_a_small_sphere_between_the_particles_carries_it_too():
    small = Sphere(center=(0.25, 1.0, 0.25), radius=0.1)
    body = assembled(Scene(jello=[Box(**SMALL)], collider=[Plane(), small]))
    assert body.extent(0)[0][1] == pytest.approx(1.12, abs=0.01)


def test_several_stand_side_by_side_and_beside_what_has_its_place():
    free = (Box(**SMALL), Ball(radius=0.3, resolution=4), Box(size=(0.2, 0.2, 0.2), **SMALL))
    body = assembled(Scene(jello=free, collider=[Plane()]))
    spans = np.array([body.extent(j) for j in range(3)])
    assert np.all(spans[1:, 0, 0] - spans[:-1, 1, 0] == pytest.approx(0.1))
    assert spans[0, 0, 0] == pytest.approx(-spans[2, 1, 0], abs=1e-9)
    assert spans[:, 0, 1] == pytest.approx([0.02, 0.012, 0.004])
    given = Box(position=(0.2, 0.5, 0.0), **SMALL)
    body = assembled(Scene(jello=[Box(**SMALL), given], collider=[Plane()]))
    assert body.extent(0)[0][0] == pytest.approx(0.8) and body.extent(1)[0] == pytest.approx([-0.3, 0.0, -0.5])
    above = Box(position=(0.2, 2.5, 0.0), **SMALL)
    assert assembled(Scene(jello=[Box(**SMALL), above], collider=[Plane()])).extent(0)[0][0] == pytest.approx(-0.5)


def test_a_position_is_kept_as_it_is_and_one_coordinate_can_be_set():
    inside = Scene(jello=[Box(position=(0.0, 0.0, 0.0), **SMALL)], collider=[Plane()])
    assert assembled(inside).extent(0)[1] == pytest.approx([0.5, 0.5, 0.5])
    assert override(Scene(jello=[Box()]), ["jello", "0", "position", "1"], 2).jello[0].position == (0.0, 2.0, 0.0)


def test_without_anything_to_stand_on_it_begins_at_the_origin():
    for scene in (
        Scene(jello=[Box(**SMALL)], collider=[Plane(normal=(1, 0, 0))]),
        Scene(jello=[Box(**SMALL)], collider=[Plane()], gravity=(0, 0, 0)),
    ):
        assert np.array_equal(assembled(scene).x, Box(**SMALL).body().x)
