"""A scene's own look in its pictures, and the springs' colours in a film."""

from dataclasses import replace

import numpy as np
import pytest
from still import Still, cube_scene
from test_pictures import RENDERERS, opened, shot

from taichi_jello import Background, Ball, Block, Box, Camera, Ground, Plane, Region, Rope, Scene, Sheet, Sphere
from taichi_jello.app.cli import as_seen
from taichi_jello.app.options import options
from taichi_jello.view.drawing.scale import Scale
from taichi_jello.view.drawing.springs import ramp_table
from taichi_jello.view.render.film_frames import Pictures
from taichi_jello.view.render.renderers import drawing_of

SIZE = (480, 270)
FRONT = Camera(eye=(0.0, 1.0, 5.0), target=(0.0, 0.6, 0.0), show="skin")


def hue(image, point, still):
    """Mean red, green and blue around where a point [m] is seen, of their sum."""
    column, row = drawing_of(still, SIZE).viewpoint.project(np.array([point]), SIZE)[0].astype(int)
    part = image[row - 3 : row + 4, column - 3 : column + 4].reshape(-1, 3).mean(0)
    return part / part.sum()


@pytest.mark.parametrize("name", RENDERERS)
def test_jellos_and_their_regions_have_the_colors_of_the_keys(name):
    lower = Region(max=(1.0, 0.5, 1.0), color="blue")
    cube, ball = Box(points=(4, 4, 4), size=(0.9, 0.9, 0.9)), Ball(resolution=6, radius=0.5)
    for shape in (cube, ball, Sheet(rotation=(60.0, 0.0, 0.0))):
        regions = [] if isinstance(shape, Sheet) else [lower]
        jellos = [
            replace(shape, position=(-0.8, 0.6, 0.0), color="#10ff20"),
            replace(shape, position=(0.8, 0.6, 0.0), color="red", region=regions),
        ]
        still = Still(Scene(jello=jellos, collider=[Plane()], camera=FRONT))
        image = shot(name, still, only=("skin",))
        assert np.argmax(hue(image, (-0.8, 0.6, 0.0), still)) == 1
        assert np.argmax(hue(image, (0.8, 0.85, 0.0), still)) == 0
        if regions:
            assert np.argmax(hue(image, (0.8, 0.3, 0.0), still)) == 2


@pytest.mark.parametrize("name", RENDERERS)
def test_solids_ground_and_sky_have_the_colors_of_the_keys(name):
    scene = Scene(
        jello=[Box(points=(1, 1, 1), position=(-1.5, 0.1, 0.0))],
        collider=[
            Plane(color="red"),
            Sphere(center=(-0.8, 0.5, 0.0), color="lime"),
            Block(center=(0.8, 0.5, 0.0), color="blue"),
        ],
        camera=FRONT,
        background=Background(top="magenta", bottom="yellow"),
    )
    still = Still(scene)
    image = shot(name, still, only=())
    assert np.argmax(hue(image, (-0.8, 0.6, 0.5), still)) == 1 and np.argmax(hue(image, (0.8, 0.5, 0.5), still)) == 2
    assert np.argmax(hue(image, (0.0, 0.0, 2.0), still)) == 0  # a floor has its collider's colour
    assert hue(image, (0.0, 0.0, 2.0), still)[0] > 0.5
    top, low = image[2].mean(0), image[:, :, 2].argmin(0)  # magenta above, and nowhere as little blue as at the horizon
    assert top[0] > top[1] + 25 and top[2] > top[1] + 25 and np.median(low[150:330]) > 30
    green = shot(name, Still(replace(scene, ground=Ground(color=(0.1, 0.9, 0.1)))), only=())
    assert np.argmax(hue(green, (0.0, 0.0, 2.0), still)) == 1  # unless the ground has one


