"""Every Taichi function of the physics, called alone from a small kernel."""

import numpy as np
import pytest
import taichi as ti
from reference import read

from taichi_jello import Box, CallableField, GridField, Plane, Room, Scene, SceneError, Simulation, Sphere
from taichi_jello.physics.colliders import plane, sphere
from taichi_jello.physics.forces.collider_contact import collider_penalty, friction
from taichi_jello.physics.forces.springs import hooke
from taichi_jello.support import runtime


def call(function, *arguments, length=0):
    """The value of a Taichi function of numbers and sequences; `length` of the vector it returns, 0 for a number."""
    wide = runtime.current().arch not in ("vulkan", "metal")
    out = np.zeros(max(length, 1), np.float64 if wide else np.float32)
    packed = [ti.Vector(list(a)) if np.ndim(a) else a for a in arguments]

    @ti.kernel
    def run(out: ti.types.ndarray(ndim=1)):
        value = function(*packed)
        if ti.static(length == 0):
            out[0] = value
        else:
            for axis in ti.static(range(length)):
                out[axis] = value[axis]

    run(out)
    return out if length else out[0]


@pytest.fixture(scope="module", autouse=True)
def taichi(precision):
    return precision


def test_hooke_is_the_springs_law(epsilon):
    k, rest = 200.0, 0.5
    for length in (0.25, 0.5, 0.8, 3.0):
        factor = call(hooke.hooke, 1.0 / length, k, rest)
        assert factor * length == pytest.approx(k * (length - rest), abs=8 * epsilon * k)


def test_dashpot_damps_only_along_the_spring(epsilon):
    d, c = np.array([0.3, -0.4, 1.2]), 0.25
    n = d / np.linalg.norm(d)
    w = np.array([1.0, 2.0, -0.5])
    force = call(hooke.dashpot, 1.0 / np.linalg.norm(d), d, w, c) * d
    assert force == pytest.approx(c * w.dot(n) * n, abs=8 * epsilon)
    across = np.cross(d, [1.0, 0.0, 0.0])
    assert call(hooke.dashpot, 1.0 / np.linalg.norm(d), d, across, c) == pytest.approx(0.0, abs=8 * epsilon)


def test_pressure_never_pulls(epsilon):
    assert call(collider_penalty.pressure, 0.01, 0.0, 2000.0, 0.5) == pytest.approx(20.0, rel=8 * epsilon)
    assert call(collider_penalty.pressure, 0.01, -2.0, 2000.0, 0.5) == pytest.approx(21.0, rel=8 * epsilon)
    assert call(collider_penalty.pressure, 0.01, 100.0, 2000.0, 0.5) == 0.0


def test_friction_is_coulombs_when_sliding_and_a_damped_spring_at_rest(epsilon):
    mu, stiffness, grip = 0.4, 50.0, 2.0

    def force(pressed, stretch, slide):
        return call(friction.friction_force, pressed, stretch, slide, mu, stiffness, grip, length=3)

    none = [0.0, 0.0, 0.0]
    assert force(3.0, [1e-3, 0.0, 0.0], [500.0, 0.0, 0.0]) == pytest.approx([-1.2, 0.0, 0.0], rel=8 * epsilon)
    assert force(3.0, none, [0.0, 1e-4, 0.0]) == pytest.approx([0.0, -2e-4, 0.0], rel=8 * epsilon)
    assert force(3.0, [0.0, 0.0, 0.01], none) == pytest.approx([0.0, 0.0, -0.5], rel=8 * epsilon)
    assert np.all(force(0.0, [0.01, 0.0, 0.0], none) == 0.0)


def test_signed_distance_of_a_plane(epsilon):
    normal = np.array([1.0, 2.0, -2.0]) / 3.0
    touch = call(plane.signed_distance, [0.5, 0.25, 1.0], [*normal, 0.0], length=4)
    assert touch == pytest.approx([*normal, normal.dot([0.5, 0.25, 1.0])], abs=8 * epsilon)


def test_signed_distance_of_a_sphere_even_at_its_centre(epsilon):
    touch = call(sphere.signed_distance, [0.0, 0.3, 0.4], [0.0, 0.0, 0.0, 0.8], length=4)
    assert touch == pytest.approx([0.0, 0.6, 0.8, -0.3], abs=8 * epsilon)
    assert list(call(sphere.signed_distance, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.5], length=4)) == [
        0,
        1,
        0,
        -0.5,
    ]


