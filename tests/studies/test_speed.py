"""The study of speed: what it measures, and what is left of it when it is interrupted."""

import argparse

import pytest

from taichi_jello.studies import speed
from taichi_jello.studies._speed import busy
from taichi_jello.support import runtime


def test_ctrl_c_keeps_what_was_measured(monkeypatch):
    found = [{"n": 8, "arch": "cpu", "precision": "f32", "threads": 1, "method": "rk4", "form": "team of 1",
              "us_per_pass": {"min": 20.0, "median": 21.0}, "million_springs_per_second": 300.0, "ns_per_spring": 3.2,
              "bytes_per_particle": 80.0}]  # fmt: skip

    def row(**_):
        if not found:
            raise KeyboardInterrupt
        return found.pop()

    monkeypatch.setattr(speed, "kernel_row", row)
    monkeypatch.setattr("taichi_jello.view.render.ggui.has_vulkan", lambda: False)
    told = speed.measure(argparse.Namespace(arch="cpu", threads=1, quick=True, quiet=True, json=None))
    told["window"] = speed.window_row("cpu", frames=1)
    told["skin"] = speed.skin_row("cpu", 0.0, 1)
    told["voxels"] = speed.voxel_row("cpu", 0.0, 1)
    told["crowd"] = {"seconds": 4.0, "threads": 2, "ms": 12.3, "worst_ms": 20.0, "last_ms": 10.0, "real_time_ms": 16.7,
                     "search_share": 0.21}  # fmt: skip
    told["busy"] = {"n": 32, "million_springs_per_second": {"one thread": 500.0, "watching": 450.0}, "of_the_best": 0.9}
    times = {"ms": 1.44, "median_ms": 1.1, "worst_ms": 9.0}
    told["thrown"] = [{"n": 16, "stiffness": 46666.7, "method": "adaptive"} | times]
    assert 30_000 < told["skin"]["points"] < 45_000 and told["skin"]["min_ms"] > 0.0
    assert 70_000 < told["voxels"]["triangles"] < 90_000
    page = speed.text(told)
    assert "window: not measured: no Vulkan driver works here" in page
    assert "16³ points, k = 4.67e+04 N/m" in page and "adaptive, 1.4 ms a frame in the mean" in page
    assert "12.3 ms a frame" in page and "contact search 21 % of it" in page
    assert "one thread 500, watching 450; watching is 0.90 of the best" in page
    assert "points carried along" in page and "voxelised at 48 cells" in page
    assert told["interrupted"] and "       300  " in page
    assert page.endswith("interrupted: the table holds what was measured until then")


@pytest.mark.parametrize("arch", ["cpu", "vulkan"])
def test_every_size_is_timed_on_one_thread_and_f64_where_there_is_one(arch):
    cases = list(speed.kernel_cases(arch, None, False))
    assert {case["n"] for case in cases if case["threads"] == 1} == {8, 16, 32, 64}
    assert any(case["precision"] == "f64" for case in cases) == (arch == "cpu")


@pytest.mark.skipif(len(runtime.usable_cores()) < 2, reason="on one core there is no team")
def test_beside_a_busy_process_that_is_ended(monkeypatch):
    begun, popen = [], busy.subprocess.Popen

    def begin(*arguments, **options):
        begun.append(popen(*arguments, **options))
        return begun[-1]

    monkeypatch.setattr(busy.subprocess, "Popen", begin)
    row = busy.busy_row("cpu", 6, 0.0, 2)
    assert [process.poll() is None for process in begun] == [False]
    rates = row["million_springs_per_second"]
    assert len(rates) == 4 and min(rates.values()) > 0.0
    best = max(rate for name, rate in rates.items() if name != "watching")
    assert row["of_the_best"] == pytest.approx(rates["watching"] / best)
    assert "beside a busy process, 6³ points" in busy.line(row)
    assert "not measured" in busy.line(busy.busy_row("vulkan", 6, 0.0, 2))

    def interrupted(*_):
        assert begun[-1].poll() is None
        raise KeyboardInterrupt

    monkeypatch.setattr(busy, "interleaved", interrupted)
    with pytest.raises(KeyboardInterrupt):
        busy.busy_row("cpu", 6, 0.0, 2)
    assert len(begun) == 2 and begun[-1].poll() is not None
