"""N: the demos in turn."""

from dataclasses import replace

import pytest
from still import Still, cube_scene

from taichi_jello.view.window import playlist
from taichi_jello.view.window.playlist import Playlist


@pytest.fixture
def scenes(monkeypatch):
    found = [replace(cube_scene(points=2), title=title) for title in ("first", "broken", "last")]
    monkeypatch.setattr(playlist, "scenes", lambda: found)
    return found


def make(scene):
    if scene.title == "broken":
        raise ValueError(scene.title)
    return Still(scene)


def test_each_demo_is_made_once_and_comes_back_as_it_was(scenes):
    demos = Playlist(make)
    last = demos.following(scenes[0])
    first = demos.following(last.scene)
    assert [last.scene.title, first.scene.title] == ["last", "first"]
    last.tune(stiffness=3.0)
    last.change_method("verlet")
    last.frame()
    assert demos.following(first.scene) is last
    assert (last.time, last.method, last.tuning["stiffness"]) == (0.0, "rk4", 1.0)


def test_a_playlist_without_a_demo_says_so(scenes):
    del scenes[0], scenes[1]
    with pytest.raises(ValueError, match="no demo"):
        Playlist(make).following(cube_scene())
