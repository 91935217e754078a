"""Error against run time: the reference, the ladder, the conclusions, and what a person sees."""

import argparse
import json
import signal
import sys
from dataclasses import replace

import numpy as np
import pytest

from taichi_jello import Box, Contact, Plane, Scene, SceneError, Simulation, Snapshot, Solver, Sphere, UniformField
from taichi_jello.app.cli import main
from taichi_jello.physics.integrators import schemes
from taichi_jello.studies import accuracy
from taichi_jello.studies._accuracy import cases, conclusions, solution
from taichi_jello.studies._accuracy.points import solver_tolerance
from taichi_jello.studies._reference import Reference, twisted
from taichi_jello.studies._report import write_csv
from taichi_jello.support import runtime

QUICK = {"quick": True, "quiet": True, "arch": "cpu", "threads": 1, "dt": None, "substeps": None, "seconds": None,
         "json": None}  # fmt: skip


METHODS = ("rk4", "symplectic-euler", "verlet")


def small_smooth():
    """The smooth case with 3³ points."""
    case = cases.built_in(True)["smooth"]
    return replace(case, scene=replace(case.scene, jello=[replace(case.scene.jello[0], points=(3, 3, 3))]))


def shrink(patch, seconds):
    """Let the study's quick run be of a small cube and take so long in timings, but climb far enough for all to see."""
    patch.setattr(accuracy, "SECONDS", {True: seconds})
    patch.setattr(accuracy, "MAX_RUNGS", 6)
    patch.setattr(accuracy, "MIN_RUNGS", 6)
    patch.setattr(accuracy, "default", lambda quick: [small_smooth()])


def asked(**options):
    return argparse.Namespace(**{"scene": None, "method": None} | QUICK | options)


EVERYTHING = Scene(
    jello=[Box(points=(4, 4, 4), position=(0.0, 0.45, 0.0), velocity=(1.0, -1.0, 0.5), damping=0.4)],
    collider=[Plane(), Sphere(center=(0.5, 0.3, 0.0), radius=0.4, swing=(0.2, 0.0, 0.1), period=0.3)],
    drag=0.7,
    contact=Contact(friction=0.0),
    force=[UniformField(force=(0.3, 0.1, -0.2))],
    solver=Solver(frame_dt=0.05),
)


def test_numpy_has_the_program_s_physics():
    runtime.start("cpu", "f64", 1)
    simulation = Simulation(EVERYTHING, team=1)
    reference = Reference(EVERYTHING, simulation.body)
    assert reference.knows(EVERYTHING, [force.title for force in simulation.system.all_forces])
    simulation.advance(0.07)
    moved = simulation.snapshot()
    assert solution.same_physics(reference, simulation, [Snapshot(0.0, moved.x, moved.v), moved])
    assert simulation.energies()["contact"] > 0.0
    other = Reference(Scene(**vars(EVERYTHING) | {"drag": 0.70001}), simulation.body)
    assert not solution.same_physics(other, simulation, [moved])


