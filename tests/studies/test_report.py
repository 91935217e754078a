"""Tables, files and figures that all studies share."""

import csv
import json
import sys

import numpy as np
import pytest

from taichi_jello.studies import _report as report


def test_a_table_lines_up_its_columns():
    lines = report.table(["method", "dt"], [["rk4", 0.00123456], ["backward-euler", 2.0]]).splitlines()
    assert lines == ["method                dt", "rk4             0.001235", "backward-euler         2"]


def test_numbers_that_are_not_finite_become_null(tmp_path):
    report.write_json(tmp_path / "x.json", {"a": [np.float32(1.5), float("nan")], "b": {"c": np.inf, "d": np.int64(3)}})
    assert json.loads((tmp_path / "x.json").read_text()) == {"a": [1.5, None], "b": {"c": None, "d": 3}}


def test_a_csv_names_columns_within_columns(tmp_path):
    report.write_csv(tmp_path / "x.csv", [{"n": 1, "seconds": {"min": 0.5, "median": 0.6}}])
    with (tmp_path / "x.csv").open() as file:
        assert list(csv.DictReader(file)) == [{"n": "1", "seconds.min": "0.5", "seconds.median": "0.6"}]


def test_timings_take_turns():
    calls = []
    found = report.interleaved([lambda: calls.append("a"), lambda: calls.append("b")], 0.0, repeats=3)
    assert "".join(calls)[4:] == "abbaab" and [len(seconds) for seconds in found] == [3, 3]
    assert report.min_and_median([3.0, 1.0, 2.0]) == {"min": 1.0, "median": 2.0}


def test_without_matplotlib_one_line_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(report.Lacking, match=r"needs matplotlib: pip install 'taichi_jello\[study\]'"):
        report.new_figure(3.0, 2.0)


def test_a_figure_is_the_same_file_twice(tmp_path):
    for name in ("one.png", "two.png"):
        figure = report.new_figure(2.0, 1.5)
        figure.add_subplot().plot([1, 2], [3, 4])
        report.save_figure(figure, tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
