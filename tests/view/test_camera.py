import itertools

import numpy as np
import pytest
import taichi as ti

from taichi_jello import Block, Box, Camera, CameraKeyframe, Plane, Room, Rope, Scene, Sheet, Sphere
from taichi_jello.run.assembly import assembled
from taichi_jello.view.camera import FAR, NEAR, Viewpoint
from taichi_jello.view.drawing.drawing import Drawing

PLACES = [
    ((2.6, 1.9, 3.6), (0.0, 0.6, 0.0)),
    ((-3.0, 0.2, -0.5), (1.0, 1.0, 1.0)),
    ((0.1, 6.0, 0.0), (0.0, 0.0, 0.0)),
]


@pytest.mark.parametrize(("eye", "target"), PLACES)
def test_matrices_are_those_of_ggui(eye, target):
    theirs = ti.ui.Camera()
    theirs.position(*eye)
    theirs.lookat(*target)
    theirs.up(0.0, 1.0, 0.0)
    theirs.fov(37.0)
    theirs.z_near(NEAR)
    theirs.z_far(FAR)
    ours = Viewpoint(eye, target, 37.0)
    assert np.allclose(ours.view(), np.array(theirs.get_view_matrix()).T, atol=2e-6)
    assert np.allclose(ours.projection(1.6), np.array(theirs.get_projection_matrix(1.6)).T, atol=2e-6)


def test_target_is_in_the_middle_and_up_is_up():
    view = Viewpoint((2.0, 2.0, 3.0), (0.5, 0.5, 0.5))
    middle, above = view.project(np.array([[0.5, 0.5, 0.5], [0.5, 0.9, 0.5]]), (640, 360))
    assert np.allclose(middle, [320.0, 180.0])
    assert above[1] < 180.0 and abs(above[0] - 320.0) < 1e-9


def test_points_behind_the_eye_have_no_place():
    view = Viewpoint((0.0, 0.0, 5.0), (0.0, 0.0, 0.0))
    assert np.isnan(view.project(np.array([[0.0, 0.0, 6.0]]), (640, 360))).all()


def test_orbit_keeps_the_distance_and_stops_below_the_pole():
    view = Viewpoint((0.0, 1.0, 3.0), (0.0, 1.0, 0.0))
    view.orbit(np.pi / 2.0, 0.0)
    assert np.allclose(view.eye, [3.0, 1.0, 0.0])
    view.orbit(0.3, 10.0)
    assert view.distance == pytest.approx(3.0)
    assert 3.98 < view.eye[1] < 4.0


def test_pan_follows_the_picture_and_zoom_the_distance():
    view = Viewpoint((0.0, 1.0, 4.0), (0.0, 1.0, 0.0))
    view.pan(0.5, 0.25)
    assert np.allclose(view.target, [0.5, 1.25, 0.0]) and np.allclose(view.eye, [0.5, 1.25, 4.0])
    view.zoom(0.5)
    assert view.distance == pytest.approx(2.0)
    view.reset()
    assert np.allclose(view.eye, [0.0, 1.0, 4.0])


def shown(scene, size=(1280, 720)):
    """Where the jellos' points are in the scene's first picture, from -1 to 1 along each side."""
    body = assembled(scene)
    view = Viewpoint.first(scene, body, size[0] / size[1])
    return view, 2.0 * view.project(body.x, size) / size - 1.0


def test_a_scene_without_a_camera_is_in_its_picture():
    high = (Sheet(position=(0.0, 2.3, 0.0)), Rope(position=(0.0, 2.8, 1.0)))
    for jello in (high, (Box(position=(40.0, 3.0, 0.0)),), high[:1]):
        scene = Scene(jello=jello, collider=[Plane()])
        view, places = shown(scene)
        assert np.abs(places).max() < 0.9
        below = assembled(scene).x.mean(0)[None] * [1.0, 0.0, 1.0]  # where it falls
        assert np.abs(2.0 * view.project(below, (1280, 720)) / (1280, 720) - 1.0).max() < 1.0
    room = Room(min=(-2.0, -2.0, -2.0), max=(2.0, 2.0, 2.0))
    view, _ = shown(Scene(jello=[Box()], collider=[room]))
    corners = view.project(np.array(list(itertools.product((-2.0, 2.0), repeat=3))), (1280, 720))
    fill = np.abs(2.0 * corners / (1280, 720) - 1.0).max()
    assert 0.8 < fill < 0.9


