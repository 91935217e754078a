"""Clock, restart, divergence and the life of a Taichi start."""

import warnings

import numpy as np
import pytest

from taichi_jello import (
    Box,
    CallableField,
    Contact,
    Diverged,
    Grab,
    Plane,
    Room,
    Scene,
    SceneError,
    Simulation,
    Snapshot,
    Solver,
    Sphere,
    UniformField,
)
from taichi_jello.physics.integrators import schemes
from taichi_jello.run.clock import steps_in
from taichi_jello.support import runtime

SMALL = Box(points=(3, 3, 3), mass=0.05, position=(0.0, 0.8, 0.0))
APART = Contact(touch=False)  # of jellos: takes long to compile


@pytest.fixture(scope="module", autouse=True)
def taichi(precision):
    return precision


@pytest.mark.one_precision
@pytest.mark.parametrize("method", sorted(schemes()))
def test_a_run_cut_in_two_gives_the_same_bits(method, anew):
    """Cut within a frame and at a frame's end, with a moving collider, and restored into a new simulation."""
    scene = Scene(jello=[SMALL], collider=[Plane(), Sphere(radius=0.2, swing=(0.1, 0.0, 0.0))])
    anew()
    whole = Simulation(scene, method=method)
    steps = 12 * whole.substeps
    whole.step(steps)
    first = whole.snapshot()
    whole.reset()
    whole.step(5 * whole.substeps)
    half = whole.snapshot()
    anew()
    parts = Simulation(scene, method=method)
    parts.restore(half)
    for cut in (3 * parts.substeps + 1, 4 * parts.substeps - 1):
        parts.step(cut)
        parts.restore(parts.snapshot())
    assert parts.time == pytest.approx(first.time, abs=1e-12)
    assert np.array_equal(first.x, parts.x) and np.array_equal(first.v, parts.v)


def test_clock_and_arrays():
    simulation = Simulation(Scene(jello=[SMALL, Box(points=(2, 2, 2))], contact=APART, solver=Solver(frame_dt=0.02)))
    assert simulation.x.shape == simulation.v.shape == (35, 3)
    simulation.frame()
    assert simulation.time == pytest.approx(0.02)
    simulation.advance(0.1)
    assert simulation.time == pytest.approx(0.12)
    energies = simulation.energies()
    assert set(energies) == {"kinetic", "elastic", "gravity", "contact"}
    body, x, v = simulation.body, simulation.x.astype(float), simulation.v.astype(float)
    assert energies["kinetic"] == pytest.approx(0.5 * np.sum(body.mass * np.sum(v**2, 1)), rel=1e-5)
    assert energies["gravity"] == pytest.approx(9.81 * np.sum(body.mass * x[:, 1]), rel=1e-5, abs=1e-5)
    simulation.reset()
    assert simulation.time == 0.0 and np.array_equal(simulation.x, simulation.start.x)


def test_uniform_and_callable_fields_push(epsilon):
    def wind(x, v, t):
        return (2.0 * t - 0.1 * v[0]) * x + (1.0 - 2.0 * t) * x

    point = Box(points=(1, 1, 1), mass=2.0, position=(0.3, 0.0, 0.0))
    plain = Scene(gravity=(0.0, 0.0, 0.0), jello=[point], force=[UniformField(force=(0.0, 4.0, 0.0))])
    simulation = Simulation(plain)
    simulation.advance(0.5)
    assert simulation.v[0] == pytest.approx([0.0, 1.0, 0.0], abs=64 * epsilon)
    custom = Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=[point], force=[CallableField(function=wind)]), dt=1e-3)
    custom.advance(0.5)
    # m x'' = x (1 - 0.1 x'), nearly x(0) cosh(t/√2): the drag term changes it by less than 1 %.
    assert custom.x[0, 0] == pytest.approx(0.3 * np.cosh(0.5 / np.sqrt(2.0)), rel=0.01)
    assert custom.system.integrator.order == 4


@pytest.mark.one_precision("f32")
@pytest.mark.filterwarnings("ignore:dt = ")
def test_bad_numbers_stop_at_the_last_good_state():
    simulation = Simulation(Scene(jello=[Box(points=(2, 2, 2)), SMALL], contact=APART), dt=0.02)
    with pytest.raises(Diverged) as caught:
        for _ in range(100):
            before = simulation.snapshot()
            simulation.frame()
    record = caught.value.record
    assert np.isfinite(simulation.x).all() and np.array_equal(simulation.x, before.x)
    assert record["last_good_time"] == simulation.time == before.time < record["time"]
    assert record["dt"] > record["safe_dt"] and record["jello"] in (0, 1)
    assert "particle" in str(caught.value) and "safe dt" in str(caught.value)
    simulation.restore(simulation.start)
    simulation.step(1)  # nothing of the failure is left behind
    assert np.isfinite(simulation.x).all()


def test_restore_refuses_what_does_not_fit():
    simulation = Simulation(Scene(jello=[SMALL]))
    good = np.zeros((27, 3))
    for x, v, problem in (
        (good[:5], good, "x: expected 27 particles"),
        (good, good[:, :2], "v: expected 27 particles"),
        (good * np.nan, good, "x: expected finite numbers"),
        (good, np.full((27, 3), "a"), "v: expected finite numbers"),
    ):
        with pytest.raises(ValueError, match=problem):
            simulation.restore(Snapshot(0.0, x, v))
    with pytest.raises(ValueError, match="seconds"):
        simulation.advance(-1.0)


