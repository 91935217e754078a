"""Scene files: the whole TOML language, Python scenes, demos, and one clear line for every mistake."""

import pytest

from taichi_jello import Box, Grab, Plane, Room, Scene, SceneError, Sphere, UniformField, scenefiles
from taichi_jello.scene.override import override
from taichi_jello.scenefiles._table import changed

EVERYTHING = """
title = "Cube on a sphere"
gravity = [0.0, -1.62, 0.0]
drag = 0.1
seconds = 2.5
[solver]
method = "verlet"
dt = 0.0001
frame_dt = 0.02
[contact]
stiffness = 1000.0
damping = 0.25
friction = 0.5
[camera]
eye = [3.0, 2.0, 1.0]
target = [0.0, 0.0, 0.0]
fov = 30
color = "strain"
[uniform_field]
force = [0.0, 0.01, 0.0]
[[collider]]
type = "plane"
point = [0.0, -1.0, 0.0]
normal = [0.0, 2.0, 0.0]
[[collider]]
type = "box"
min = [-2.0, -1.0, -2.0]
max = [2.0, 4.0, 2.0]
[[collider]]
type = "sphere"
center = [0.0, 0.5, 0.0]
radius = 0.25
velocity = [0.1, 0.0, 0.0]
[[jello]]
shape = "box"
points = [4, 5, 6]
size = [1.0, 1.0, 1.0]
position = [0.0, 1.5, 0.0]
rotation = [0.0, 0.0, 30.0]
velocity = [1.0, 0.0, 0.0]
spin = [0.0, 1.0, 0.0]
mass = 2.0
springs = ["structural", "shear"]
stiffness = {structural = 300.0, shear = 100.0}
damping = 0.125
[[jello.pin]]
min = [0.0, 1.0, 0.0]
[[jello]]
shape = "box"
"""


