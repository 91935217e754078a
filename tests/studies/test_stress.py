"""The study of stiff and extreme cases: what it says of a case that is well, of one that is not, and of a refusal."""

import argparse
from dataclasses import replace

import numpy as np
import pytest

from taichi_jello import SceneError
from taichi_jello.studies import stress
from taichi_jello.studies._extremes import CASES, shape_error

BY_NAME = {case.name: case for case in CASES}


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def test_a_case_passes_fails_or_is_refused():
    flat = replace(BY_NAME["flat, 1 % thick"], seconds=1.0)
    well = stress.run_case(flat, "auto")
    assert well["verdict"] == "ok" and well["passes"] and well["method"] == "rk4"
    assert well["rise"] == pytest.approx(0.0, abs=1e-5) and well["evaluations"] > 0
    late = replace(BY_NAME["melted, k = 0"], check=lambda simulation, start: "not what it should be")
    assert stress.run_case(late, "rk4")["verdict"] == "not what it should be"
    refused = stress.run_case(BY_NAME["k = 1e-6 N/m"], "euler")
    assert refused["passes"] and refused["verdict"].startswith("refuses: euler has no stable step")


def test_a_method_that_there_is_not_is_a_mistake():
    for methods in ("rk9", "rk4,,"):
        with pytest.raises(SceneError, match=r"solver\.method: expected one of"):
            stress.measure(argparse.Namespace(method=methods, quick=False))


def test_a_long_run_keeps_momentum_and_energy():
    turning = replace(BY_NAME["turns for 1e6 steps"], steps=30_000)
    assert stress.run_case(turning, "rk4")["verdict"] == "ok"
    simulation = turning.simulation(method="rk4")
    simulation.push((0.0, 1e-3, 0.0))
    assert turning.check(simulation, simulation.start.x).startswith("momentum off by ")


def test_shape_error_sees_past_motion_and_reflection():
    body = BY_NAME["flat"].simulation(method="euler", dt=1e-4).body
    turned = body.rest @ np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0] + [1.0, 2.0, 3.0]
    assert shape_error(body, turned) < 1e-12
    assert shape_error(body, turned * 1.1) == pytest.approx(
        0.1 * np.sqrt(np.mean((body.rest**2).sum(1))) / 3**0.5, rel=0.1
    )


def test_figures_become_a_page_lines_and_a_picture(tmp_path):
    good = {"case": "flat", "asked": "auto", "method": "rk4", "substeps": 3, "rise": 0.0, "passes": True}
    told = {"processor": "P", "cores": 2, "python": "3", "taichi": "1", "interrupted": False, "skipped": []}
    told["rows"] = [
        good | {"verdict": "ok"},
        {"case": "flat", "asked": "euler", "passes": True, "verdict": "refuses: x"},
    ]
    page = stress.text(told)
    assert "auto (rk4)" in page and "refuses: x" in page and page.endswith("2 runs, 0 of them failed")
    told["skipped"] = ["turns for 1e6 steps", "xpbd"]
    assert stress.text(told).endswith("\n--quick leaves out: turns for 1e6 steps, xpbd")
    assert stress.rows(told)[1]["method"] is None
    stress.plot(told, tmp_path / "stress.png")
    assert (tmp_path / "stress.png").stat().st_size > 2000
