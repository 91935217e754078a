"""The guide's figures come from the files beside its pictures, and one command makes them."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from taichi_jello.studies import __main__ as regenerate
from taichi_jello.studies import accuracy
from taichi_jello.studies._accuracy import cases as cases

ROOT = Path(__file__).parents[2]


def test_one_command_makes_picture_figures_and_table(tmp_path, capsys, monkeypatch):
    smooth = cases.built_in(True)["smooth"]
    small = replace(smooth, scene=replace(smooth.scene, jello=[replace(smooth.scene.jello[0], points=(3, 3, 3))]))
    monkeypatch.setattr(accuracy, "default", lambda quick: [small])
    monkeypatch.setattr(accuracy, "SECONDS", {True: 0.3})
    readme = tmp_path / "README.md"
    readme.write_text("before\n<!-- accuracy -->\nold\n<!-- end -->\nafter\n")
    options = ["--quick", "--only", "accuracy", "--method", "rk4"]
    assert regenerate.main([str(tmp_path), str(readme), *options]) == 0
    told = json.loads((tmp_path / "accuracy.json").read_text())
    page = readme.read_text()
    assert page.startswith("before\n<!-- accuracy -->\n| case |") and page.endswith("<!-- end -->\nafter\n")
    assert "| rk4 f" in page and "old" not in page and told["cases"][0]["case"] in page
    assert (tmp_path / "accuracy.png").read_bytes()[:4] == b"\x89PNG"
    assert [(p["method"], p["precision"]) for p in told["cases"][0]["points"]][:1] == [("rk4", "f64")]
    assert "To be within 1 mm" in capsys.readouterr().out


def test_all_studies_are_made_anew_and_the_longest_one_in_its_short_form(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(regenerate, "jello", lambda call: calls.append(call) or 0)
    assert regenerate.main([str(tmp_path)]) == 0
    assert {"accuracy", "speed", "stability", "stress"} <= {call[1] for call in calls}
    assert [call[1] for call in calls if "--quick" in call] == ["stress"]


def test_a_readme_without_marks_is_named(tmp_path):
    (tmp_path / "x.md").write_text("nothing here")
    with pytest.raises(ValueError, match=r"x\.md: expected the lines <!-- accuracy --> and <!-- end -->"):
        regenerate.put_table(tmp_path / "x.md", "accuracy", "")


@pytest.mark.parametrize("name", regenerate.TABLES)
def test_the_guide_s_tables_are_what_the_committed_figures_say(name):
    told = json.loads((ROOT / "shots" / f"{name}.json").read_text())
    assert regenerate.TABLES[name](told) in (ROOT / "taichi_jello" / "studies" / "README.md").read_text()
