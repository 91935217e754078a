"""What is told of scenes that run, but hardly as they are meant."""

import re
import warnings
from dataclasses import replace

import pytest

from taichi_jello import (
    Block,
    Box,
    Contact,
    GravityKeyframe,
    Keyframe,
    Move,
    Pin,
    Plane,
    Rope,
    Scene,
    SceneWarning,
    Sheet,
    Simulation,
    Sphere,
    scenefiles,
)
from taichi_jello.run.assembly import assembled
from taichi_jello.run.checks import start_warnings

FALLING = {"collider": [Plane()]}
HARD = Contact(stiffness=2000.0, damping=0.5)


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def told(scene):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", SceneWarning)
        Simulation(scene, method="symplectic-euler").frame()
    return [str(warning.message) for warning in found if issubclass(warning.category, SceneWarning)]


def test_a_jello_too_heavy_for_its_contact_springs():
    """2000 kg on a sixth of the 296 points of its surface, 2000 N/m each."""
    heavy = Box(position=(0.0, 0.5, 0.0), mass=2000.0, stiffness=1e5)
    (words,) = told(Scene(jello=[heavy], contact=HARD, **FALLING))
    assert words.startswith("jello.0: 2e+03 kg on contact springs of 2000 N/m sinks in by about 0.2 m")
    assert "contact.stiffness = 4e+04 would carry it" in words
    assert not told(Scene(jello=[heavy], contact=Contact(stiffness=4e4), **FALLING))
    assert not told(Scene(jello=[heavy], **FALLING))  # by default it is as hard as the jello
    assert not told(Scene(jello=[heavy], contact=HARD))  # there is nothing to sink into


def test_jellos_that_are_thrown_out_of_where_they_begin():
    small = {"points": (3, 3, 3), "position": (0.0, 0.3, 0.0)}
    (words,) = told(Scene(jello=[Box(**small)], **FALLING))
    assert words.startswith("jello.0 begins 0.2 m deep in collider.0, a plane")
    sheets = [Sheet(points=(5, 5), size=(1.0, 1.0), position=(0.0, y, 0.0)) for y in (1.0, 1.05)]
    assert len(told(Scene(jello=sheets, contact=HARD))) == 2
    rope = Rope(points=9, length=1.0, position=(0.0, 3.0, 0.0))  # crossed ropes throw each other's middles apart
    crossed = replace(rope, rotation=(0.0, 80.0, 0.0), pin=[Pin(max=(0.0, 1.0, 1.0))])
    assert len(told(Scene(jello=[rope, crossed], contact=HARD))) == 2
    held, moved = (
        Pin(min=(0, 1, 0)),
        Pin(min=(0, 1, 0), keyframe=[Move(time=0.0, offset=(0, 0, 0)), Move(time=1.0, offset=(0, 1, 0))]),
    )
    assert told(Scene(jello=[Box(**small, pin=[held])], **FALLING))
    turned = [GravityKeyframe(time=0.0, gravity=(0.0, 300.0, 0.0))]
    for scene in (
        Scene(jello=[Box(points=(3, 3, 3), position=(0.0, 0.6, 0.0), velocity=(0.0, -8.0, 0.0))], **FALLING),
        Scene(jello=[Box(**small, pin=[moved])], **FALLING),
        Scene(jello=[Box(**small, keyframe=[Keyframe(time=0.0, rest_length=0.5)], pin=[held])], **FALLING),
        Scene(jello=[Box(points=(3, 3, 3), position=(0.0, 2.0, 0.0))], keyframe=turned, **FALLING),
    ):
        assert not told(scene)


def test_it_is_told_at_the_beginning_only():
    sheets = [Sheet(points=(5, 5), size=(1.0, 1.0), position=(0.0, y, 0.0)) for y in (1.0, 1.05)]
    simulation = Simulation(Scene(jello=sheets, contact=HARD))
    later = simulation.snapshot()
    with pytest.warns(SceneWarning):
        simulation.frame()
    simulation.restore(later)
    with warnings.catch_warnings():
        warnings.simplefilter("error", SceneWarning)
        simulation.frame()
    simulation.reset()
    with pytest.warns(SceneWarning):
        simulation.frame()


def told_of_colliders(jello, collider):
    scene = Scene(jello=[jello], collider=[collider])
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", SceneWarning)
        start_warnings.on_colliders(scene, assembled(scene))
    return [str(warning.message) for warning in found]


def test_what_begins_in_a_collider_is_told_with_its_depth_and_the_way_out():
    """Raised by what is advised, nothing is told; what is at the side of a pillar has a nearer way out."""
    slope, ball, pillar = Plane(normal=(0.0, 1.0, 0.5)), Sphere(radius=0.6), Block(size=(1.0, 9.0, 1.0))
    for collider, x in ((Plane(), 0.0), (slope, 0.0), (ball, 0.0), (pillar, 0.9)):
        jello = Box(points=(3, 3, 3), position=(x, 0.3, 0.0))
        (words,) = told_of_colliders(jello, collider)
        depth = -collider.distance(assembled(Scene(jello=[jello])).x).min()
        begins = f"jello.0 begins {depth:.3g} m deep in collider.0, a {collider.type}, and is thrown out: "
        assert words.startswith(begins)
        advised = words.removeprefix(begins)
        if collider is pillar:
            assert advised == "move it 0.101 m away"
            continue
        rise = float(re.fullmatch(r"raise position\.y by (\S+)", advised)[1])
        assert not told_of_colliders(replace(jello, position=(x, 0.3 + rise, 0.0)), collider)
    held = Box(points=(3, 3, 3), position=(0.0, 0.3, 0.0), pin=[Pin(max=(1, 0, 1))])
    assert not told_of_colliders(held, Plane())


@pytest.mark.parametrize("name", ["bridge", "crowd", "rabbit", "stack"])
def test_no_demo_is_told_of(name):
    assert not told(scenefiles.load(name))
