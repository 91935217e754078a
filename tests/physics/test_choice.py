"""The method `auto`, by the evaluations that a frame takes: explicit where that fits or costs less, else steps that
adapt. And the line that tells of long steps."""

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest

from taichi_jello import Ball, Box, Plane, Scene, Sheet, Simulation, Solver
from taichi_jello.physics.integrators import scheme, schemes
from taichi_jello.run.auto_method import Choice
from taichi_jello.run.explain import facts, text


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def cube(stiffness, points=3, **solver):
    box = Box(points=(points,) * 3, stiffness=stiffness, position=(0.0, 0.0, 0.0))
    return Scene(jello=[box], solver=Solver(**solver))


@pytest.fixture(scope="module")
def soft(taichi):
    return Simulation(cube(200.0))


@pytest.fixture(scope="module")
def stiff(taichi):
    return Simulation(replace(cube(1e7, points=5), collider=[Plane(point=(0.0, -1.0, 0.0))]))


def chosen_at(simulation, frame_dt):
    """What `auto` takes for the same forces at frames of another length."""
    choice = Choice(replace(simulation.scene, solver=Solver(frame_dt=frame_dt)), simulation.body, False)
    damped = any(force.reads_velocity for force in simulation.system.all_forces)
    assert choice.scheme(simulation.system.all_forces, damped) is scheme(choice.method)
    return choice.method


def test_auto_is_the_default_and_says_why(soft, stiff):
    assert soft.method == "rk4" and stiff.method == "adaptive" and stiff.substeps == 1
    evaluations = 4 * soft.substeps
    assert f"a frame takes rk4 {evaluations} evaluations" in text(facts(soft))
    assert "method: adaptive: a frame takes rk4" in text(facts(stiff))


def test_what_nothing_damps_gets_the_method_that_takes_nothing():
    undamped = Box(points=(3, 3, 3), damping=0.0)
    simulation = Simulation(Scene(jello=[undamped]))
    assert simulation.method == "verlet" and f"verlet {simulation.substeps} evaluations" in simulation.choice.reason
    assert Simulation(Scene(jello=[undamped], collider=[Plane()])).method == "symplectic-euler"  # contact is damped


@pytest.mark.parametrize("frames", [24, 30, 60, 90, 120])
def test_a_solid_s_method_does_not_go_by_the_length_of_frames(frames, soft, stiff):
    """Both what an explicit method takes for a frame and what real time allows grow with it."""
    assert chosen_at(soft, 1.0 / frames) == "rk4"
    assert chosen_at(stiff, 1.0 / frames) == "adaptive"


def test_the_choice_is_the_same_again(stiff):
    """It is counted, not timed."""
    reasons = set()
    for _ in range(3):
        choice = Choice(stiff.scene, stiff.body, False)
        choice.scheme(stiff.system.all_forces, True)
        reasons.add((choice.method, choice.reason))
    assert reasons == {("adaptive", stiff.choice.reason)}


@pytest.mark.filterwarnings("ignore:dt = ")
def test_who_gives_the_step_or_the_method_gets_it():
    assert Simulation(cube(1e7), dt=1e-3).method == "rk4"
    assert Simulation(cube(1e7), substeps=7).method == "rk4"
    assert Simulation(cube(1e7, dt=1e-3)).choice.reason == "the step is given"
    assert Simulation(cube(1e7), method="verlet").method == "verlet"
    assert Simulation(cube(1e7, method="rk2")).choice is None


def test_a_sheet_of_many_points_stays_explicit_where_solving_it_would_take_longer():
    """Springs do not hold it across, so solves take ten times as many passes as in a solid."""
    simulation = Simulation(Scene(jello=[Sheet(points=(70, 70), stiffness=1e4)]))
    choice = simulation.choice
    allowed = 0.6 / 60.0 * 800e6 / (len(simulation.body.springs) + 2 * len(simulation.body))
    assert simulation.method == "symplectic-euler"
    assert allowed < simulation.substeps <= 4000  # over real time, but less than that
    assert f"real time allows {allowed:.0f}" in choice.reason
    assert f"symplectic-euler takes {simulation.substeps}" in choice.reason


def test_only_long_steps_are_told_of_and_what_they_take_out(soft, stiff):
    assert soft.method_told == ""
    told = stiff.method_told
    assert told.startswith(f"method: adaptive, since {stiff.choice.reason}; swings faster than ") and " fade" in told
    given = Simulation(cube(200.0), method="backward-euler")
    told = given.method_told
    assert told.startswith("method: backward-euler; swings faster than ") and told.endswith(" Hz fade")
    assert f" {given.system.integrator.fades_beyond(given.dt):.2g} Hz" in told


@pytest.mark.parametrize("dt", [1.0 / 24.0, 1.0 / 60.0, 1e-3])
def test_swings_fade_as_backward_euler_s_closed_form_says(dt):
    """It multiplies a swing by 1/√(1 + a²) a step, a = ω dt: half is left after 0.1 s where 1 + a² = 4^(dt/0.1 s). The
    frequencies that are tried are 2.7 % apart."""
    backward = scheme("backward-euler")
    exact = sqrt(4.0 ** (dt / 0.1) - 1.0) / (2.0 * pi * dt)
    found = Simulation(cube(200.0), method="backward-euler").system.integrator.fades_beyond(dt)
    assert exact <= found <= 1.03 * exact
    a = np.geomspace(0.01, 30.0, 20)
    matrices = backward.amplification(a, np.zeros(1))
    assert np.abs(np.linalg.eigvals(matrices)).max(1) == pytest.approx(1.0 / np.sqrt(1.0 + a**2))


def test_schemes_of_second_order_fade_less_and_verlet_nothing():
    """With one step a frame; SDIRK2 and BDF2 take out of slow swings a third power of a."""
    found = {}
    for name in ("backward-euler", "bdf2", "sdirk2", "adaptive", "verlet"):
        made = object.__new__(schemes()[name])  # it goes by the scheme alone
        found[name] = made.fades_beyond(1.0 / 60.0)
    assert found["backward-euler"] < 0.5 * min(found["bdf2"], found["sdirk2"])
    assert found["adaptive"] == found["sdirk2"] < 60.0
    assert found["verlet"] == float("inf")


FAR = (3.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("beside", "solved"),
    [([], 400), ([Ball(resolution=3, position=FAR)], 400), ([Sheet(points=(4, 4), position=FAR)], 4000)],
)
def test_a_sheet_beside_a_solid_makes_solves_as_long_as_its_own(beside, solved):
    simulation = Simulation(Scene(jello=[Box(points=(3, 3, 3), stiffness=1e10), *beside]))
    assert simulation.method == "adaptive"
    assert simulation.choice.reason.endswith(f"adaptive steps take about {solved}")