def written(tmp_path, text, name="scene.toml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_toml_says_everything(tmp_path):
    scene = scenefiles.load(written(tmp_path, EVERYTHING))
    assert scene.title == "Cube on a sphere" and scene.gravity == (0.0, -1.62, 0.0) and scene.seconds == 2.5
    assert scene.solver.method == "verlet" and scene.solver.dt == 1e-4 and scene.solver.frame_dt == 0.02
    assert scene.contact.friction == 0.5 and scene.camera.fov == 30.0 and scene.camera.color == "strain"
    plane, room, sphere = scene.collider
    assert isinstance(plane, Plane) and plane.normal == (0.0, 1.0, 0.0)
    assert isinstance(room, Room) and isinstance(sphere, Sphere) and sphere.velocity == (0.1, 0.0, 0.0)
    first, second = scene.jello
    assert first.points == (4, 5, 6) and first.stiffness == {"structural": 300.0, "shear": 100.0}
    assert first.pin[0].min == (0.0, 1.0, 0.0) and second == Box()
    assert scene.force[0].force == (0.0, 0.01, 0.0)


BOX = '[[jello]]\nshape = "box"\n'


@pytest.mark.parametrize(
    "text, words",
    [
        ("", "jello: expected at least one jello"),
        ("gravity = [0, 1]\n" + BOX, "gravity: expected three numbers"),
        ("gravity = [0, nan, 0]\n" + BOX, "gravity.1: expected a finite number, got nan"),
        ("sunshine = 3\n" + BOX, "sunshine: unknown key"),
        ("[[force]]\ntype = 'wind'\n" + BOX, "force: unknown key, expected one of"),
        ("drag = -1\n" + BOX, "drag: expected a finite number of at least 0, got -1"),
        ("seconds = true\n" + BOX, "seconds: expected a finite number"),
        ("[solver]\nmethd = 'rk4'\n" + BOX, "solver.methd: unknown key"),
        ("[solver]\ndt = 0\n" + BOX, "solver.dt: expected a finite number greater than 0"),
        ("[solver]\ndt = 'fast'\n" + BOX, 'solver.dt: expected "auto" or seconds'),
        ("[contact]\nstiffness = -2\n" + BOX, "contact.stiffness: expected a finite number of at least 0"),
        ("[camera]\nfov = 200\n" + BOX, "camera.fov: expected less than 180"),
        ("[[jello]]\nmass = 1", "jello.0.shape: expected one of"),
        ("[[jello]]\nshape = 'cone'", "jello.0.shape: expected one of"),
        (BOX + "mass = 0", "jello.0.mass: expected a finite number greater than 0, got 0"),
        (BOX + "mas = 1", "jello.0.mas: unknown key"),
        (BOX + "points = [0, 8, 8]", "jello.0.points.0: expected a whole number of at least 1, got 0"),
        (BOX + "stiffness = -3", "jello.0.stiffness: expected a finite number of at least 0, got -3"),
        (BOX + "[[jello.pin]]\nmin = [2, 2, 2]", "jello.0.pin.0.max: expected at least min"),
        (BOX + "[[collider]]\ntype = 'torus'", "collider.0.type: expected one of"),
        (BOX + "[[collider]]\ntype = 'plane'\nnormal = [0, 0, 0]", "collider.0.normal: expected a direction"),
        (
            BOX + "[[collider]]\ntype = 'sphere'\nradius = 0",
            "collider.0.radius: expected a finite number greater",
        ),
        (
            BOX + "[[collider]]\ntype = 'box'\nmin = [1, 1, 1]\nmax = [0, 2, 2]",
            "collider.0.max: expected more than min",
        ),
        (BOX + "[uniform_field]\n", "uniform_field: expected force too, which is missing"),
        (BOX + "[grid_field]\nvalues = [1, 2]\n", "grid_field.values: expected x by y by z by 3"),
        ("[contact]\nstiffness = 1e200\n" + BOX, "contact.stiffness: expected a finite number of at least 0, at most"),
        ("drag = 1e300\n" + BOX, "drag: expected a finite number of at least 0, at most 1e+12, got 1e+300"),
        ("gravity = [0, -1e300, 0]\n" + BOX, "gravity.1: expected a finite number, at most 1e+12 either way, got -1"),
        ("[camera]\neye = [1e300, 0, 0]\n" + BOX, "camera.eye.0: expected a finite number, at most 1e+12 either way"),
        (BOX + "position = [0, 1e300, 0]", "jello.0.position.1: expected a finite number, at most 1e+12"),
        (BOX + "velocity = [0, 1e30, 0]", "jello.0.velocity.1: expected a finite number, at most 1e+07"),
        (BOX + f"mass = 1{'0' * 400}", "jello.0.mass: expected a finite number greater than 0, at most 1e+12, got one"),
        (BOX + "mass = 1e-300", "jello.0.mass: expected a finite number greater than 0, at least 1e-12, got 1e-300"),
        (
            BOX + "stiffness = {shear = 1e300}",
            "jello.0.stiffness.shear: expected a finite number of at least 0, at",
        ),
        (BOX + "damping = 1e200", "jello.0.damping: expected a finite number of at least 0, at most 1e+12"),
        (BOX + "x = [[1e300, 0, 0]]", "jello.0.x: expected numbers of at most 1e+12 either way, got 1e+300"),
        (BOX + "[[jello.region]]\nmass_factor = [[[1e300]]]", "mass_factor: expected numbers of at most 1e+12, got"),
        ("[solver]\nframe_dt = 1e-300\n" + BOX, "solver.frame_dt: expected a finite number greater than 0, at least"),
        (BOX + "young = 2000\nstiffness = 200", "jello.0.young: expected either young or stiffness, got both"),
        (BOX + "density = 500\nmass = 2", "jello.0.density: expected either density or mass, got both"),
        (BOX + "damping_ratio = 0.1\ndamping = 1", "jello.0.damping_ratio: expected either damping_ratio or damping"),
        (BOX + "[[jello.region]]\ncenter = [0, 0, 0]", "jello.0.region.0.center: expected a radius beside it"),
        (BOX + "[[jello.region]]\nradius = 0.5\nmax = [1, 1, 0.5]", "jello.0.region.0.radius: expected either a box"),
        (BOX + "[[jello.keyframe]]\nstiffness = 1", "line 3: jello.0.keyframe.0: expected time too, which is missing"),
        ("jello = 3", "jello: expected an array of tables"),
        ("jello = [", "not valid TOML"),
        (
            "\n" + BOX + "mass = 0x" + "f" * 20_000,
            "line 4: jello.0.mass: expected a finite number greater than 0, at most",
        ),
        ("\n" + BOX + "mass = 1" + "0" * 4400, "line 4: expected numbers of fewer digits"),
        ("\nx = " + "[" * 2000 + "]" * 2000, "line 2: expected values that are not nested so deeply"),
        ("\n" + "a." * 3000 + "b = 1", "line 2: "),
        ('\n"a\\nb\\u001b[2J" = 1\n' + BOX, r"line 2: a\nb\x1b[2J: unknown key"),
        (BOX + f"mass = '{'z' * 200_000}'", f"got '{'z' * 59}…"),
        (BOX + f"points = {list(range(5000))}", "line 3: jello.0.points: expected three whole numbers, got [0, 1, 2"),
        ("k" * 5000 + " = 1\n" + BOX, f"line 1: {'k' * 200}…: unknown key"),
        (BOX + "x = [[1" + "0" * 400 + ", 0, 0]]", "line 3: jello.0.x: expected a list of [x, y, z]"),
    ],
)
def test_every_mistake_names_file_key_and_what_was_expected(tmp_path, text, words):
    path = written(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        scenefiles.load(path)
    assert str(caught.value).startswith(f"{path}: ") and words in str(caught.value)
    assert str(caught.value).isprintable() and len(str(caught.value).removeprefix(path)) < 600


def test_endings_may_be_upper_case(tmp_path):
    assert scenefiles.load(written(tmp_path, BOX, "A.TOML")).jello == (Box(),)
    text = "from taichi_jello import *\ndef scene(): return Scene(jello=[Box()])\n"
    assert scenefiles.load(written(tmp_path, "\ufeff" + text, "A.PY")) == Scene(jello=[Box()])
    with pytest.raises(SceneError, match=r"B.TOML: line 1: x: unknown key"):
        scenefiles.load(written(tmp_path, "x = 1", "B.TOML"))
    scenefiles.save(Scene(jello=[Box(mass=2.0)]), str(tmp_path / "C.TOML"))
    assert scenefiles.load(str(tmp_path / "C.TOML")).jello[0].mass == 2.0


def test_a_mark_of_the_order_of_bytes_is_no_mistake(tmp_path):
    path = tmp_path / "notepad.toml"
    path.write_text(BOX + "mass = 2", encoding="utf-8-sig")
    assert scenefiles.load(str(path)).jello[0].mass == 2.0
    path.write_text("mass = 2\n" + BOX, encoding="utf-8-sig")
    with pytest.raises(SceneError, match="line 1: mass: unknown key"):
        scenefiles.load(str(path))


def test_python_scenes_and_their_mistakes(tmp_path):
    good = "from taichi_jello import *\ndef scene():\n    return Scene(jello=[Box()])\n"
    assert scenefiles.load(written(tmp_path, good, "good.py")) == Scene(jello=[Box()])
    for text, words in (
        ("x = 1", "scene: expected a function scene()"),
        ("def scene(): return 3", "expected scene() to return a Scene, got 3"),
        ("def scene(): return 1 / 0", "line 1: it fails with ZeroDivisionError"),
        ("import nothing_like_this", "it fails with ModuleNotFoundError"),
        ("from taichi_jello import *\ndef scene(): return Scene(jello=[Box(mass=-1)])", "line 2: mass: expected"),
        ("def scene(", "line 1: it fails with SyntaxError"),
        ("class E(BaseException): pass\ndef scene(): raise E('x')", "line 2: it fails with E: x"),
        ("raise GeneratorExit", "line 1: it fails with GeneratorExit"),
        ("class E(Exception):\n  def __str__(self): return 1 / 0\nraise E", "line 3: it fails with E, whose message"),
        ("class A:\n  def __repr__(self): 1 / 0\ndef scene(): return A()", "line 3: scene: expected scene() to return"),
        (
            "from taichi_jello import *\n"
            "def scene(): return Scene(jello=[Box()], force=[CallableField(function=lambda x, v, t: x)])",
            "line 2: function: expected a function defined with def, Taichi compiles no lambda",
        ),
        (
            "import json\ndef scene():\n  return json.loads('x')",
            "line 3: it fails with JSONDecodeError: Expecting",
        ),
        ("import sys\ndef scene():\n  sys.exit(5)", "line 3: it fails with SystemExit: 5"),
    ):
        with pytest.raises(SceneError, match=words.replace("(", r"\(").replace(")", r"\)")):
            scenefiles.load(written(tmp_path, text, "bad.py"))


def test_files_that_are_not_there_or_not_known(tmp_path):
    for name, words in (
        ("nothing.toml", "there is no such file"),
        ("cake", "expected a demo ("),
        ("a.stl", "ending in"),
    ):
        with pytest.raises(SceneError) as caught:
            scenefiles.load(name)
        assert name in str(caught.value) and words in str(caught.value)


def test_demos_load_and_say_what_they_are():
    assert {"cube", "sphere", "room", "family"} <= set(scenefiles.demos())
    for name, path in scenefiles.demos().items():
        assert isinstance(scenefiles.load(name), Scene)
        assert 20 < len(scenefiles.describe(path)) < 130


def test_override_reaches_every_key():
    scene = Scene(jello=[Box(), Box()], collider=[Plane()])
    changed = override(scene, ["jello", "1", "stiffness"], 300)
    assert changed.jello[1].stiffness == 300.0 and changed.jello[0] == scene.jello[0]
    assert override(scene, ["solver", "method"], "verlet").solver.method == "verlet"
    assert override(scene, ["gravity"], [0, 0, 0]).gravity == (0.0, 0.0, 0.0)
    for path, words in (
        (["jello", "2", "mass"], "jello.2: expected an index from 0 to 1"),
        (["jello", "0", "mas"], "jello.0.mas: unknown key"),
        (["jello", "0", "mass"], "jello.0.mass: expected a finite number"),
        (["title", "x"], "title.x: unknown key"),
        (["jello"], "jello: expected a list of Jello, got 'heavy'"),
        (["collider"], "collider: expected a list of Collider, got 'heavy'"),
        (["solver"], "solver: expected a Solver, got 'heavy'"),
        (["camera"], "camera: expected a Camera, got 'heavy'"),
    ):
        with pytest.raises(SceneError) as caught:
            override(scene, path, "heavy")
        assert str(caught.value).startswith(words)
    with pytest.raises(SceneError, match="jello: expected a list of Jello, got 3"):
        override(scene, ["jello"], 3)


def test_what_is_set_goes_over_what_said_the_same_in_another_way():
    scene = Scene(jello=[Box(stiffness=50.0)])
    scene = override(scene, ["jello", "0", "young"], 3000)
    assert scene.jello[0].young == 3000.0 and scene.jello[0].stiffness == Box.stiffness
    scene = override(scene, ["jello", "0", "stiffness", "shear"], 7)
    assert scene.jello[0].young is None and scene.jello[0].stiffness["shear"] == 7.0


def test_a_force_is_set_by_the_name_that_files_have():
    scene = Scene(jello=[Box()], force=[Grab()])
    once = changed(scene, ["uniform_field", "force"], [0.01, 0, 0])
    assert once.force == (Grab(), UniformField(force=(0.01, 0.0, 0.0)))
    assert changed(once, ["uniform_field", "force", "1"], 2).force[1].force == (0.01, 2.0, 0.0)
    assert changed(once, ["uniform_field"], {"force": [1, 0, 0]}).force[1].force == (1.0, 0.0, 0.0)
    assert changed(scene, ["drag"], 0.5).drag == 0.5
    for path, words in (
        (["uniform_field", "x"], "uniform_field.x: unknown key, expected one of force"),
        (["uniform_field"], "uniform_field: expected a table, got 3"),
        (["sunshine"], "sunshine: unknown key, expected one of title, gravity,"),
    ):
        with pytest.raises(SceneError) as caught:
            changed(scene, path, 3)
        assert str(caught.value).startswith(words) and " force," not in str(caught.value)
