"""What methods make of motion: figures that are known in closed form, and what a person sees."""

import argparse
import csv
import json
from math import atan, inf, sin, sqrt

import pytest

from taichi_jello import SceneError
from taichi_jello.studies import accuracy
from taichi_jello.studies._motion import bodies, motion, page
from taichi_jello.studies._motion.trials import FRAME, SLOPE, SOFT, TRIALS, G
from taichi_jello.studies._report import write_csv, write_json

SUBSTEPS, IMPLICIT = 40, 12
FALL = next(trial for trial in TRIALS if trial.name == "fall")
QUICK = {"scene": "motion", "quick": True, "quiet": True, "arch": "cpu", "precision": "f64", "threads": 1, "dt": None,
         "substeps": SUBSTEPS, "seconds": 1.0, "json": None, "method": None}  # fmt: skip


def asked(**options):
    return argparse.Namespace(**QUICK | options)


@pytest.fixture(scope="module")
def told():
    """A row for each of some methods, of a cube with 3³ points, spun at a quarter of the speed: its springs are as
    stiff as 40 explicit substeps can bear. All in f64, so that the closed forms are met."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bodies, "RESOLUTION", {True: 3})
        patch.setattr(bodies, "SPIN", 4.0)
        patch.setattr(motion, "FINER", (2, 4))
        told = accuracy.measure(asked(method="rk4,verlet"))
        patch.setattr(motion, "references", lambda *_: told["references"])
        told["rows"] += accuracy.measure(asked(method="backward-euler", substeps=IMPLICIT))["rows"]
        yield told


@pytest.fixture(scope="module")
def rows(told):
    return {row["method"]: row for row in told["rows"]}


def test_methods_of_second_order_fall_as_far_as_they_should(rows):
    assert abs(rows["rk4"]["fall_off"]) < 1e-9 and abs(rows["verlet"]["fall_off"]) < 1e-9


def test_backward_euler_falls_too_far_by_g_h_t_over_2(rows):
    """The sum of g h² n over the steps, g t (t + h)/2."""
    assert rows["backward-euler"]["fall_off"] == pytest.approx(0.5 * G * FRAME / IMPLICIT, rel=1e-5)


def test_backward_euler_loses_spin_swing_and_energy_and_rk4_keeps_them(rows):
    kept, lost = rows["rk4"], rows["backward-euler"]
    assert all(0.99 < kept[key] < 1.001 for key in ("spin", "swing", "energy"))
    assert lost["spin"] < 0.98 and lost["swing"] < 0.6 and lost["energy"] < 0.5
    assert lost["rebound"] < kept["rebound"] - 0.05


def test_backward_euler_s_swing_is_that_of_the_damped_oscillator(rows):
    """1/√(1 + ω²h²) a step, and an angle of atan ωh."""
    a = bodies.CubeAndBall(True).lowest_mode(SOFT)[0] * FRAME / IMPLICIT
    assert rows["backward-euler"]["swing"] == pytest.approx((1.0 + a * a) ** (-0.5 * IMPLICIT * 60), rel=0.05)
    assert rows["backward-euler"]["period_off"] == pytest.approx(a / atan(a) - 1.0, rel=0.1)


def test_the_reference_has_converged_and_a_ball_rolls_almost_as_a_rigid_one(told, rows):
    for name, most in (("rebound", 5e-3), ("rolling", 2e-3)):
        assert abs(told["references"][name]["difference"]) < most
    assert abs(rows["rk4"]["rebound_off"]) < 0.01 and abs(rows["rk4"]["rolling_off"]) < 0.01
    assert told["references"]["rolling"]["value"] == pytest.approx(told["rolling_in_theory"], rel=0.1)


def test_a_solid_even_ball_would_roll_at_five_sevenths():
    """The finer the lattice, the nearer is its own mass to that."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bodies, "RESOLUTION", {True: 4, False: 12})
        coarse, fine = (bodies.CubeAndBall(quick).rolling(SLOPE) for quick in (True, False))
    even = 5.0 / 7.0 * G * sin(SLOPE)
    assert 0.7 * even < coarse < fine < even


