"""Taichi started once per module, and a cube standing still."""

import pytest
from person import Person, virtual_screen
from still import Still, cube_scene

from taichi_jello.support import runtime
from taichi_jello.view.window.viewer import Viewer


@pytest.fixture(scope="module", autouse=True)
def started():
    return runtime.start()


@pytest.fixture
def cube():
    return Still(cube_scene())


@pytest.fixture
def viewer(tmp_path):
    return Viewer(Still(cube_scene(points=2)), folder=tmp_path)


@pytest.fixture(scope="module")
def screen():
    server, environment = virtual_screen()
    yield environment
    server.terminate()
    server.wait(10)


@pytest.fixture
def person(screen, tmp_path, request):
    someone = Person(screen, tmp_path, getattr(request, "param", "still"))
    yield someone
    if someone.viewer.poll() is None:
        someone.viewer.kill()
        someone.viewer.wait()