def test_every_collider_has_its_own_surfaces():
    assert Plane(normal=(0.0, 3.0, 4.0)).normal == pytest.approx((0.0, 0.6, 0.8))
    rows = Room(min=(-1.0, 0.0, -2.0), max=(1.0, 3.0, 2.0)).rows(0.0, 1.0)
    inside, outside = np.array([0.5, 1.0, 0.0]), np.array([0.5, -1.0, 0.0])
    distance = [np.min(np.einsum("ij,ij->i", p - rows[:, :3], rows[:, 6:9])) for p in (inside, outside)]
    assert distance == pytest.approx([0.5, -1.0])
    moving = Sphere(center=(1.0, 0.0, 0.0), velocity=(2.0, 0.0, 0.0), radius=0.25).rows(0.5, 1.0)
    assert moving[0] == pytest.approx([2.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25])


def test_runge_kutta_stages_in_nystroems_form(epsilon):
    """RK4 evaluates stage 1 at x + dt/2 v and v + dt/2 g, and stage 2 at x + dt/2 v + dt²/4 g and the same v."""
    scene = Scene(jello=[Box(points=(1, 1, 1), velocity=(1.0, 2.0, 3.0))])
    system = Simulation(scene, method="rk4").system
    scheme, dt = system.integrator, 0.1

    @ti.kernel
    def begin():
        scheme.begin(system, 0, system.count, 0.0)

    @ti.kernel
    def stage(s: int):
        scheme.stage(system, 0, system.count, s, 0.0, dt)

    begin()
    v, g = np.array([1.0, 2.0, 3.0]), np.array([0.0, -9.81, 0.0])
    for s, x in enumerate((v * dt / 2, v * dt / 2 + g * dt * dt / 4)):
        stage(s)
        at = [read(system.memory, field)[0] for field in (scheme.at.x, scheme.at.v, scheme.acceleration)]
        assert at[0] == pytest.approx(x, abs=8 * epsilon)
        assert at[1] == pytest.approx(v + g * dt / 2, abs=32 * epsilon)
        assert at[2] == pytest.approx(g, rel=8 * epsilon)


def test_grid_field_is_trilinear_and_its_last_index_is_z(epsilon):
    """A field that is linear in x, y and z is reproduced exactly between the nodes."""
    axes = [np.linspace(-1.0, 1.0, n) for n in (3, 4, 5)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    values = np.stack([x + 2.0 * y, z * x, 1.0 + y - z], -1)
    field = GridField(values=values, min=(-1.0, -1.0, -1.0), max=(1.0, 1.0, 1.0))
    system = Simulation(Scene(jello=[Box(points=(1, 1, 1))], force=[field])).system
    force = next(f for f in system.all_forces if f.title == "grid field")
    for p in ([0.1, -0.7, 0.35], [-1.0, 1.0, 0.0], [0.99, 0.99, -0.99]):
        expected = [p[0] + 2 * p[1], p[2] * p[0], 1 + p[1] - p[2]]
        assert call(force.at, p, length=3) == pytest.approx(expected, abs=16 * epsilon)
    assert call(force.at, [5.0, 0.0, 0.0], length=3) == pytest.approx(call(force.at, [1.0, 0.0, 0.0], length=3))


def flat(x, v, t):
    return ti.Vector([1.0, 2.0])


def strength(x, v, t):
    return 1.0


def unknown(x, v, t):
    return x * windy  # noqa: F821


@pytest.mark.parametrize(
    "function, told",
    [
        (flat, "returns a 3-vector, got an array of shape (2,)"),
        (strength, "returns a 3-vector, got none"),
        (unknown, 'expected what Taichi compiles: Name "windy" is not defined'),
    ],
)
def test_a_force_that_is_no_vector_is_told(function, told):
    """Added to the other forces it would end the process."""
    scene = Scene(jello=[Box(points=(2, 1, 1))], force=[CallableField(function=function)])
    with pytest.raises(SceneError) as raised:
        Simulation(scene)
    assert raised.value.key == "force.0.function" and told in raised.value.problem


def test_a_force_without_source_is_told():
    names = {}
    exec("def wind(x, v, t): return 0.1 * x", names)  # as in `python -c`
    scene = Scene(jello=[Box(points=(2, 1, 1))], force=[CallableField(function=names["wind"])])
    with pytest.raises(SceneError, match="expected a function in a file or a notebook") as raised:
        Simulation(scene)
    assert raised.value.key == "force.0.function" and "\n" not in str(raised.value)


def test_a_force_of_other_arguments_is_told():
    def short(x, v):
        return x

    def long(x, v, t, u):
        return x

    for function, told in ((short, "too many"), (long, "missing a required argument: 'u'")):
        with pytest.raises(SceneError, match=f"function: expected a function of x, v and t: {told}"):
            CallableField(function=function)
