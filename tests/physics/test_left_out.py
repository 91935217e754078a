"""What a scene does not use is neither allocated nor compiled."""

import pytest
from taichi.lang.kernel_impl import Func

from taichi_jello import (
    Box,
    CallableField,
    Contact,
    GravityKeyframe,
    Keyframe,
    Move,
    Pin,
    Plane,
    Scene,
    Simulation,
    Sphere,
    UniformField,
)
from taichi_jello.run.explain import facts, text

CUBE = Box(points=(3, 3, 3))


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


@pytest.fixture(scope="module")
def without(taichi):
    return facts(Simulation(Scene(jello=[CUBE])))


@pytest.mark.parametrize(
    "feature, scene",
    [
        ("contact", {"collider": [Plane()]}),
        ("sweep", {"collider": [Sphere(center=(0.0, -2.0, 0.0))]}),
        ("drag", {"drag": 0.5}),
        ("uniform field", {"force": [UniformField(force=(0.0, 0.1, 0.0))]}),
        ("keyframes of jellos", {"jello": [Box(points=(3, 3, 3), keyframe=[Keyframe(time=1.0, stiffness=0.5)])]}),
        ("keyframes of gravity", {"keyframe": [GravityKeyframe(time=0.0, gravity=(0.0, 0.0, 0.0))]}),
        ("handles", {"jello": [Box(points=(3, 3, 3), pin=[Pin(keyframe=[Move(time=0.0, offset=(0, 0, 0))])])]}),
        ("creep", {"jello": [Box(points=(3, 3, 3), creep=1.0)]}),
        ("yield", {"jello": [Box(points=(3, 3, 3), yield_strain=1.0)]}),
        ("tearing", {"jello": [Box(points=(3, 3, 3), tear_strain=1.0)]}),
        ("volume", {"jello": [Box(points=(3, 3, 3), volume=1.0)]}),
        ("pins", {"jello": [Box(points=(3, 3, 3), pin=[Pin(max=(0.0, 1.0, 1.0))])]}),
    ],
)
def test_a_feature_is_listed_where_it_is_used_and_only_there(feature, scene, without):
    with_it = facts(Simulation(Scene(**{"jello": [CUBE]} | scene)))
    assert feature in with_it["compiled_in"] and feature in without["left_out"]
    assert feature not in with_it["left_out"] and feature not in without["compiled_in"]
    if feature in ("contact", "sweep", "pins", "volume"):
        assert feature in with_it["fields"] and feature not in without["fields"]
        assert with_it["bytes"] > without["bytes"]


def test_colliders_that_cannot_push_are_left_out():
    scene = Scene(jello=[CUBE], collider=[Plane()], contact=Contact(stiffness=0.0))
    assert "contact" in facts(Simulation(scene))["left_out"]


def pull(x, v, t):
    return -x


def test_forces_that_an_implicit_solve_does_not_see_are_named():
    fields = [CallableField(function=pull), UniformField(force=(0.1, 0.0, 0.0))]
    scene = Scene(jello=[CUBE], drag=0.1, force=fields)
    told = facts(Simulation(scene, method="backward-euler"))
    assert told["unseen"] == ["callable field"]  # a constant one has no slope
    assert "callable field: taken where the step ends, its slope unseen by the solve" in text(told)
    assert facts(Simulation(scene, method="rk4"))["unseen"] == []


def test_one_point_has_no_springs():
    told = facts(Simulation(Scene(jello=[Box(points=(1, 1, 1))])))
    assert "springs" in told["left_out"] and "springs" not in told["fields"]


SCENES = {
    "undamped": {"jello": [Box(points=(3, 3, 3), damping=0.0)]},
    "plain": {},
    "no friction": {"collider": [Plane()], "contact": Contact(friction=0.0)},
    "plane": {"collider": [Plane()]},
    "sphere too": {"collider": [Plane(), Sphere()]},
}


def inlined(monkeypatch, method, **options):
    """The names of the Taichi functions that the compiled step of a scene consists of."""
    found, call = set(), Func.__call__

    def note(self, *args, **kwargs):
        if self.func.__module__.startswith("taichi_jello"):
            found.add(f"{self.func.__module__.rpartition('.')[2]}.{self.func.__name__}")
        return call(self, *args, **kwargs)

    scene = Scene(**{"gravity": (0.0, 0.0, 0.0), "jello": [Box(points=(3, 3, 3))]} | options)
    simulation = Simulation(scene, method=method, substeps=900)
    with monkeypatch.context() as patch:
        patch.setattr(Func, "__call__", note)
        simulation.step()
    return found


@pytest.mark.parametrize("method", ["symplectic-euler", "rk4"])
def test_only_what_a_scene_needs_is_compiled(method, monkeypatch, best_precision):
    code = {name: inlined(monkeypatch, method, **options) for name, options in SCENES.items()}
    assert "hooke.hooke" in code["undamped"]
    assert code["plain"] - code["undamped"] == {"hooke.dashpot"}
    assert code["no friction"] - code["plain"] >= {"collider_penalty.pressure", "plane.signed_distance"}
    friction = {f"friction.{name}" for name in ("friction_force", "cone", "stretch", "follow", "let_go")}
    assert code["plane"] - code["no friction"] == friction | {"collider_penalty.hold", "collider_penalty.end_step"}
    sweep = {f"continuous_collision.{name}" for name in ("stop", "first_entry", "correction", "forget")}
    swept = {"sphere.core_entry"} | sweep
    assert code["sphere too"] - code["plane"] == {"sphere.signed_distance"} | swept
    assert not any(name.startswith(("gravity.", "drag.", "field.")) for names in code.values() for name in names)
