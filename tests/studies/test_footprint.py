"""What is left out costs nothing."""

import argparse
import json

import numpy as np
import pytest

from taichi_jello.studies import footprint

CHOSEN = argparse.Namespace(arch="cpu", precision="f32", threads=1, method=None, quick=True, settings=[])


@pytest.mark.parametrize("feature", footprint.FEATURES, ids=lambda feature: feature.name)
def test_an_unused_feature_adds_no_byte_and_no_code(feature, monkeypatch):
    monkeypatch.setattr(footprint.report, "interleaved", lambda runs, *_: [[1.0, 1.0] for _ in runs])
    row = footprint.feature_row(feature, CHOSEN)
    assert row["unused_bytes"] == 0 and row["same_code"]


def test_what_a_feature_adds_is_told_from_turns_on_the_same_machine():
    """One that slows down twofold, and stops once, says nothing of either scene."""
    assert footprint.added([1.01, 2.02, 2.02], [1.0, 2.0, 9.0])[0] == pytest.approx(0.01)


def test_how_well_it_is_known_holds_for_the_median_of_any_spread():
    """Of timings that are stopped now and then, for long: at 95 %, within what chance gives in 1000 tries."""
    chance = np.random.default_rng(1)
    told = []
    for _ in range(1000):
        stopped = chance.pareto(1.5, (2, footprint.REPEATS))
        told.append(footprint.added(list(1.01 * (1.0 + stopped[0])), list(1.0 + stopped[1])))
    median, within = np.transpose(told)
    held = np.mean(abs(median - 0.01) <= within)
    assert 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / 1000) <= held


def test_it_is_timed_on_until_it_is_known_well_enough(monkeypatch):
    noisy, quiet = [[1.0, 1.0, 1.0], [1.2, 1.0, 0.8], [1.0, 1.0, 1.0]], [[1.0] * 300] * 3
    rounds = [quiet, *[noisy] * footprint.MIN_ROUNDS]
    monkeypatch.setattr(footprint.report, "interleaved", lambda *_: rounds.pop())
    row = footprint.feature_row(footprint.FEATURES[0], argparse.Namespace(**{**vars(CHOSEN), "quick": False}))
    assert not rounds and row["turns"] == 300 + 3 * footprint.MIN_ROUNDS and row["unused_costs_within"] == 0.0


def test_on_the_command_line_each_scene_is_compiled_with_an_empty_cache(jello, tmp_path):
    (tmp_path / "one.toml").write_text('collider = []\n[[jello]]\nshape = "box"\npoints = [2, 2, 2]\n')
    done = jello("study", "footprint", "one.toml", "--set", "drag=0.1", "--json", "x.json")
    assert done.returncode == 0, done.stderr
    (row,) = json.loads((tmp_path / "x.json").read_text())["scenes"]
    assert row["particles"] == 8 and {"springs", "drag", "gravity", "rk4"} <= set(row["compiled_in"])
    assert "contact" in row["left_out"] and row["bytes"] > 0
    # Filling the fields, the step and reading the state back: nothing else is compiled to run a scene.
    assert row["kernels"] == 3
    assert row["warm_seconds"] > 0.0 and row["cold_seconds"] > 0.0 and row["ms_a_frame"] > 0.0
    assert "without " in done.stdout


def test_a_study_of_one_scene_takes_no_two(jello):
    done = jello("study", "accuracy", "cube", "room")
    assert done.returncode == 2 and "study accuracy: expected one scene, got cube, room" in done.stderr
