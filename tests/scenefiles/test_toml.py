"""Scenes written to TOML and read back, and the line that a mistake is in."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from taichi_jello import (
    Box,
    CallableField,
    Camera,
    Contact,
    Grab,
    GravityKeyframe,
    GridField,
    Keyframe,
    Mesh,
    Move,
    Pin,
    Plane,
    Region,
    Room,
    Scene,
    SceneError,
    Solver,
    Sphere,
    UniformField,
    scenefiles,
)
from taichi_jello.scene.keyframes import offset
from taichi_jello.scenefiles import _guide as guide
from taichi_jello.scenefiles._lines import key_lines, line_of
from taichi_jello.scenefiles.toml import dump

GUIDE = Path(scenefiles.__file__).parent / "README.md"
RANDOM = np.random.default_rng(5)
PAINT = RANDOM.random((3, 4, 2))
EVERYTHING = Scene(
    title='A "title" with \\ and\nüber two lines',
    gravity=(0.0, -1.62, 1e-17),
    drag=0.1 + 0.2,
    solver=Solver(method="verlet", dt=1e-4),
    contact=Contact(friction=0.0),
    camera=Camera(color="stiffness"),
    keyframe=[GravityKeyframe(time=0.0, gravity=(0, 0, 0)), GravityKeyframe(time=1 / 3, gravity=(0, 1, 0))],
    collider=[
        Plane(normal=(1.0, 2.0, 3.0), keyframe=[Move(time=1.0, offset=(0.0, 0.1, 0.0))]),
        Room(),
        Sphere(radius=0.1, swing=(0.1, 0.0, 0.0)),
    ],
    jello=[
        Box(),
        Box(
            points=(2, 2, 2),
            springs=("structural",),
            stiffness={"structural": 1e-7, "shear": 1e12},
            pin=[Pin(), Pin(max=(0.0, 1.0, 1.0))],
            region=[
                Region(center=(0, 0, 0), radius=0.5, damping=3.0),
                Region(stiffness_factor=RANDOM.random((3, 4, 2)), mass_factor=2.0),
            ],
            keyframe=[Keyframe(time=0.5), Keyframe(time=1.0, stiffness=0.0, freeze=True)],
            x=RANDOM.random((8, 3)),
        ),
    ],
    force=[
        UniformField(force=(0.0, 0.01, 0.0)),
        UniformField(force=(0.1, 0.01, 0.0)),
        GridField(values=RANDOM.random((2, 3, 4, 3))),
        Grab(limit=3.0),
    ],
)


def test_the_guide_has_all_keys_as_they_are():
    assert guide.text() in GUIDE.read_text(encoding="utf-8")


def test_the_guides_example_begins_with_everything_in_its_place(tmp_path):
    readme = GUIDE.read_text(encoding="utf-8")
    (tmp_path / "scene.toml").write_text(re.search(r"```toml\n(.*?)```", readme, re.S)[1], encoding="utf-8")
    scene = scenefiles.load(str(tmp_path / "scene.toml"))
    moved = [part.keyframe for part in (*scene.collider, *scene.jello[0].pin) if part.keyframe]
    assert len(moved) == 2
    for keyframes in moved:
        assert not np.any(offset(keyframes, 0.0)) and np.any(offset(keyframes, 2.0))


def test_what_is_written_is_read_back_the_same(tmp_path):
    path = str(tmp_path / "scene.toml")
    scenefiles.save(EVERYTHING, path)
    again = scenefiles.load(path)
    for name in ("title", "gravity", "drag", "solver", "contact", "camera", "keyframe", "collider", "jello"):
        assert getattr(again, name) == getattr(EVERYTHING, name), name
    forces = sorted(again.force, key=lambda force: force.key), sorted(EVERYTHING.force, key=lambda force: force.key)
    assert np.array_equal(forces[0][1].values, forces[1][1].values)
    assert forces[0][0] == forces[1][0] and forces[0][2:] == forces[1][2:]
    assert dump(again) == dump(EVERYTHING)


@pytest.mark.parametrize("name", sorted(scenefiles.demos()))
def test_every_demo_survives_the_round_trip(name, tmp_path):
    scene, path = scenefiles.load(name), str(tmp_path / "demo.toml")
    scenefiles.save(scene, path)
    assert scenefiles.load(path) == scene


def test_a_mesh_is_named_as_seen_from_the_file_that_is_written(tmp_path, monkeypatch):
    """A name seen from where Python ran was looked for beside the file, where there was none."""
    mesh, below = tmp_path / "here" / "one.ply", tmp_path / "there" / "meshes"
    mesh.parent.mkdir()
    below.mkdir(parents=True)
    mesh.write_text("")
    monkeypatch.chdir(mesh.parent)
    for file, folder, written in (
        ("one.ply", below.parent, str(mesh)),
        ("one.ply", mesh.parent, "one.ply"),
        (str(below / "two.ply"), below.parent, "meshes/two.ply"),
    ):
        path = folder / "scene.toml"
        scenefiles.save(Scene(jello=[Mesh(file=file)]), str(path))
        assert tomllib.loads(path.read_text())["jello"][0]["file"] == written
        assert scenefiles.load(str(path)).jello[0].file == str(Path(file).absolute())
    moved = tmp_path / "moved"
    below.parent.rename(moved)
    assert scenefiles.load(str(moved / "scene.toml")).jello[0].file == str(moved / "meshes" / "two.ply")


def test_what_toml_cannot_hold_is_refused(tmp_path):
    def wind(x, v, t):
        return x

    class Blob(Box):
        pass

    path = str(tmp_path / "scene.toml")
    for scene, words in (
        (Scene(jello=[Box()], force=[CallableField(function=wind)]), "force.0.function: expected what TOML can hold"),
        (Scene(jello=[Box(region=[Region(damping_factor=np.sin)])]), "jello.0.region.0.damping_factor: expected what"),
        (Scene(jello=[Blob()]), "jello.0: expected one of"),
    ):
        with pytest.raises(SceneError) as caught:
            scenefiles.save(scene, path)
        assert str(caught.value).startswith(f"{path}: {words}")
    with pytest.raises(SceneError, match=r"scene.py: expected a file ending in .toml"):
        scenefiles.save(EVERYTHING, "scene.py")
    with pytest.raises(SceneError, match="cannot be written"):
        scenefiles.save(EVERYTHING, str(tmp_path / "none" / "scene.toml"))


LINES = '''# a comment with [[jello]] in it
title = """
[[jello]]
mass = 3
"""
gravity = [
  0.0, # [[collider]]
  -9.81, 0.0,
]
solver.method = "rk4"
[camera]
eye = [1, 2, 3]
[[collider]]
type = "plane"
[[jello]]
shape = "box"
[[ jello ]]
shape = 'box' # = [
stiffness = {structural = 1.0, shear = 2.0}
[[jello.region]]
stiffness = 3.0
[[jello.region]]
"damping" = 3.0
'''


@pytest.mark.parametrize(
    "key, line",
    [
        ("title", 2),
        ("gravity.1", 6),
        ("solver.method", 10),
        ("camera.eye.0", 12),
        ("camera.fov", 11),
        ("collider.0.normal", 13),
        ("jello.0.shape", 16),
        ("jello.1", 17),
        ("jello.1.stiffness.shear", 19),
        ("jello.1.region.0.stiffness", 21),
        ("jello.1.region.1", 22),
        ("jello.1.region.1.damping", 23),
        ("drag", None),
    ],
)
def test_the_line_of_a_key(key, line):
    assert line_of(LINES, key) == line


def test_no_line_is_taken_for_a_key_that_is_none():
    assert len(key_lines(LINES)) == 20  # with the table that a dotted key makes
    assert len({path for path in key_lines(LINES) if path[-1] == "mass"}) == 0


def test_a_mistake_names_file_line_and_key(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text('[[jello]]\nshape = "box"\n[[jello]]\nshape = "box"\nmass = -1\n')
    with pytest.raises(SceneError) as caught:
        scenefiles.load(str(path))
    assert str(caught.value).startswith(
        f"{path}: line 5: jello.1.mass: expected a finite number greater than 0, got -1"
    )
    path.write_text('[[jello]]\nshape = "box"\n[[jello.keyframe]]\ntime = 2\n[[jello.keyframe]]\ntime = 1\n')
    with pytest.raises(SceneError, match=r"line 6: jello.0.keyframe.1.time: expected more than 2"):
        scenefiles.load(str(path))


def test_a_region_outside_the_body_is_told_with_its_line(jello, tmp_path):
    region = "[[jello.region]]\nmin = [0, 2, 0]\nmax = [1, 3, 1]\n"
    (tmp_path / "scene.toml").write_text(f'title = "x"\n[[jello]]\nshape = "box"\n{region}')
    done = jello("explain", "scene.toml")
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("jello: scene.toml: line 4: jello.0.region.0: expected a part of the body")
    assert done.stderr.count("\n") == 1