def test_passes_are_counted_by_trial(rows):
    assert set(rows["verlet"]["passes_of"]) == {trial.name for trial in TRIALS}
    assert set(rows["rk4"]["passes_of"].values()) == {4 * SUBSTEPS}
    assert rows["backward-euler"]["passes"] > 2 * IMPLICIT  # a solve takes an evaluation and a product at least


def test_auto_cuts_frames_itself(told):
    bench = motion.Bench("auto", bodies.CubeAndBall(True), ("cpu", "f64", 1))
    found, passes = bench.run(FALL, None, 1.0)
    assert found["fall_off"] == pytest.approx(0.0, abs=0.1) and 0 < passes < 1000


def test_symplectic_euler_falls_alike_and_says_when_numbers_went_bad(told):
    """Two substeps are too few for any explicit method."""
    bench = motion.Bench("symplectic-euler", bodies.CubeAndBall(True), ("cpu", "f64", 1))
    found, _ = bench.run(FALL, SUBSTEPS, 1.0)
    assert found["fall_off"] == pytest.approx(0.5 * G * FRAME / SUBSTEPS, rel=1e-5)
    row = motion.row(bench, 1, told)
    assert row["rebound"] == row["rebound_off"] == inf and row["diverged"].split()[0] == "rebound"
    assert page.cells(row)[:2] == ["symplectic-euler", "1"] and page.cells(row)[3:5] == ["diverged", "diverged"]
    assert page.largest_error(row) == inf


def test_the_ladder_begins_where_the_softest_cube_is_stable(monkeypatch):
    bench = motion.Bench("verlet", bodies.CubeAndBall(True), ("cpu", "f64", 1))
    first = motion.first_rung(bench)
    assert 1.0 < FRAME / first * bench.bodies.modes[0][-1] * sqrt(SOFT) <= 2.0 and first & (first - 1) == 0
    monkeypatch.setattr(motion, "row", lambda bench, substeps, results: {"passes": 4.0 * substeps})
    ladder = [found["passes"] / 4.0 for found in motion.climb(bench, {}, asked(substeps=None))]
    assert (
        ladder == [first * 4**k for k in range(len(ladder))] and ladder[-1] * 4 <= motion.MAX_PASSES < ladder[-1] * 16
    )


def test_an_unknown_method_is_named():
    with pytest.raises(SceneError, match=r"expected one of .*rk4.* or auto, got 'rk5'"):
        accuracy.measure(asked(method="rk4,rk5"))


def test_text_csv_json_and_picture(told, tmp_path):
    lines = accuracy.text(told).splitlines()
    assert lines[2].split()[:3] == ["method", "substeps", "passes"] and lines[3].startswith("rk4 ")
    assert any(line.startswith("rebound 0.") and "by the reference: RK4 in f64" in line for line in lines)
    assert lines[-1].startswith("within 5% in everything: ") and "not here: backward-euler" in lines[-1]
    write_csv(tmp_path / "x.csv", accuracy.rows(told))
    (first, *_) = csv.DictReader((tmp_path / "x.csv").open())
    assert first["method"] == "rk4" and {"passes", "rebound_off", "period_off", "passes_of.fall"} <= set(first)
    write_json(tmp_path / "x.json", told)
    assert json.loads((tmp_path / "x.json").read_text())["case"] == "motion"
    accuracy.plot(told, tmp_path / "x.svg")
    drawn = (tmp_path / "x.svg").read_text()
    for words in ("Rebound", "Spin kept", "Lowest swing", "Energy left", "Rolling", "Free fall", "verlet", "rk4"):
        assert f"<!-- {words}" in drawn


def test_the_case_is_found_by_its_name_and_ctrl_c_keeps_what_there_is(here, monkeypatch, tmp_path):
    def broken_off(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(motion, "references", broken_off)
    done = here("study", "accuracy", "motion", "--quick", "--json", "x.json")
    assert done.returncode == 130 and "interrupted" in done.stdout
    told = json.loads((tmp_path / "x.json").read_text())
    assert told["case"] == "motion" and told["interrupted"] and told["rows"] == []