def test_without_scipy_the_table_still_has_a_reference(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.sparse", None)
    case = cases.case_of(Scene(jello=[Box(points=(2, 2, 2))], gravity=(0.0, 0.0, 0.0)), 0.05)
    exact = solution.reference_solution(case)
    assert "pip install 'taichi_jello[study]'" in exact.how and exact.how.startswith("RK4")


@pytest.fixture(scope="module")
def quick():
    """The figures of some methods for a small cube; the reference, once found, is kept for the tests after it."""
    with pytest.MonkeyPatch.context() as patch:
        shrink(patch, seconds=0.3)
        known = solution.reference_solution(small_smooth())
        patch.setattr(accuracy, "reference_solution", lambda case: known)
        yield accuracy.measure(asked(method=",".join(METHODS)))


def test_both_solvers_agree_and_a_small_push_does_not_grow(quick):
    (case,) = quick["cases"]
    assert case["disagreement"] < 1e-8 and case["growth"] < 10.0 and not case["chaotic"]
    assert "DOP853" in case["reference"] and "RK4" in case["reference"]
    assert case["energy"] < case["energy_at_start"]


def test_every_method_is_measured_in_both_precisions(quick):
    (case,) = quick["cases"]
    assert {(p["method"], p["precision"]) for p in case["points"]} == {(m, p) for m in METHODS for p in ("f32", "f64")}
    for point in case["points"]:
        assert point["seconds"]["median"] >= point["seconds"]["min"] > 0.0
        assert point["steps"] * point["dt"] == pytest.approx(case["seconds"])


def test_fitted_orders_are_those_of_the_schemes(quick):
    (case,) = quick["cases"]
    tolerance = {1: 0.1, 2: 0.15, 4: 0.25}  # of test_orders, which fits the same slopes
    assert set(case["orders"]) == set(METHODS)
    for method, order in case["orders"].items():
        assert order == pytest.approx(schemes()[method].order, abs=tolerance[schemes()[method].order]), method


def test_a_rerun_gives_the_same_errors_to_the_bit(quick):
    mine = [p for p in quick["cases"][0]["points"] if p["method"] == "rk4"]
    mine = [p for p in mine if p["steps"] == mine[1]["steps"]]
    again = accuracy.measure(asked(method="rk4", substeps=mine[0]["steps"]))["cases"][0]["points"]
    assert [(p["precision"], p["error"], p["energy"]) for p in again] == [
        (p["precision"], p["error"], p["energy"]) for p in mine
    ]


def test_the_page_names_orders_the_floor_the_fastest_and_one_sentence(quick):
    page = accuracy.text(quick)
    for words in ("fitted orders", "float32 comes no nearer than", "fastest to 0.0001: ", "ms a frame"):
        assert words in page
    assert page.splitlines()[-1].startswith("To be within 1 mm for 0.1 s, use ")
    # Rounding to 24 bits some thousand times a point: 1e-7 of the edge or somewhat more.
    assert 3e-8 < quick["cases"][0]["float32_floor"] < 3e-6


def test_the_plot_shows_every_method_and_real_time(quick, tmp_path):
    accuracy.plot(quick, tmp_path / "x.svg")
    drawn = (tmp_path / "x.svg").read_text()
    for words in (*METHODS, "real time", "float32"):
        assert f"<!-- {words}" in drawn or f"<!--  {words}" in drawn


def point(method, error, seconds, **more):
    shown = {"method": method, "precision": "f64", "error": error, "seconds": {"min": seconds, "median": seconds}}
    usual = {"dt": 1e-3, "steps": 100, "passes": 400, "centre": 1e-9, "diverged": False, "tolerance": None}
    return shown | usual | {"loosened": False} | more


def test_an_unknown_method_is_named():
    with pytest.raises(SceneError, match=r"expected one of .*rk4.*, got 'rk5'"):
        accuracy.measure(asked(method="rk4,rk5"))


def test_a_kill_keeps_what_was_measured(quick, monkeypatch, tmp_path, capsys):
    """As Ctrl-C does: tables, figures, and a status that says it was not done."""
    monkeypatch.setattr(accuracy, "time_in_turns", lambda *_: signal.raise_signal(signal.SIGTERM))
    path, own = tmp_path / "x.json", signal.getsignal(signal.SIGTERM)
    options = ["--quick", "--method", "rk4", "--substeps", "100", "--threads", "1", "--json", str(path)]
    assert main(["study", "accuracy", *options]) == 130
    told = json.loads(path.read_text())
    assert told["interrupted"] and [p["precision"] for p in told["cases"][0]["points"]] == ["f64"]
    assert capsys.readouterr().out.endswith("interrupted: the table holds what was measured until then\n")
    assert signal.getsignal(signal.SIGTERM) is own and not list(tmp_path.glob("*.part"))


def test_every_point_is_in_the_file_as_soon_as_it_is_measured(quick, monkeypatch, tmp_path):
    """So that what ends the process without a word leaves them too."""
    kept = []
    monkeypatch.setattr(accuracy, "time_in_turns", lambda *_: kept.append(json.loads(path.read_text())))
    path = tmp_path / "x.json"
    told = accuracy.measure(asked(method="rk4", substeps=100, json=str(path)))
    assert [len(one["cases"][0]["points"]) for one in kept] == [1, 2] and all(one["interrupted"] for one in kept)
    assert not told["interrupted"]


def test_implicit_steps_are_solved_to_a_ladder_of_tolerances():
    """The fewer passes, the looser; a run after one that was loosened gives the bits of one before."""
    runtime.start("cpu", "f64", 1)
    case = small_smooth()
    start = case.start(case.body.x)
    exact = solution.Solution(start, 0.0 * start, 1.0, 1e-12, 1.0, 0.0, 0.0, "its beginning")
    measured = list(accuracy.climb(case, exact, "backward-euler", {}, 1.0, asked(substeps=12)))
    points, simulation = [one.point for one in measured], measured[0].simulation
    assert [p["tolerance"] for p in points] == [1e-9, *accuracy.TOLERANCES]
    assert [p["loosened"] for p in points] == [False, True, True]
    own, *loosened = (p["passes"] for p in points)
    assert 24 <= loosened[0] < loosened[1] < own  # a solve takes an evaluation and a product at least
    away = [abs(p["error"] / points[0]["error"] - 1.0) for p in points]  # solved to 1e-3 of a step, 12 times
    assert 0.0 < away[2] < 12 * 1e-3 and away[2] < away[1]
    ends = [solution.run_case(simulation, case, 12, start).x]
    with solver_tolerance(simulation, 0.1):
        ends.append(solution.run_case(simulation, case, 12, start).x)
    ends.append(solution.run_case(simulation, case, 12, start).x)
    assert np.array_equal(ends[0], ends[2]) and not np.array_equal(ends[0], ends[1])


def test_the_recommendation_takes_the_fastest_that_is_near_enough():
    points = [
        point("a", 2e-3, 0.1),
        point("b", 5e-4, 0.2),
        point("c", 1e-5, 0.6),
        point("d", np.inf, 0.0, diverged=True),
    ]
    case = {"points": points, "floor": 1e-7, "chaotic": False, "edge": 1.0, "seconds": 1.0}
    best = conclusions.fastest(case, 1e-3)
    assert (best["method"], best["next"], best["times_as_long"]) == ("b", "c", pytest.approx(3.0))
    assert conclusions.recommendation(case).startswith("To be within 1 mm for 1 s, use b ")
    assert conclusions.fastest(case, 1e-6) is None
    # What the reference cannot tell apart is no proof of an error so small.
    assert conclusions.fastest(case | {"floor": 1e-4}, 2e-5) is None
    chaotic = conclusions.recommendation(case | {"chaotic": True})
    assert chaotic.startswith("To be with its centre of mass within 1 mm for 1 s, use a ")


def test_a_chaotic_scene_is_said_to_be_one():
    """Half a turn folds the cube: a push of 1e-9 decides where its points snap to."""
    scene = Scene(
        jello=[Box(points=(4, 4, 4), stiffness=2000.0, damping=0.0)],
        gravity=(0.0, 0.0, 0.0),
        solver=Solver(frame_dt=0.1),
    )
    case = cases.Case("folded", "a folded cube", scene, 0.1, lambda x: twisted(x, 180.0, 0.0))
    exact = solution.reference_solution(case)
    assert exact.chaotic and exact.growth > 1e4
    lines = accuracy.case_page({"points": [], "sentence": "", "conclusions": []} | accuracy.description(case, exact))
    assert any("too chaotic for errors point by point" in line for line in lines)


def test_every_point_is_a_line_for_csv(quick, tmp_path):
    write_csv(tmp_path / "x.csv", accuracy.rows(quick))
    heads, *lines = (tmp_path / "x.csv").read_text().splitlines()
    assert heads.startswith("case,method,precision,dt,") and heads.endswith("seconds.min,seconds.median")
    assert len(lines) == len(quick["cases"][0]["points"]) and lines[0].startswith("smooth,rk4,f64,")
