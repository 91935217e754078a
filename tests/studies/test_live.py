"""Methods side by side: their drift in numbers, in a picture and in a film."""

import argparse
import contextlib
import json
import sys

import av
import numpy as np
import pytest

from taichi_jello import Box, Plane, Scene
from taichi_jello.studies import live
from taichi_jello.studies._report import Lacking, write_json

SCENE = Scene(jello=[Box(points=(4, 4, 4), position=(0.0, 0.8, 0.0), spin=(1.0, 2.0, 3.0))], collider=[Plane()])
METHODS = ("symplectic-euler", "rk4")


@pytest.fixture(scope="module")
def shown():
    chosen = argparse.Namespace(
        scene="x", load=lambda: SCENE, method=",".join(METHODS), seconds=0.1, quick=True, quiet=True, arch="cpu",
        precision="f32", threads=1, dt=None, substeps=20, json=None,
    )  # fmt: skip
    return live.measure(chosen)


def test_the_higher_order_drifts_less_at_the_same_step(shown):
    euler, rk4 = shown["methods"]
    assert (euler["method"], rk4["method"]) == METHODS and euler["dt"] == rk4["dt"] == pytest.approx(1 / 1200)
    assert rk4["drift"] < 0.1 * euler["drift"] and euler["stopped"] is None
    page = live.text(shown)
    assert all(name in page for name in METHODS) and "drift [mm]" in page


def test_the_more_drift_the_farther_from_blue(shown, tmp_path):
    with contextlib.closing(live.Tiles(shown)) as tiles:
        image = tiles.picture(6).astype(int)[60:600]  # between the words
    left, right = image[:, :640], image[:, 640:]
    unlike = np.abs(left - right).sum(-1) > 30  # springs that lie alike and are coloured otherwise
    greener = (left[..., 1] - left[..., 2])[unlike].mean() - (right[..., 1] - right[..., 2])[unlike].mean()
    assert unlike.sum() > 200 and greener > 30
    live.plot(shown, tmp_path / "x.png")
    assert (tmp_path / "x.png").read_bytes()[:4] == b"\x89PNG"


def test_a_film_has_all_frames(shown, tmp_path):
    live.plot(shown, tmp_path / "x.mp4")
    with av.open(str(tmp_path / "x.mp4")) as film:
        assert sum(1 for _ in film.decode(video=0)) == 7


def test_without_pyav_a_film_is_refused_in_one_line(shown, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(Lacking, match=r"needs PyAV: pip install"):
        live.plot(shown, tmp_path / "x.mp4")


def test_the_json_holds_the_drifts_and_no_moments(shown, tmp_path):
    write_json(tmp_path / "x.json", shown)
    told = json.loads((tmp_path / "x.json").read_text())
    assert len(told["methods"]) == 2 and not any(key.startswith("_") for key in told)
