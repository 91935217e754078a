"""What the mouse does, and where the eye goes; without a window."""

from dataclasses import replace

import numpy as np
import pytest
from still import Still, cube_scene, grab_at

from taichi_jello.physics.colliders.sphere import Sphere
from taichi_jello.view.window.overlay import overlay
from taichi_jello.view.window.viewer import Viewer


def test_drags_move_the_camera(viewer):
    start = viewer.viewpoint.eye.copy()
    viewer.drag("left", 0.1, 0.0)
    assert viewer.viewpoint.eye[0] < start[0]  # the scene turns with the hand, so the eye goes the other way
    viewer.viewpoint.reset()
    viewer.drag("middle", 0.5, 0.0)
    # Half a window's height of pan moves the picture by half its height.
    moved = viewer.viewpoint.project(np.array([[0.0, 0.6, 0.0]]), (800, 400))[0]
    assert moved == pytest.approx([600.0, 200.0])


def test_the_eye_stays_above_the_floor_and_o_brings_the_first_view_back(viewer):
    start = viewer.viewpoint.eye.copy()
    for _ in range(50):
        viewer.drag("right", 0.02, 0.05)
        viewer.handle_key("s")
        assert viewer.viewpoint.eye[1] > 0.0
        assert np.isfinite(viewer.viewpoint.axes()).all()
    viewer.handle_key("o")
    assert viewer.viewpoint.eye == pytest.approx(start)


def test_the_left_button_grabs_the_jello_and_the_target_follows_the_cursor(viewer):
    viewer.handle_key(" ")  # also while paused
    at, eye = grab_at(viewer), viewer.viewpoint.eye.copy()
    held = viewer.simulation.held
    assert held.target == pytest.approx([0.0, 0.5, 0.5], abs=1e-6) == held.point
    for step in ([40.0, -30.0], [100.0, -80.0], [-300.0, 50.0]):
        viewer.move(tuple(at + step))
        assert viewer.viewpoint.project(held.target[None], viewer.size)[0] == pytest.approx(at + step, abs=1e-3)
        depth = (viewer.viewpoint.eye - held.target) @ viewer.viewpoint.axes()[2]
        assert depth == pytest.approx((eye - [0.0, 0.5, 0.5]) @ viewer.viewpoint.axes()[2])
    assert viewer.viewpoint.eye == pytest.approx(eye)
    viewer.release("right")
    assert viewer.simulation.held is held
    viewer.release("left")
    assert viewer.simulation.held is None and viewer.grabbed is None


def test_shift_pulls_along_the_line_of_sight(viewer):
    at = grab_at(viewer)
    before = viewer.simulation.held.target.copy()
    viewer.move((at[0], at[1] - 100.0), in_depth=True)
    after = viewer.simulation.held.target
    assert viewer.viewpoint.project(after[None], viewer.size)[0] == pytest.approx(at, abs=1e-3)
    assert np.linalg.norm(after - viewer.viewpoint.eye) > np.linalg.norm(before - viewer.viewpoint.eye) * 1.1
    for far in (-1e5, 1e5):
        viewer.move((at[0], at[1] + far), in_depth=True)
        assert np.linalg.norm(viewer.simulation.held.target - viewer.viewpoint.eye) < 51.0
    assert np.isfinite(viewer.viewpoint.project(viewer.simulation.held.target[None], viewer.size)).all()


def test_beside_the_jello_and_with_the_right_button_the_view_turns(viewer):
    for button, at in (("left", (5.0, 5.0)), ("right", (640.0, 400.0))):
        viewer.viewpoint.reset()
        eye = viewer.viewpoint.eye.copy()
        viewer.press(button, at)
        viewer.move((at[0] + 50.0, at[1]))
        assert viewer.simulation.held is None and viewer.viewpoint.eye[0] < eye[0] - 0.1
        viewer.release(button)
        eye = viewer.viewpoint.eye.copy()
        viewer.move((at[0] + 90.0, at[1]))
        assert viewer.viewpoint.eye == pytest.approx(eye)


def test_behind_a_collider_nothing_is_grabbed(tmp_path):
    """A ball of 0.3 m between the eye and the cube hides its middle, not its corner."""
    scene = cube_scene(points=4)
    ball = Sphere(center=(0.0, 0.7, 1.5), radius=0.3)
    viewer = Viewer(Still(replace(scene, collider=(*scene.collider, ball))), folder=tmp_path)
    viewer.update()
    grab_at(viewer)
    assert viewer.grabbed is None
    viewer.release("left")
    grab_at(viewer, (0.45, 0.05, 0.5))
    assert viewer.grabbed is not None


def test_what_is_hidden_is_not_grabbed(viewer):
    viewer.shown = "particles"
    grab_at(viewer)  # the middle of a side has no particle
    assert viewer.grabbed is None
    viewer.release("left")
    grab_at(viewer, (0.5, 0.0, 0.5))
    assert len(viewer.simulation.held.particles) == 1


def test_without_a_grab_force_the_view_turns_instead(viewer, monkeypatch):
    def refuse(*_):
        raise ValueError("the scene has no Grab() among its forces")

    monkeypatch.setattr(viewer.simulation, "grab", refuse, raising=False)
    at, eye = grab_at(viewer), viewer.viewpoint.eye.copy()
    viewer.move((at[0] + 50.0, at[1]))
    assert "Grab" in viewer.notice and viewer.viewpoint.eye[0] < eye[0]


def test_the_grip_is_drawn_with_its_force(viewer):
    at = grab_at(viewer)
    viewer.move((at[0] + 100.0, at[1]))
    viewer.update()
    sheet = overlay(viewer)
    assert any(text.words == "3.46 N" for text in sheet.texts)
    ends = np.concatenate([line.points for line in sheet.lines])
    assert np.abs(ends - at).max(1).min() < 0.5 and np.abs(ends - at - [100.0, 0.0]).max(1).min() < 0.5


def test_f_looks_at_the_jello_wherever_it_is(viewer):
    viewer.simulation.put(viewer.simulation.body.x + [30.0, 7.0, -80.0])
    for viewer.size in ((1280, 720), (400, 1000)):
        viewer.handle_key("f")
        places = viewer.viewpoint.project(viewer.simulation.x, viewer.size)
        assert places.min() > 0.0 and (places < viewer.size).all()
        assert max(np.ptp(places, axis=0) / viewer.size) > 0.4


def test_zoom_keys(viewer):
    far = viewer.viewpoint.distance
    viewer.handle_key("w")
    assert viewer.viewpoint.distance < far
    viewer.handle_key("s")
    assert viewer.viewpoint.distance == pytest.approx(far)
