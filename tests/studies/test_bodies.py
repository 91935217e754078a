"""The study of what jellos are held to: its figures are within, and a body that is not is told so."""

import argparse

import numpy as np
import pytest

from taichi_jello import SceneError, runtime
from taichi_jello.studies import bodies
from taichi_jello.studies._report import write_csv

QUICK = {"quick": True, "quiet": True, "arch": "cpu", "threads": 1, "precision": "f32", "json": None, "method": None}


def test_what_is_quick_is_within(tmp_path):
    told = bodies.measure(argparse.Namespace(**QUICK))
    assert [row["what"].partition(":")[0] for row in told["rows"]] == [
        "stack at rest", "stack at rest", "two cubes collide in free space", "cube melts as it falls",
    ]  # fmt: skip
    assert all(row["held"] and 0.0 <= row["value"] <= row["most"] for row in told["rows"])
    assert "NOT HELD" not in bodies.text(told)
    told["rows"][0] |= {"value": 0.2, "held": False}
    assert bodies.text(told).count("NOT HELD") == 1 and "0.2" in bodies.text(told)
    write_csv(tmp_path / "bodies.csv", bodies.rows(told))
    assert (tmp_path / "bodies.csv").read_text().splitlines()[0] == "what,value,most,held"


@pytest.mark.parametrize("bar", [bodies.BARS[0], bodies.BARS[1], bodies.BARS[3]])
def test_bars_that_cross_do_not_pass_and_gain_no_energy(bar, request):
    """The first and the last went through; the second one gained 0.67 of the 0.88 J that its fall gives."""
    runtime.start(request.config.getoption("--arch"), "f32")
    went, fed = bodies.crossing(bodies.across(*bar), "auto")
    assert not went and fed < 0.05 * 0.3 * 9.81 * 0.3


def test_few_points_and_many_sag_and_swing_alike(request):
    """The linear ones differ by 0.8 and 0.9 %, see tests/test_elastic.py; these are far from linear only in sag."""
    runtime.start(request.config.getoption("--arch"), "f32")
    differ = bodies.finer("auto")
    assert 0.0 < differ[0] < 0.01 and 0.005 < differ[1] < 0.012
    # 1/4L √(G/ρ) of a shear beam with G = 2E/5, which bending makes slower.
    beam = 0.25 * np.sqrt(0.4 * 2000 / 500)
    assert 0.5 * beam < bodies.swing(8, "auto") < beam


def test_heights_are_those_of_faces_that_lie():
    """A roof over a floor: the steep side of the roof counts for nothing."""
    x = np.array([[0, 0, 0], [4, 0, 0], [0, 0, 4], [0, 1, 0], [4, 3, 0], [0, 1, 4], [4, 9, 4]], float)
    floor, roof, wall = [0, 1, 2], [3, 4, 5], [4, 5, 6]
    columns = np.array([[1.0, 1.0], [3.9, 3.9], [9.0, 0.0]])
    found = [bodies.heights(x, np.array([floor, roof, wall]), columns, side) for side in (-1.0, 1.0)]
    assert found[0] == pytest.approx([0.0, np.nan, np.nan], nan_ok=True)
    assert found[1] == pytest.approx([1.5, np.nan, np.nan], nan_ok=True)


def test_a_method_that_there_is_not_is_a_mistake():
    with pytest.raises(SceneError, match=r"solver\.method: expected one of"):
        bodies.measure(argparse.Namespace(**QUICK | {"method": "rk9"}))
