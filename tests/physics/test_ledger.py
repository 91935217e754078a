"""Energy and work balance up to the error of the method."""

from dataclasses import replace

import numpy as np
import pytest
from reference import twisted

from taichi_jello import (
    Box,
    CallableField,
    Contact,
    Grab,
    GravityKeyframe,
    Keyframe,
    Move,
    Pin,
    Plane,
    Scene,
    Simulation,
    Snapshot,
    Solver,
    Sphere,
    UniformField,
)
from taichi_jello.physics.integrators import schemes
from taichi_jello.support import runtime

CUBE = Box(points=(4, 4, 4), mass=0.125, damping=0.05)
STILL = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def residuals(scene, counts, start=twisted, frames=1, **options):
    """The residuals [J] after so many frames, by the number of substeps of each."""
    simulation = Simulation(scene, ledger=True, **options)
    found = []
    for count in counts:
        simulation.change_step(substeps=count)
        simulation.restore(Snapshot(0.0, start(simulation.body.x), simulation.start.v))
        for _ in range(frames):
            simulation.frame()
        found.append(simulation.energy_residual)
    return np.array(found), simulation


def wind(x, v, t):
    return 0.02 * (1.0 + 10.0 * t) * (v * 0.1 - x)


SMOOTH = Scene(
    jello=[CUBE], drag=0.8, force=[UniformField(force=(0.01, 0.02, 0.0)), CallableField(function=wind)],
    solver=Solver(frame_dt=0.04),
)  # fmt: skip


def test_rk4_s_residual_falls_with_its_order():
    counts = np.array([24, 48, 96, 192])
    error, simulation = residuals(SMOOTH, counts, method="rk4")
    assert {"dashpots", "drag", "uniform field", "callable field"} <= set(simulation.work)
    assert simulation.work["dashpots"] < 0.0 and simulation.work["drag"] < 0.0
    slope = -np.polyfit(np.log(counts), np.log(np.abs(error)), 1)[0]
    assert slope == pytest.approx(4.0, abs=0.35), error
    # At 192 steps ω dt is 0.4 for the fastest mode: (ω dt)⁴/120 of what that turns over.
    assert abs(error[-1]) < 2e-4 * abs(sum(simulation.work.values()))


