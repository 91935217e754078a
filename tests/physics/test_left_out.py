"""What a scene does not use is neither allocated nor compiled."""

import os
import subprocess
import sys

import pytest

from taichi_jello import Box, Contact, Pin, Plane, Scene, Simulation, UniformField
from taichi_jello.explain import facts

CUBE = Box(points=(3, 3, 3))


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


@pytest.mark.parametrize(
    "feature, scene",
    [
        ("contact", {"collider": [Plane()]}),
        ("drag", {"drag": 0.5}),
        ("uniform field", {"force": [UniformField(force=(0.0, 0.1, 0.0))]}),
        ("pins", {"jello": [Box(points=(3, 3, 3), pin=[Pin(max=(0.0, 1.0, 1.0))])]}),
    ],
)
def test_a_feature_is_listed_where_it_is_used_and_only_there(feature, scene):
    with_it = facts(Simulation(Scene(**{"jello": [CUBE]} | scene)))
    without = facts(Simulation(Scene(jello=[CUBE])))
    assert feature in with_it["compiled_in"] and feature in without["left_out"]
    assert feature not in with_it["left_out"] and feature not in without["compiled_in"]
    if feature in ("contact", "pins"):
        assert feature in with_it["fields"] and feature not in without["fields"]
        assert with_it["bytes"] > without["bytes"]


def test_colliders_that_cannot_push_are_left_out():
    scene = Scene(jello=[CUBE], collider=[Plane()], contact=Contact(stiffness=0.0))
    assert "contact" in facts(Simulation(scene))["left_out"]


def test_one_point_has_no_springs():
    told = facts(Simulation(Scene(jello=[Box(points=(1, 1, 1))])))
    assert "springs" in told["left_out"] and "springs" not in told["fields"]


COMPILED_BYTES = """
import pathlib, sys, tempfile
import taichi as ti
from taichi_jello import Box, Contact, Plane, Room, Scene, Simulation, Sphere, runtime
start = ti.init
ti.init = lambda **options: start(offline_cache_file_path=sys.argv[1], **options)
runtime.start(sys.argv[3])
box = Box(points=(3, 3, 3), position=(0.0, 2.0, 0.0), damping=0.0 if "undamped" in sys.argv[2] else 0.25)
options = {"plain": {}, "undamped": {}, "plane": {"collider": [Plane()]},
    "room": {"collider": [Room()]}, "no friction": {"collider": [Room()], "contact": Contact(friction=0.0)},
    "sphere too": {"collider": [Plane(), Sphere()]}}[sys.argv[2]]
simulation = Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=[box], **options), method="symplectic-euler", substeps=900)
simulation.system.steps(0, 1, 1e-5)
ti.reset()
print(sum(file.stat().st_size for file in pathlib.Path(sys.argv[1]).rglob("*.tic")))
"""


def test_removing_a_feature_removes_its_kernel_code(tmp_path, request):
    """The size of the compiled step, cached alone in an empty folder, falls with every feature left out."""
    size = {}
    for name in ("undamped", "plain", "plane", "sphere too", "no friction", "room"):
        command = [
            sys.executable,
            "-c",
            COMPILED_BYTES,
            str(tmp_path / name),
            name,
            request.config.getoption("--arch"),
        ]
        done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "TI_OFFLINE_CACHE": "1"})
        assert done.returncode == 0, done.stderr
        size[name] = int(done.stdout.split()[-1])
    assert 0 < size["undamped"] < size["plain"] < size["plane"] < size["sphere too"], size
    assert size["plain"] < size["no friction"] < size["room"], size
