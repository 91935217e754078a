"""Taichi started once per module, and a cube standing still."""

import pytest
from still import Still, cube_scene

from taichi_jello import runtime


@pytest.fixture(scope="module", autouse=True)
def started():
    return runtime.start()


@pytest.fixture
def cube():
    return Still(cube_scene())