def test_a_floor_is_plain_or_not_there():
    still = Still(Scene(jello=[Box(points=(2, 2, 2), position=(0.0, 9.0, 0.0))], collider=[Plane()], camera=FRONT))
    spread = {}
    for pattern in ("checker", "plain"):
        scene = replace(still.scene, ground=Ground(pattern=pattern))
        row = shot("raster", Still(scene), only=())[230, 180:300, 0]
        spread[pattern] = np.abs(np.diff(row)).max()
    assert spread["checker"] > 8 and spread["plain"] <= 2
    gone = shot("raster", Still(replace(still.scene, ground=Ground(show=False))), only=())
    assert np.ptp(gone.mean((1, 2))) < 60 and np.abs(np.diff(gone[230, :, 0])).max() <= 2


def test_faces_in_one_plane_with_the_floor_are_the_floor():
    """No stray pixels of either, from where the eye looks along them."""
    block = Block(center=(0.0, -0.25, 0.0), size=(2.0, 0.5, 2.0), color="red")
    low = Camera(eye=(0.3, 0.4, 4.0), target=(0.0, 0.0, 0.0))
    jello = [Box(points=(1, 1, 1), position=(0.0, 5.0, 0.0))]
    both, alone = (Still(Scene(jello=jello, collider=[Plane(), *rest], camera=low)) for rest in ([block], []))
    assert np.array_equal(shot("raster", both, only=()), shot("raster", alone, only=()))


def test_a_rope_is_a_tube_of_its_color_with_a_shadow():
    rope = Rope(points=6, length=1.6, position=(0.0, 0.3, 0.0), color="lime")
    still = Still(Scene(jello=[rope], collider=[Plane()], camera=FRONT))
    drawing = drawing_of(still, SIZE)
    empty = shot("raster", still.put(still.body.x + [0.0, 1e3, 0.0]), only=())
    image = shot("raster", still.put(still.body.rest + [0.0, 0.3, 0.0]), only=("skin",))
    green = (image[..., 1] - image[..., 0] > 20) & (image[..., 1] - image[..., 2] > 20)
    step = 1.6 / 5
    wide = 2.0 * 0.13 * step * drawing.viewpoint.pixels_per_meter(SIZE[1]) / 5.02  # m from the eye
    ends = drawing.viewpoint.project(still.x[[0, -1]], SIZE)[:, 0]
    expected = wide * np.ptp(ends) + np.pi / 4.0 * wide**2
    assert green.sum() == pytest.approx(expected, rel=0.2)  # its outermost pixels are half covered
    darker = (empty - image).max(2)
    below = np.nonzero(green)[0].max() + 5
    assert (darker[below:] > 5).sum() > 50 and darker[below:].max() > 8 and darker[: below - 15].max() == 0


def test_no_cage_of_springs_is_in_a_ball():
    still = Still(Scene(jello=[Ball(resolution=6, position=(0.0, 0.6, 0.0))], camera=FRONT, collider=[Plane()]))
    assert np.array_equal(shot("raster", still, only=("skin", "springs")), shot("raster", still, only=("skin",)))


def test_a_spring_under_the_same_force_has_the_same_color_in_a_whole_film():
    """A pair of cubes: while one is pulled apart ever more, the other, a little stretched, keeps its colours."""
    boxes = [Box(points=(3, 3, 3), position=(x, 1.5, 0.0)) for x in (-1.0, 1.0)]
    still = Still(Scene(jello=boxes, collider=[Plane()], camera=Camera(eye=(0.0, 1.5, 5.0), target=(0.0, 1.5, 0.0))))
    film = Pictures(still, SIZE, "raster")
    own, seen, tops = still.body.jello == 0, [], []
    pulled = film.drawing.body.jello[film.drawing.springs.pairs[:, 0]] == 1
    for more in (0.01, 0.02, 0.025, 0.0):
        x = still.body.rest.copy()
        x *= np.where(own, 1.005, 1.0 + more)[:, None]
        still.put(x + np.where(own[:, None], [-1.0, 1.5, 0.0], [1.0, 1.5, 0.0]))
        image = film.take().astype(int)
        seen.append((film.drawing.springs.lines.rgb.reshape(-1, 2, 3)[~pulled].copy(), image[:200, 60:200]))
        tops.append(film.drawing.key.most)
    film.close()
    assert len(set(tops)) == 1
    for rgb, image in seen[1:]:
        assert np.array_equal(rgb, seen[0][0]) and np.abs(image - seen[0][1]).max() <= 3


