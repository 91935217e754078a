"""The study of stable steps: limits found on the lattice are those of theory, and what a person sees."""

import argparse

import pytest

from taichi_jello.scene.description import SceneError
from taichi_jello.studies import stability
from taichi_jello.support import runtime

QUICK = {"quick": True, "quiet": True, "arch": "cpu", "threads": 1, "json": None}


@pytest.fixture(scope="module")
def told():
    """Two methods with a limit, one of which has none without damping, and one that is stable at every step."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stability, "STIFFNESS", {True: [1.0, 1e8]})
        patch.setattr(stability, "DAMPING", {True: [0.0, 0.2]})
        return stability.measure(argparse.Namespace(method="euler,symplectic-euler,xpbd", **QUICK))


def test_limits_are_those_of_theory_and_auto_stays_below(told):
    """Euler 2ζ; symplectic Euler 2(√(1 + ζ²) - ζ), within half of the last interval of the bisection, 0.4 %."""
    limits = {(r["method"], r["zeta"]): r["measured"] * r["omega"] for r in told["rows"] if r["found"] == "limit"}
    exact = {("euler", 0.2): 0.4, ("symplectic-euler", 0.0): 2.0, ("symplectic-euler", 0.2): 1.63961}
    assert limits == {key: pytest.approx(value, rel=0.005) for key, value in exact.items()}
    assert all(row["auto"] < row["measured"] for row in told["rows"] if row["found"] == "limit")
    found = {(row["method"], row["zeta"]): row["found"] for row in told["rows"]}
    assert found["euler", 0.0] == "grows" and found["xpbd", 0.0] == found["xpbd", 0.2] == "none"
    assert len(told["rows"]) == 12 and not told["interrupted"]


def test_figures_become_a_page_lines_and_a_picture(told, tmp_path):
    page = stability.text(told)
    for words in ("grows at every step", "none up to dt = 0.033 s", "6 limits, at most 0.", "beyond 0 of them"):
        assert words in page
    assert len(stability.rows(told)) == 12
    stability.plot(told, tmp_path / "stability.png")
    assert (tmp_path / "stability.png").stat().st_size > 10_000
    wrong = told["rows"][0] | {"found": None}
    assert "not as in theory: euler at k = 1, ratio 0" in stability.text(told | {"rows": [wrong], "interrupted": True})


def test_ctrl_c_keeps_what_was_measured(monkeypatch):
    def stopped(methods, chosen, told):
        told["rows"].append({"method": "euler", "zeta": 0.0})
        yield
        raise KeyboardInterrupt

    monkeypatch.setattr(stability, "pieces", stopped)
    told = stability.measure(argparse.Namespace(method=None, **QUICK))
    assert told["interrupted"] and len(told["rows"]) == 1


def test_an_unknown_method_is_named():
    with pytest.raises(SceneError, match="got 'rk5'"):
        stability.measure(argparse.Namespace(method="rk4,rk5", **QUICK))


def test_in_float32_the_limit_is_the_same():
    runtime.start("cpu", "f32")
    bench = stability.Bench("symplectic-euler", 1000)
    row = bench.row(1e4, 0.2)
    assert row["measured"] == pytest.approx(row["theory"], rel=0.01)