@pytest.mark.parametrize("side", [1e-3, 0.03, 0.2, 30.0, 1000.0])
def test_a_jello_of_any_size_is_seen(side):
    scene = Scene(jello=[Box(points=(2, 2, 2), size=(side,) * 3, position=(0.0, 0.5 * side, 0.0))], collider=[Plane()])
    view, places = shown(scene)
    least = 0.12 if side >= 0.03 else 0.002  # nearer than NEAR nothing is drawn
    assert least < np.abs(places).max() < 0.9
    assert view.distance - 0.87 * side > NEAR and view.distance + 0.87 * side < FAR


@pytest.mark.parametrize("size", [(600, 900), (300, 300), (2000, 400)])
def test_a_picture_of_another_shape_holds_the_scene_as_well(size):
    wide = (Rope(length=6.0, position=(0.0, 0.5, 0.0)),)
    for jello in (wide, (Rope(length=6.0, rotation=(0.0, 0.0, 90.0), position=(0.0, 4.0, 0.0)),), (Box(),)):
        assert np.abs(shown(Scene(jello=jello), size)[1]).max() < 0.9
    own = Camera(eye=(0.0, 0.5, 9.0), target=(0.0, 0.5, 0.0))  # which holds the long rope at 16:9
    assert np.abs(shown(Scene(jello=wide, camera=own), size)[1]).max() < 1.0


def test_a_camera_that_is_given_or_shows_all_stays():
    own = Camera(eye=(0.0, 0.0, 1.0), target=(0.0, 0.0, 0.0))
    for camera, height in ((own, 2.8), (Camera(), 0.8)):
        view, _ = shown(Scene(jello=[Box(position=(0.0, height, 0.0))], collider=[Plane()], camera=camera))
        assert view.eye == pytest.approx(camera.eye) and view.target == pytest.approx(camera.target)


def test_colliders_are_in_the_picture_too():
    far = Sphere(center=(-6.0, 1.0, 0.0), radius=0.5)
    view, _ = shown(Scene(jello=[Box(position=(0.0, 0.6, 0.0))], collider=[Plane(), far]))
    places = 2.0 * view.project(far.mesh(1.0)[0] + far.place(0.0), (1280, 720)) / (1280, 720) - 1.0
    assert np.abs(places).max() < 0.9
    ground = Block(size=(200.0, 1.0, 200.0))  # counts near the jello only
    assert np.abs(shown(Scene(jello=[Box()], collider=[ground]))[1]).max() > 0.15


def test_the_scene_is_not_seen_from_below_its_ground():
    slope, far = Plane(normal=(-0.5, 1.0, 0.0)), Sphere(center=(6.0, 4.0, 0.0))
    view, places = shown(Scene(jello=[Box()], collider=[slope, far]))
    assert slope.distance(view.eye[None])[0] > 0.0 and np.abs(places).max() < 0.9


def test_whether_anything_is_in_the_picture():
    view, size = Viewpoint((0.0, 0.0, 5.0), (0.0, 0.0, 0.0)), (640, 360)
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    for factor in (0.1, 1.0, 100.0):  # all corners of the last are out of the picture, but what is between them is not
        assert view.sees(factor * corners, size)
    for middle in ((9.0, 0.0, 0.0), (-9.0, 0.0, 0.0), (0.0, 9.0, 0.0), (0.0, -9.0, 0.0), (0.0, 0.0, 9.0)):
        assert not view.sees(corners + middle, size)


