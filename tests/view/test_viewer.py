"""The viewer's keys, mouse and clock, without a window."""

import numpy as np
import pytest
from still import Still, cube_scene

from taichi_jello.scene import COLORS
from taichi_jello.view.viewer import HELP, MOST_FRAMES, SHOWS, Viewer


@pytest.fixture
def viewer(tmp_path):
    return Viewer(Still(cube_scene(points=2)), folder=tmp_path)


def test_physics_follows_the_clock(viewer):
    frame = viewer.simulation.frame_dt
    assert [viewer.advance(0.5 * frame) for _ in range(6)] == [0, 1, 0, 1, 0, 1]
    assert viewer.simulation.time == pytest.approx(3 * frame)


def test_a_slow_machine_slows_time_and_catches_up_with_nothing(viewer):
    frame = viewer.simulation.frame_dt
    for _ in range(40):
        assert viewer.advance(10 * MOST_FRAMES * frame) == MOST_FRAMES
    assert viewer.advance(0.5 * frame) == 0
    assert viewer.speed < 0.2


def test_space_pauses_and_right_steps_only_then(viewer):
    frame = viewer.simulation.frame_dt
    viewer.handle_key("Right")
    assert viewer.simulation.time == 0.0
    viewer.handle_key(" ")
    assert viewer.advance(1.0) == 0
    viewer.handle_key("Right")
    assert viewer.simulation.time == pytest.approx(frame)
    viewer.handle_key(" ")
    assert viewer.advance(frame) == 1


def test_r_resets_and_escape_leaves(viewer):
    viewer.advance(0.05)
    viewer.handle_key("r")
    assert viewer.simulation.time == 0.0 and viewer.simulation.resets == 1
    assert not viewer.leaving
    viewer.handle_key("Escape")
    assert viewer.leaving


def test_c_and_k_go_round(viewer):
    seen = [viewer.handle_key("c") and viewer.color for _ in COLORS]
    assert sorted(seen) == sorted(COLORS) and seen[-1] == "force"
    parts = []
    for _ in SHOWS:
        viewer.update()
        parts.append((viewer.drawing.blended is not None, len(viewer.drawing.lines), viewer.drawing.dots is not None))
        viewer.handle_key("k")
    assert len(set(parts)) == len(SHOWS) and viewer.show == 0


def test_drags_move_the_camera(viewer):
    start = viewer.viewpoint.eye.copy()
    viewer.drag("left", 0.1, 0.0)
    assert viewer.viewpoint.eye[0] < start[0]  # the scene turns with the hand, so the eye goes the other way
    viewer.viewpoint.reset()
    viewer.drag("middle", 0.5, 0.0)
    # Half a window's height of pan moves the picture by half its height.
    moved = viewer.viewpoint.project(np.array([[0.0, 0.6, 0.0]]), (800, 400))[0]
    assert moved == pytest.approx([600.0, 200.0])


def test_zoom_keys(viewer):
    far = viewer.viewpoint.distance
    viewer.handle_key("w")
    assert viewer.viewpoint.distance < far
    viewer.handle_key("Down")
    assert viewer.viewpoint.distance == pytest.approx(far)


def test_unknown_keys_do_nothing(viewer):
    assert not viewer.handle_key("Tab")


def test_p_saves_a_named_picture_or_says_why_not(viewer, tmp_path):
    viewer.handle_key("p")
    assert viewer.photo
    viewer.save(np.zeros((4, 4, 3), np.uint8))
    assert not viewer.photo and "jello-0.000s.png" in viewer.notice
    assert (tmp_path / "jello-0.000s.png").stat().st_size > 0
    viewer.folder = tmp_path / "missing"
    viewer.save(np.zeros((4, 4, 3), np.uint8))
    assert viewer.notice.startswith("not saved")


def test_help_names_every_key(viewer):
    viewer.update()
    viewer.handle_key("h")
    words = [text.words for text in viewer.sheet((1280, 720), 60.0).texts]
    assert {keys for keys, _ in HELP} <= set(words)
    assert any("60 fps" in w for w in words)


def test_state_is_written(viewer):
    viewer.update()
    viewer.handle_key(" ")
    assert any("paused" in text.words for text in viewer.sheet((1280, 720), 30.0).texts)
