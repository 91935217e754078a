"""Pictures and films that a person keeps of a play; without a window."""

import av
import numpy as np
import pytest
from still import Still, cube_scene

from taichi_jello.view.window.viewer import Viewer


def test_p_saves_a_named_picture_or_says_why_not(viewer, tmp_path):
    viewer.handle_key("p")
    assert viewer.wants_picture
    viewer.take(np.zeros((4, 4, 3), np.uint8))
    assert not viewer.wants_picture and "jello-0.000s.png" in viewer.notice
    assert (tmp_path / "jello-0.000s.png").stat().st_size > 0
    viewer.handle_key("p")
    viewer.take(np.zeros((4, 4, 3), np.uint8))
    assert "jello-0.000s-2.png" in viewer.notice and len(list(tmp_path.glob("*.png"))) == 2
    viewer.pictures.folder = tmp_path / "missing"
    viewer.handle_key("p")
    viewer.take(np.zeros((4, 4, 3), np.uint8))
    assert viewer.notice.startswith("not saved")


def test_v_films_exact_moments_and_ends_where_the_size_changes(viewer, tmp_path):
    """Thirty frames a second of simulated time, however long drawing takes; an odd window loses a row."""
    viewer.size = (64, 37)
    start = viewer.simulation.time
    viewer.handle_key("v")
    assert viewer.filming
    picture = np.zeros((37, 64, 3), np.uint8)
    for slow in (0.001, 0.5, 0.02):
        assert viewer.advance(slow) == round(1.0 / 30.0 / viewer.simulation.frame_dt)
        viewer.take(picture)
    assert viewer.simulation.time - start == pytest.approx(0.1)
    viewer.handle_key("v")
    assert not viewer.filming and "3 frames" in viewer.notice
    (film,) = tmp_path.glob("*.mp4")
    with av.open(str(film)) as container:
        assert [frame.time for frame in container.decode(video=0)] == pytest.approx([0.0, 1 / 30, 2 / 30])
    viewer.simulation.frame()
    viewer.handle_key("v")
    viewer.take(picture)
    viewer.take(picture[:20])
    assert not viewer.filming and len(list(tmp_path.glob("*.mp4"))) == 2


def test_a_film_lands_where_the_program_was_started(tmp_path, monkeypatch):
    """GGUI shows a picture from another working folder, and films are written meanwhile."""
    monkeypatch.chdir(tmp_path)
    viewer = Viewer(Still(cube_scene(points=2)))
    viewer.size = (64, 36)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    viewer.handle_key("v")
    viewer.take(np.zeros((36, 64, 3), np.uint8))
    viewer.handle_key("v")
    assert len(list(tmp_path.glob("*.mp4"))) == 1
    viewer.handle_key("v")
    viewer.handle_key("v")
    assert viewer.notice == "nothing was filmed" and len(list(tmp_path.glob("*.mp4"))) == 1


def test_a_film_that_cannot_be_is_told(viewer, tmp_path):
    viewer.pictures.folder = tmp_path / "nowhere"
    viewer.handle_key("v")
    assert not viewer.filming and viewer.notice.startswith("no film: ")