def test_impossible_scenes_are_refused():
    with pytest.raises(SceneError, match=r"collider.0: expected a box around jello.0"):
        Simulation(Scene(jello=[Box()], collider=[Room(min=(-0.2, 0.0, -0.2), max=(0.2, 0.4, 0.2))]))
    with pytest.raises(SceneError, match=r"solver.method: expected one of .*rk4.*, got 'leapfrog'"):
        Simulation(Scene(jello=[SMALL]), method="leapfrog")


@pytest.mark.parametrize(
    "asked, words",
    [
        ({"dt": -1}, r"^dt: expected a finite number greater than 0, got -1$"),
        ({"dt": "soon"}, r'^dt: expected "auto" or seconds'),
        ({"dt": 1e-12}, r"^dt: expected at least 1.67e-11 s, 1,000,000,000 steps for a frame, got 1e-12$"),
        ({"substeps": 0}, r"^substeps: expected a whole number of at least 1, got 0$"),
        ({"substeps": 10**21}, r"^substeps: expected at most 1,000,000,000 in a frame, got 1e\+21$"),
        ({"dt": 0.001, "substeps": 3}, r"^substeps: expected either dt or substeps, got both: 0.001 and 3$"),
    ],
)
def test_impossible_steps_are_refused_before_anything_is_made(asked, words):
    with pytest.raises(SceneError, match=words):
        Simulation(Scene(jello=[SMALL]), **asked)


def test_more_steps_than_anybody_waits_for_are_refused():
    assert steps_in(0.1, 0.02) == 5
    with pytest.raises(SceneError, match=r"seconds: expected at most 1e\+06 s, 1,000,000,000 steps of 0.001 s, got 1e"):
        steps_in(1e30, 0.001)


def test_a_simulation_does_not_outlive_its_taichi(precision, request):
    simulation = Simulation(Scene(jello=[SMALL]))
    runtime.start(request.config.getoption("--arch"), precision)
    for use in (simulation.frame, simulation.energies, simulation.reset, lambda: simulation.x):
        with pytest.raises(runtime.RuntimeProblem, match="started again"):
            use()


@pytest.mark.one_precision("f32")
def test_an_automatic_step_follows_what_changes():
    """Stiffness, damping, contact and the hand, in mid-run: steps go with 1/√k and the run stays bounded."""
    scene = Scene(jello=[SMALL], collider=[Plane()], force=[Grab()])
    simulation = Simulation(scene, method="rk4")
    simulation.advance(0.3)
    before = simulation.substeps
    simulation.tune(stiffness=100.0, contact_stiffness=1e5)
    stiff = simulation.substeps
    assert 3 * before < stiff < 10 * before  # ten times √k; dashpots, which had a part in it, are as before
    simulation.advance(0.3)
    energy = sum(simulation.energies().values())
    simulation.advance(0.3)
    assert sum(simulation.energies().values()) < 1.05 * energy
    simulation.tune(damping=20.0)
    thick = simulation.substeps
    assert thick > stiff
    simulation.grab([0], [1.0], (0.0, 1.0, 0.0))
    assert simulation.substeps >= thick and simulation.dt <= simulation.safe_dt  # the hand asks for no more
    simulation.advance(0.1)
    assert np.isfinite(simulation.x).all()
    simulation.release()
    with pytest.raises(ValueError, match=r"the largest safe step of rk4 is .* implicit method"):
        simulation.tune(stiffness=1e15)
    assert simulation.substeps == thick and simulation.tuning["stiffness"] == 100.0
    simulation.tune(**simulation.first_tuning)
    assert simulation.substeps == before


@pytest.mark.one_precision
def test_a_method_that_comes_back_is_as_new():
    """Away to another method and back, while something is held and then is not: as if every method were made anew."""
    scene = Scene(jello=[SMALL], collider=[Plane()], force=[Grab()])
    kept, anew = Simulation(scene, method="symplectic-euler"), Simulation(scene, method="symplectic-euler")
    first = kept.system
    for simulation in (kept, anew):
        for frame, method in enumerate(("verlet", "symplectic-euler")):
            simulation.step(7)
            simulation.grab([0], [1.0], (0.1 * frame, 1.0, 0.0))
            simulation.step(5)
            if simulation is anew:
                simulation._systems.clear()
            simulation.change_method(method)
            simulation.tune(stiffness=1.0 + frame)
            simulation.step(5)
            simulation.release()
            simulation.step(30)
    assert np.array_equal(kept.x, anew.x) and np.array_equal(kept.v, anew.v)
    assert kept.system is first and anew.system is not first


def test_a_fixed_step_warns_once():
    simulation = Simulation(Scene(jello=[SMALL]), method="rk4", dt=6e-4)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for factor in (1.0, 50.0, 100.0, 200.0):
            simulation.tune(stiffness=factor)
        assert len(told) == 1 and "beyond the largest safe step of rk4" in str(told[0].message)
    assert simulation.dt == pytest.approx(6e-4, rel=0.1)
