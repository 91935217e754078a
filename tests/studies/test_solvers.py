"""The study of ways to solve: its problem is right, its ways agree, and its figures become a page and a picture."""

import argparse
from dataclasses import replace

import numpy as np
import pytest

from taichi_jello.studies import _solvers, solvers


@pytest.fixture(scope="module")
def told():
    chosen = argparse.Namespace(quick=True, quiet=True, json=None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solvers, "FALLS", {True: (solvers.Fall(4, (2,), 1000),)})
        return solvers.measure(chosen)


def test_forces_are_minus_the_slope_of_what_a_step_makes_least():
    """½ (m/c²)|x - z - c w|² + ½ k (L - R)² + ½ k_c depth² - m g·x, without dashpots."""
    problem = _solvers.Landing(3)
    problem.body = body = replace(problem.body, damping=np.zeros(len(problem.body.springs)))
    rng, h = np.random.default_rng(5), 1e-6
    x, p = body.x - [0.0, 0.6, 0.0] + rng.normal(0.0, 0.01, body.x.shape), rng.normal(0.0, 1.0, body.x.shape)

    def energy(x):
        length = np.linalg.norm(x[problem.j] - x[problem.i], axis=1)
        away = x - body.x - _solvers.STEP * body.v
        kinetic = 0.5 * np.sum(problem.m * away**2) / _solvers.STEP**2
        springs = 0.5 * np.sum(body.stiffness * (length - body.rest_length) ** 2)
        contact = 0.5 * _solvers.GROUND * np.sum(np.minimum(x[:, 1], 0.0) ** 2)
        return kinetic + springs + contact + _solvers.GRAVITY * float(np.sum(problem.m[:, 0] * x[:, 1]))

    assert (x[:, 1] < 0.0).any() and (x[:, 1] > 0.0).any()
    slope = (energy(x + h * p) - energy(x - h * p)) / (2.0 * h)
    assert -np.sum(problem.residual(x) * p) == pytest.approx(slope, rel=1e-6)


def test_a_turned_step_stretches_nothing():
    problem = _solvers.Landing(3)
    x, m = problem.x, problem.m
    spin = np.cross([0.3, -0.5, 0.2], x - x.mean(0)) + [1.0, 2.0, 3.0]
    there, _, R = _solvers.turned(x, m, spin, 1.0)
    assert there - there.mean(0) == pytest.approx((x - x.mean(0)) @ R.T, abs=1e-12)
    small, direction, _ = _solvers.turned(x, m, spin, 1e-6)
    assert small - x == pytest.approx(1e-6 * spin, abs=1e-11) and direction == pytest.approx(spin, abs=1e-5)


def test_exact_ways_agree_and_all_get_there(told):
    found = {(row["outer"], row["inner"]): list(row["passes"].values()) for row in told["rows"]}
    assert len(found) == 13
    assert found["newton", "two levels added"][1] < found["newton", "blocks"][1]
    assert found[solvers.PROGRAM, "two levels added"][1] < 0.5 * found[solvers.PROGRAM, "blocks"][1]
    for outer in solvers.OUTER:
        assert found[outer, "inverse"] == found[outer, "sparse factors"]
    assert all(np.isfinite(passes).all() and passes == sorted(passes) for passes in found.values())


def test_figures_become_a_page_lines_and_a_picture(told, tmp_path):
    page = solvers.text(told)
    assert "two levels added" in page and "4³, quickest to 1 %: newton with " in page
    assert "4³, the program to 1 %: blocks " in page
    assert len(solvers.rows(told)) == 13
    solvers.plot(told, tmp_path / "solvers.png")
    assert (tmp_path / "solvers.png").stat().st_size > 2000