def flown(camera, time, jello=(), size=(1280, 720), x=None, drawing=None):
    """The viewpoint of the picture at `time` [s], with the jellos at x (N, 3)."""
    scene = Scene(jello=jello or [Box(points=(2, 2, 2))], collider=[Plane()], camera=camera)
    body = assembled(scene)
    drawing = drawing or Drawing(scene, body, size[0] / size[1])
    drawing.update(body.x if x is None else x, np.zeros_like(body.x), time)
    return drawing


def test_keyframes_are_met_at_their_times():
    way = [
        CameraKeyframe(time=0.5, eye=(3.0, 1.0, 0.0)),
        CameraKeyframe(time=1.5, eye=(0.0, 2.0, 4.0), target=(0.0, 1.0, 0.0), fov=30.0),
        CameraKeyframe(time=2.0, target=(1.0, 1.0, 0.0), fov=60.0),
    ]
    camera = Camera(keyframe=way, fov=50.0)
    for time, eye, target, fov in (
        (0.0, (3.0, 1.0, 0.0), (0.0, 1.0, 0.0), 30.0),
        (1.5, (0.0, 2.0, 4.0), (0.0, 1.0, 0.0), 30.0),
        (9.0, (0.0, 2.0, 4.0), (1.0, 1.0, 0.0), 60.0),
    ):
        view = flown(camera, time).viewpoint
        assert (*view.eye, *view.target, view.fov) == pytest.approx((*eye, *target, fov))
    tall = flown(camera, 9.0, size=(400, 900)).viewpoint  # keeps the width of 60 degrees at 16:9
    assert np.tan(np.radians(tall.fov / 2.0)) == pytest.approx(np.tan(np.radians(30.0)) * (16 / 9) / (4 / 9))


@pytest.mark.parametrize("own", [{}, {"eye": (2.0, 1.0, 1.0), "target": (1.0, 0.5, 0.0)}])
def test_the_camera_orbits_by_the_angle_asked(own):
    """Also a view that is fitted to a scene without a camera."""
    high = [Box(points=(2, 2, 2), position=(0.0, 6.0, 0.0))]
    start = flown(Camera(**own), 0.0, high).viewpoint
    for time in (0.3, 1.0, 7.0):
        view, turned = flown(Camera(**own, orbit=0.2), time, high).viewpoint, Viewpoint(start.eye, start.target)
        turned.orbit(2.0 * np.pi * 0.2 * time, 0.0)
        assert view.eye == pytest.approx(turned.eye, abs=1e-9) and view.target == pytest.approx(start.target)


def test_the_camera_looks_where_a_jello_goes():
    two = [Box(points=(2, 2, 2)), Box(points=(2, 2, 2), position=(3.0, 0.5, 0.0))]
    body = assembled(Scene(jello=two, collider=[Plane()]))
    x = body.x + np.where(body.jello[:, None] == 1, [0.0, 2.0, 1.0], 0.0)
    eye = (2.6, 1.9, 3.7)
    view = flown(Camera(follow=1, eye=eye), 1.0, two, x=x).viewpoint
    assert view.target == pytest.approx(x[body.jello == 1].mean(0)) and view.eye == pytest.approx(eye)
    x[:] = np.nan  # of numbers gone bad it keeps the target
    assert np.isfinite(flown(Camera(follow=1, eye=eye), 1.0, two, x=x).viewpoint.target).all()


def test_a_person_takes_the_camera_over_until_the_first_view():
    camera = Camera(orbit=0.25)
    drawing = flown(camera, 1.0)
    drawing.viewpoint.zoom(0.5)
    mine = drawing.viewpoint.eye.copy()
    assert flown(camera, 2.0, drawing=drawing).viewpoint.eye == pytest.approx(mine)
    drawing.viewpoint.reset()
    assert flown(camera, 3.0, drawing=drawing).viewpoint.eye == pytest.approx(flown(camera, 3.0).viewpoint.eye)