def test_a_scale_that_is_given_is_that_of_all_pictures(cube):
    for color, unit in (("force", "N"), ("strain", "%"), ("stiffness", "N/m")):
        still = Still(replace(cube.scene, camera=replace(cube.scene.camera, scale=40.0)))
        drawing = drawing_of(still)
        for stretch in (1.0, 1.2, 3.0):
            drawing.update(stretch * still.body.x, still.v, 0.0, color=color)
            assert (drawing.key.most, drawing.key.unit) == (pytest.approx(40.0), unit)
    drawing.update(1.2 * still.body.x, still.v, 0.0, color="strain")
    assert np.allclose(drawing.springs.lines.rgb, ramp_table()[127], atol=0.02)  # 20 of 40 %


def test_what_a_scale_expects_of_weight_and_fall():
    """A rope bears its whole weight; of a cube that falls from h each spring takes F²/2k = mgh/S."""
    hung = Still(Scene(jello=[Rope(mass=0.3)]))
    assert Scale(hung.scene, hung.body).of("force", np.zeros(0)) == 5.0  # 2.9 N
    fallen = Still(cube_scene(2.5, stiffness=50.0, mass=2.0))
    force = np.sqrt(2.0 * 50.0 * 2.0 * 9.81 * 2.0 / len(fallen.body.springs))  # 3.5 N
    assert 2.0 < force < 5.0 == Scale(fallen.scene, fallen.body).of("force", np.zeros(0))


def test_springs_are_set_off_from_a_jello_of_their_own_color():
    """Blue springs at rest on a blue cube: beside each is a pale line."""
    still = Still(cube_scene(0.9, points=3, color=(0.16, 0.36, 0.96)))
    bare, drawn = (shot("raster", still, only=only).mean(2) for only in (("skin",), ("skin", "springs")))
    corner = drawing_of(still, SIZE).viewpoint.project(np.array([[0.0, 0.9, 0.5]]), SIZE)[0].astype(int)
    gain = (drawn - bare)[corner[1] - 20 : corner[1] - 8, corner[0] - 12 : corner[0] + 12]
    assert gain.max() > 40


def test_options_of_the_look_reach_the_camera():
    chosen = options().parse_args(["shot", "cube", "-o", "x.png", "--show", "all springs", "--scale", "2.5"])
    camera = as_seen(chosen, cube_scene()).camera
    assert (camera.show, camera.scale, camera.color) == ("all springs", 2.5, "force")
    for wrong in (["--scale", "0"], ["--show", "bones"], ["--turn", "2"]):  # --turn is for films
        with pytest.raises(SystemExit) as end:
            options().parse_args(["shot", "cube", "-o", "x.png", *wrong])
        assert end.value.code == 2


def test_a_film_turns_as_often_as_asked(cube):
    film = Pictures(cube, (64, 36), "raster", orbit=0.5)
    start = film.drawing.viewpoint.eye.copy()
    for time, place in ((1.0, [-start[0], start[1], -start[2]]), (2.0, start)):
        cube.time = time
        film.take()
        assert film.drawing.viewpoint.eye == pytest.approx(np.array(place), abs=1e-9)
    film.close()


@pytest.mark.parametrize("name", RENDERERS)
def test_a_camera_that_moves_leaves_nothing_behind(name, cube):
    """Each picture of a turning camera is as one drawn afresh."""
    turning = Still(replace(cube.scene, camera=replace(cube.scene.camera, orbit=0.1)))
    drawing = drawing_of(turning, SIZE)
    with opened(name) as kept:
        for turning.time in (0.0, 0.5, 1.0):
            drawing.update(turning.x, turning.v, turning.time)
            kept.draw(drawing, drawing.viewpoint)
            image = kept.image()
            if name == "raster":
                assert np.array_equal(image, shot(name, turning, only=("skin", "springs", "particles")))
