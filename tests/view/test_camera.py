import numpy as np
import pytest
import taichi as ti

from taichi_jello.view.camera import FAR, NEAR, Viewpoint

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
