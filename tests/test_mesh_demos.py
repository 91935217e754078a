"""The meshes that come along: closed, small enough, made by their script; and the rabbit stands on its feet."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from taichi_jello import Simulation, scenefiles
from taichi_jello.shapes._meshfiles.reading import flaws, read
from taichi_jello.shapes.mesh import volume
from taichi_jello.support import runtime

MESHES = scenefiles.demos()["rabbit"].parent / "meshes"


@pytest.fixture(scope="module")
def made():
    """The names of the script that makes the meshes."""
    return runpy.run_path(str(MESHES / "make.py"))


@pytest.mark.parametrize("name", ["rabbit", "teapot"])
def test_meshes_are_closed_and_face_outwards(name):
    path = Path(MESHES / f"{name}.ply")
    assert path.stat().st_size < 500_000
    points, triangles = read(str(path))
    assert flaws(points, triangles) == (0, 0) and volume(points, triangles) > 0.0


def test_the_script_makes_the_meshes_that_are_there(made):
    points, triangles = read(str(MESHES / "teapot.ply"))
    mesh = made["teapot"](cuts=12)
    assert len(mesh[1]) == len(triangles)
    assert np.sort(mesh[0], 0) == pytest.approx(np.sort(points, 0), abs=1e-5)
    rabbit, _ = read(str(MESHES / "rabbit.ply"))  # its points are where the script's distance is zero
    assert made["rabbit_distance"](rabbit) == pytest.approx(0.0, abs=1e-4)
    coarse = made["rabbit"](spacing=0.04)
    assert flaws(*coarse)[0] == 0 and volume(*coarse) == pytest.approx(
        volume(*read(str(MESHES / "rabbit.ply"))), rel=0.02
    )


def test_the_teapot_is_newells(made):
    """32 patches and 306 different control points, 12 patches more to close it; the published bounds."""
    turned, tubes = made["revolved_patches"](), [made["tube_patches"](made[name]) for name in ("HANDLE", "SPOUT")]
    own = [p for k, p in enumerate(turned) if k // 4 != 2]  # the third ring closes the gap between lid and rim
    own += [tube[k] for tube in tubes for k in (1, 2, 5, 6)]
    assert len(own) == 32 and len(turned) + sum(map(len, tubes)) == 44
    points, _ = made["teapot"](cuts=6)
    assert points[:, 0].min() == pytest.approx(-3.0) and points[:, 1].max() == pytest.approx(3.15)
    assert points[:, 0].max() == pytest.approx(3.434, abs=0.01) and np.abs(points[:, 2]).max() == pytest.approx(2.0)
    image = points * [1.0, 1.0, -1.0]
    a, b = (p[np.lexsort((p + 1e-7).round(4).T)] for p in (points, image))
    assert a == pytest.approx(b, abs=1e-6)


def test_the_rabbit_stands_on_its_feet(request):
    """The demo's own rabbit on fewer cells, a little above the ground: at rest its lowest point is within 1 % of its
    height of the ground, and its ears are up."""
    runtime.start(request.config.getoption("--arch"), "f32")
    scene = scenefiles.load("rabbit")
    jello = replace(scene.jello[0], resolution=12, position=(0.0, 0.75, 0.0), stiffness=25.0)
    simulation = Simulation(replace(scene, jello=[jello], drag=2.0))
    start = simulation.body.skin_points(simulation.body.rest)
    height, ears = np.ptp(start[:, 1]), np.argsort(start[:, 1])[-50:]
    simulation.advance(3.0)
    points = simulation.body.skin_points(simulation.x)
    assert simulation.energies()["kinetic"] < 1e-3
    assert abs(points[:, 1].min()) < 0.01 * height
    assert points[ears, 1].min() > 0.9 * height
    feet = points[points[:, 1] < 0.01 * height]
    middle = simulation.body.mass @ simulation.x
    assert np.all(feet.min(0)[[0, 2]] < middle[[0, 2]]) and np.all(feet.max(0)[[0, 2]] > middle[[0, 2]])