HEAVY = (0.0, -1000.0, 0.0)
OUTSIDE = {
    # A sheet that lies as deep in the ground as it weighs: nothing touches down or lifts off, so all forces are smooth.
    "moving colliders": Scene(
        gravity=HEAVY,
        jello=[
            Box(points=(3, 1, 3), mass=0.1, position=(0.0, -0.1 / 9 * 1000.0 / 2000.0, 0.0), velocity=(0.02, 0.0, 0.01))
        ],
        collider=[Plane(keyframe=[Move(time=0.0, offset=STILL), Move(time=0.02, offset=(0.0, 0.001, 0.0005))])],
        solver=Solver(frame_dt=0.02),
    ),
    "handles": Scene(
        jello=[replace(CUBE, pin=[Pin(max=(0.0, 1.0, 1.0), keyframe=[
            Move(time=0.0, offset=STILL), Move(time=0.02, offset=(-0.02, 0.01, 0.0)), Move(time=0.04, offset=STILL),
        ])])],
        drag=0.8, solver=Solver(frame_dt=0.02),
    ),
    "keyframes": Scene(
        jello=[replace(CUBE, keyframe=[
            Keyframe(time=0.0, stiffness=1.0, damping=1.0, rest_length=1.0),
            Keyframe(time=0.04, stiffness=3.0, damping=2.0, rest_length=1.05),
        ])],
        keyframe=[GravityKeyframe(time=0.0, gravity=STILL), GravityKeyframe(time=0.04, gravity=(1.0, -9.81, 0.0))],
        solver=Solver(frame_dt=0.01),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", OUTSIDE)
def test_whatever_does_the_work_rk4_s_residual_falls_with_its_order(name):
    """Drag, wind and fields are in the test above; here is what moves within a frame or changes from frame to frame."""
    scene, counts = OUTSIDE[name], np.array([96, 192, 384]) // (2 if name == "keyframes" else 1)
    start = twisted if name != "moving colliders" else lambda x: x
    error, simulation = residuals(scene, counts, start, frames=4 if name == "keyframes" else 2, method="rk4")
    assert abs(simulation.work[name]) > 0.05
    slope = -np.polyfit(np.log(counts), np.log(np.abs(error)), 1)[0]
    assert slope > 3.65, error  # friction's bristles make it fall faster
    assert abs(error[-1]) < 1e-4 * abs(simulation.work[name])


@pytest.mark.filterwarnings("ignore:dt = ")
@pytest.mark.parametrize("name", sorted(schemes()))
def test_the_residual_is_the_method_s_own_error(name):
    """It vanishes at the order of the scheme, or faster where a scheme keeps energy better than positions."""
    counts = np.array([400, 800] if schemes()[name].solves else [1600, 3200])
    error, _ = residuals(SMOOTH, counts, method=name)
    slope = -np.polyfit(np.log(counts), np.log(np.abs(error) + 1e-15), 1)[0]
    assert slope > min(schemes()[name].order, 3.5) - 0.2, error


def landing(**contact):
    return Scene(
        jello=[Box(points=(3, 3, 3), position=(0.0, 0.49, 0.0), velocity=(1.0, -1.0, 0.0), pin=[Pin(max=(0, 1, 0))])],
        collider=[Plane(), Sphere(center=(0.4, -0.32, 0.0), radius=0.3, velocity=(0.0, 2.0, 0.0))],
        contact=Contact(**contact),
        solver=Solver(frame_dt=0.05),
    )


def test_contact_friction_and_a_moving_sphere_are_booked():
    (coarse, fine), simulation = residuals(landing(), [1000, 8000], start=lambda x: x)
    work = simulation.work
    assert work["contact dashpots"] < 0.0 and work["friction"] < 0.0 and work["moving colliders"] > 0.0
    # Touching down is a jump of the force: first order at best.
    assert abs(fine) < 1e-3 * abs(work["contact dashpots"]) and abs(fine) < 0.5 * abs(coarse)


def test_the_hand_s_work_lifts_the_jello():
    scene = Scene(jello=[CUBE], force=[Grab()], solver=Solver(frame_dt=0.01))
    simulation = Simulation(scene, ledger=True, substeps=200)
    simulation.grab([0, 5], [0.5, 0.5], (0.0, 1.0, 0.0))
    for _ in range(10):
        simulation.frame()
    assert simulation.work["grab"] > 0.01
    assert abs(simulation.energy_residual) < 1e-5 * simulation.work["grab"]  # RK4 at ω dt = 0.1


def test_pushes_and_tuning_are_booked_and_a_restore_opens_new_books():
    simulation = Simulation(SMOOTH, ledger=True, substeps=400)
    simulation.frame()
    v, mass = simulation.v, simulation.body.mass
    simulation.push((0.0, 2.0, 0.0))
    simulation.tune(stiffness=2.0)
    simulation.tune(gravity=(0.0, 3.0, 0.0))
    simulation.frame()
    assert simulation.work["pushes"] == pytest.approx(mass @ (2.0 * v[:, 1] + 2.0), rel=1e-5)
    assert abs(simulation.energy_residual) < 1e-4 * simulation.work["pushes"]
    simulation.reset()
    assert simulation.work == dict.fromkeys(simulation.work, 0.0) and simulation.energy_residual == 0.0


def test_a_frame_cut_in_pieces_books_the_same_work():
    _, whole = residuals(SMOOTH, [400], method="rk4")
    pieces = Simulation(SMOOTH, method="rk4", ledger=True, substeps=400)
    pieces.restore(Snapshot(0.0, twisted(pieces.body.x), pieces.start.v))
    for part in (1, 2, 3, 94, 300):
        pieces.step(part)
    for name, work in whole.work.items():
        # The trapezoid rule on one substep: dt³ P''/12, P turning over in some 0.01 s.
        assert pieces.work[name] == pytest.approx(work, rel=1e-4), name


@pytest.mark.parametrize("form", [{"team": 1}, {"team": 2}, {"team": 0}])
def test_keeping_a_ledger_changes_no_bit(form, request):
    if request.config.getoption("--arch") != "cpu":
        form = {}
    runtime.start(request.config.getoption("--arch"), "f32", 2)
    scene = Scene(**vars(landing()) | {"drag": 0.3})
    ends = []
    for ledger in (False, True):
        simulation = Simulation(scene, substeps=60, ledger=ledger, **form)
        simulation.step(150)
        ends.append(simulation.snapshot())
    assert np.array_equal(ends[0].x, ends[1].x) and np.array_equal(ends[0].v, ends[1].v)


def test_without_a_ledger_there_is_no_field_and_no_residual():
    runtime.start("cpu", "f32", 1)
    without, with_it = Simulation(SMOOTH), Simulation(SMOOTH, ledger=True, substeps=400)
    assert not any(owner == "ledger" for owner, *_ in without.system.memory.fields)
    assert any(owner == "ledger" for owner, *_ in with_it.system.memory.fields)
    with_it.restore(Snapshot(0.0, twisted(with_it.body.x), with_it.start.v))
    with_it.frame()
    # In f32 the work of every step is rounded to 24 bits, the sums over particles and frames are float64.
    assert abs(with_it.energy_residual) < 1e-4 * abs(with_it.work["dashpots"])
    with pytest.raises(ValueError, match="keeps no ledger"):
        _ = without.energy_residual


def test_what_jellos_lose_where_they_touch_is_booked():
    """A point falls on a cube and slides. The residual is a small part of the losses, and falls with the step."""
    runtime.start("cpu", "f64", 1)
    stone = Box(points=(1, 1, 1), mass=0.02, position=(0.1, 0.51, 0.05), velocity=(1.0, -2.0, 0.0))
    scene = Scene(jello=[Box(points=(3, 3, 3), damping=0.05), stone], gravity=STILL, solver=Solver(frame_dt=0.02))
    (coarse, fine), simulation = residuals(scene, [100, 1600], start=lambda x: x, method="rk4")
    work = simulation.work
    assert work["touch dashpots"] < 0.0 and work["touch friction"] < 0.0
    lost = work["touch dashpots"] + work["touch friction"]
    # Touching down is a jump of the force, and where a point touches is looked up once a step: first order.
    assert abs(fine) < 1e-2 * abs(lost) and abs(fine) < 0.2 * abs(coarse)
