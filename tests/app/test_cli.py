"""The command line as a person uses it: a process, its files, its exit status and its lines."""

import json
import signal
import subprocess
import sys
import tempfile

import numpy as np
import pytest

from taichi_jello import Box, Scene, __version__
from taichi_jello.app import cli
from taichi_jello.studies._speed import scenes
from taichi_jello.support import runtime

SMALL = """
title = "Small"
seconds = 0.2
[[collider]]
type = "plane"
[[jello]]
shape = "box"
points = [3, 3, 3]
position = [0.0, 0.55, 0.0]
"""


@pytest.fixture
def small(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    return "small.toml"


def test_list_names_every_demo(jello):
    done = jello("list")
    assert done.returncode == 0
    names = [line.split()[0] for line in done.stdout.splitlines()]
    assert {"cube", "sphere", "room", "family"} <= set(names)


def test_run_writes_the_arrays_that_were_promised(jello, small, tmp_path):
    done = jello("run", small, "-o", "out.npz", "--every", "0.05")
    assert done.returncode == 0 and "out.npz" in done.stdout, done.stderr
    with np.load(tmp_path / "out.npz") as out:
        assert out["time"] == pytest.approx(np.arange(5) * 0.05, abs=1e-3)
        assert out["x"].shape == out["v"].shape == (5, 27, 3)
        springs = len(out["springs"])
        assert out["springs"].shape == (springs, 2) and out["surface"].shape[1] == 3
        for name in ("rest_length", "stiffness", "damping", "family"):
            assert out[name].shape == (springs,)
        assert out["mass"].shape == out["jello"].shape == (27,)
        for name in ("kinetic", "elastic", "gravity", "contact"):
            assert out[f"energy_{name}"].shape == (5,)
        assert float(out["dt"]) > 0 and str(out["method"]) == "rk4"
        assert out["energy_gravity"][0] == pytest.approx(9.81 * 0.55, rel=1e-5)


def test_a_run_cut_in_two_gives_the_same_bits(here, small, tmp_path):
    assert here("run", small, "-o", "whole.npz", "--seconds", "0.4").returncode == 0
    assert here("run", small, "-o", "first.npz", "--seconds", "0.15").returncode == 0
    done = here("run", small, "-o", "second.npz", "--seconds", "0.25", "--from", "first.npz")
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "whole.npz") as whole, np.load(tmp_path / "second.npz") as second:
        assert second["time"][-1] == pytest.approx(whole["time"][-1], abs=1e-12)
        assert np.array_equal(whole["x"][-1], second["x"][-1]) and np.array_equal(whole["v"][-1], second["v"][-1])


def test_bare_arrays_are_a_state_to_start_from(here, small, tmp_path):
    x = np.random.default_rng(1).uniform(0.5, 1.5, (27, 3))
    np.savez(tmp_path / "bare.npz", x=x, v=np.zeros((27, 3)))
    assert here("run", small, "-o", "out.npz", "--seconds", "0", "--from", "bare.npz").returncode == 0
    with np.load(tmp_path / "out.npz") as out:
        assert out["x"][0] == pytest.approx(x, abs=1e-6)


def test_options_reach_the_simulation(here, small, tmp_path):
    options = ("--method", "verlet", "--substeps", "50", "--precision", "f64", "--threads", "1")
    settings = ("--set", "jello.0.stiffness=50", "--set", "gravity=[0, 0, 0]", "--set", "title=Floating")
    done = here("explain", small, "--json", "facts.json", *options, *settings)
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "facts.json").read_text())
    assert told["title"] == "Floating" and told["precision"] == "f64" and told["substeps"] == 50
    assert "gravity" in told["left_out"] and "verlet" in told["compiled_in"]
    assert told["springs"] == {"structural": 54, "shear": 72 + 32, "bend": 27}
    # 26 springs meet in the middle particle of mass 1/27: Λ m/k is at most twice its degree.
    assert 0 < told["bound"]["forces"]["springs"]["squared_frequency"] <= 2 * 32 * 50 * 27
    for words in ("compiled in:", "left out:", "contact", "27 particles", "safe dt"):
        assert words in done.stdout


def test_whole_lists_of_tables_can_be_set(here, small, tmp_path):
    settings = ("--set", 'collider=[{type="sphere", radius=0.2}]', "--set", "jello.0.pin=[{max=[1, 0, 1]}]")
    assert here("explain", small, "--json", "facts.json", *settings).returncode == 0
    told = json.loads((tmp_path / "facts.json").read_text())
    assert {"sweep", "pins"} <= set(told["compiled_in"])


def test_shot_writes_a_picture_of_the_size_asked_for(here, small, tmp_path):
    for renderer in ("auto", "raster"):
        done = here("shot", small, "-o", "x.png", "--size", "320x200", "--at", "0.1", "--renderer", renderer)
        assert done.returncode == 0, done.stderr
        data = (tmp_path / "x.png").read_bytes()
        assert data[:8] == b"\x89PNG\r\n\x1a\n"
        assert (int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")) == (320, 200)
    assert not list(tmp_path.glob("imgui.ini"))


def test_play_without_a_screen_says_so_and_names_its_picture(jello, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = jello("play", "family", "--size", "320x200")
    assert done.returncode == 0, done.stderr
    assert "no window:" in done.stdout
    named = done.stdout.splitlines()[-1]
    assert named == str((tmp_path / "family.png").resolve()) and (tmp_path / "family.png").is_file()
    done = jello("play", "family", "--size", "320x200")
    assert done.stdout.splitlines()[-1] == str((tmp_path / "family-2.png").resolve())  # nothing is overwritten


def test_a_state_of_another_scene_is_no_state_to_start_from(here, small, tmp_path):
    assert here("run", small, "-o", "small.npz", "--seconds", "0").stdout.startswith("small.npz: 1 moment to 0 s")
    for setting, word in (("jello.0.size=[1, 1, 2]", "rest_length"), ('jello.0.springs=["structural"]', "springs")):
        done = here("run", small, "-o", "x.npz", "--set", setting, "--from", "small.npz")
        assert done.returncode == 2 and f"{word}: expected a state of this scene" in done.stderr
        assert len(done.stderr.splitlines()) == 1
    # Another material in the same shape may go on from there.
    settings = ("--set", "jello.0.stiffness.shear=70", "--seconds", "0.01")
    assert here("run", small, "-o", "x.npz", *settings, "--from", "small.npz").returncode == 0
    with np.load(tmp_path / "x.npz") as out:
        assert {(f, k) for f, k in zip(out["family"], out["stiffness"], strict=True)} == {(0, 200), (1, 70), (2, 200)}


def test_a_long_step_warns_once(jello, small):
    done = jello("run", small, "-o", "out.npz", "--dt", "0.01", "--seconds", "0")
    assert done.returncode == 0
    assert done.stderr.count("beyond the largest safe step of rk4") == 1 and len(done.stderr.splitlines()) == 1


def test_a_method_whose_steps_are_long_is_told(here, small):
    told = "method: backward-euler; swings faster than "
    arguments = "run", small, "-o", "out.npz", "--seconds", "0"
    done = here(*arguments, "--method", "backward-euler")
    assert done.returncode == 0 and (done.stdout + done.stderr).count(told) == 1, done.stderr
    done = here(*arguments, "--method", "backward-euler", "--quiet")
    assert done.returncode == 0 and "method:" not in done.stdout + done.stderr
    done = here(*arguments)
    assert done.returncode == 0 and "method:" not in done.stdout + done.stderr
    done = here(*arguments, "--set", "jello.0.stiffness=1e9")
    assert "method: adaptive, since a frame takes rk4" in done.stdout + done.stderr


def test_a_step_longer_than_a_frame_is_told(jello, small):
    done = jello("run", small, "-o", "out.npz", "--dt", "0.1", "--seconds", "0")
    assert done.returncode == 0
    assert done.stderr.count("dt = 0.1 s is longer than a frame: steps are 0.0167 s") == 1


def test_bad_numbers_exit_with_3_and_keep_the_last_good_state(here, small, tmp_path):
    done = here("run", small, "-o", "out.npz", "--dt", "0.016", "--set", "jello.0.stiffness=5000", "--seconds", "5")
    assert done.returncode == 3
    assert "Traceback" not in done.stderr
    last = done.stderr.splitlines()[-1]
    for words in ("numbers went bad at", "particle", "jello 0", "dt = ", "safe dt = ", "spring between particles"):
        assert words in last
    with np.load(tmp_path / "out.npz") as out:
        assert np.isfinite(out["x"]).all() and len(out["time"]) >= 1
    # The saved state is one to go on from, with a step that is safe.
    assert here("run", small, "-o", "on.npz", "--seconds", "0.01", "--from", "out.npz").returncode == 0
    done = here("shot", small, "-o", "x.png", "--at", "0", "--from", "on.npz")
    assert done.returncode == 2 and "--at 0: expected at least" in done.stderr


def test_without_a_window_there_is_nothing_to_record(here, small, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    done = here("play", small, "--log", "play.jsonl")
    assert done.returncode == 2 and "nothing to record without a window" in done.stderr
    assert not list(tmp_path.glob("*.jsonl")) and not list(tmp_path.glob("*.png"))


@pytest.mark.parametrize("command", [["shot", "-o", "x.png", "--at", "2"], ["play"]])
def test_a_picture_of_bad_numbers_keeps_the_last_good_state(command, jello, small, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    done = jello(command[0], small, *command[1:], "--dt", "0.016", "--set", "jello.0.stiffness=5000")
    assert done.returncode == 3 and "Traceback" not in done.stderr
    (kept,) = tmp_path.glob("*.last-good.npz")
    assert kept.name in done.stderr and not list(tmp_path.glob("*.png"))
    with np.load(kept) as out:
        assert np.isfinite(out["x"]).all() and len(out["time"]) == 1


def test_vulkan_runs_the_same_kernels_and_gpu_takes_no_software_driver(jello, small, tmp_path):
    assert jello("run", small, "-o", "cpu.npz", "--seconds", "0.3").returncode == 0
    done = jello("run", small, "-o", "vulkan.npz", "--seconds", "0.3", "--arch", "vulkan")
    if runtime.vulkan_device_types():
        assert done.returncode == 0, done.stderr
        with np.load(tmp_path / "cpu.npz") as one, np.load(tmp_path / "vulkan.npz") as other:
            # After a bounce, two roundings of f32 apart at each of some 50 steps.
            assert one["x"] == pytest.approx(other["x"], abs=1e-4)
        done = jello("run", "stack", "-o", "stack.npz", "--arch", "vulkan")
        assert done.returncode == 2 and "jellos do not feel each other there" in done.stderr
    else:
        assert done.returncode == 2 and "no vulkan device" in done.stderr
    done = jello("run", small, "-o", "gpu.npz", "--arch", "gpu")
    if not runtime.has_real_vulkan() and done.returncode:
        assert done.returncode == 2 and "a software Vulkan driver is not one" in done.stderr
    else:
        assert done.returncode == 0, done.stderr


def test_the_version_is_told(capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["--version"])
    assert end.value.code == 0 and capsys.readouterr().out == f"taichi_jello {__version__}\n"


def test_a_folder_that_takes_no_files_is_told_before_the_run(tmp_path, monkeypatch, capsys):
    def full(**_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    assert cli.main(["run", "cube", "-o", str(tmp_path / "x.npz")]) == 2
    told = f"jello: -o {tmp_path / 'x.npz'}: its folder takes no files: No space left on device\n"
    assert capsys.readouterr().err == told


MISTAKES = [
    (
        ("run", "cube", "-o", "x.npz", "--seconds", "-1"),
        "--seconds: expected a number of at least 0, at most 1e+12, got '-1'",
    ),
    (("run", "cake", "-o", "x.npz"), "cake: expected a demo"),
    (("run", "nothing.toml", "-o", "x.npz"), "nothing.toml: there is no such file"),
    (("run", "small.toml", "-o", "x.npz", "--method", "leapfrog"), "solver.method: expected one of"),
    (("run", "small.toml", "-o", "x.npz", "--dt", "0"), "--dt: expected a number greater than 0"),
    (("run", "small.toml", "-o", "x.npz", "--seconds", "nan"), "--seconds: expected a number of at least 0"),
    (("run", "small.toml", "-o", "x.npz", "--threads", "0"), "--threads: expected a whole number of at least 1"),
    (("run", "small.toml", "-o", "x.png"), "expected a name ending in .npz"),
    (("run", "small.toml", "-o", "no/such/x.npz"), "expected a file in a folder that exists"),
    (("run", "small.toml", "-o", "x.npz", "--set", "jello.0.mass=-1"), "--set jello.0.mass: expected"),
    (("run", "small.toml", "-o", "x.npz", "--set", "jello.0.colour=red"), "--set jello.0.colour: unknown key"),
    (("run", "small.toml", "-o", "x.npz", "--set", "mass"), "expected key.path=value"),
    (
        ("run", "small.toml", "-o", "x.npz", "--set", "jello.0.pin.0.max=[1, 0, 1]"),
        "--set jello.0.pin.0: the scene",
    ),
    (
        ("run", "small.toml", "-o", "x.npz", "--set", "jello.0.keyframe=[{time=0, stifness=1}]"),
        "--set jello.0.keyframe.0.stifness: unknown key, expected one of time, stiffness",
    ),
    (
        ("run", "small.toml", "-o", "x.npz", "--set", 'collider=[{type="plne"}]'),
        "--set collider.0.type: expected one of block, plane, box, sphere, got 'plne'",
    ),
    (("run", "small.toml", "-o", "x.npz", "--from", "none.npz"), "--from none.npz: No such file"),
    (("run", "small.toml", "-o", "x.npz", "--from", "small.toml"), "--from small.toml: expected an NPZ file"),
    (("run", "small.toml"), "the following arguments are required: -o"),
    (("shot", "small.toml", "-o", "x.png", "--size", "0x9"), "expected WIDTHxHEIGHT"),
    (("shot", "small.toml", "-o", "x.png", "--arch", "tpu"), "invalid choice: 'tpu'"),
    (("explain", "small.toml", "--json", "no/such.json"), "--json no/such.json: No such file"),
    (("study", "beauty"), "study: expected one of"),
    (("run", "small.toml", "-o", "x.npz", "--plot", "no/x.png"), "--plot no/x.png: expected a file in a folder"),
    (("study", "accuracy", "--method", "rk5"), "solver.method: expected one of"),
    (("study", "speed", "--plot", "x.png"), "--plot: the study speed has none"),
    (("study", "live", "--poses", "3"), "--poses: the study live has none"),
    (("study", "contact", "--poses", "0"), "--poses: expected a whole number of at least 1, got '0'"),
    (("study", "contact", "ring", "knot"), "study contact: expected shapes, of box, slab, bar, ball, ring, sheet"),
    (("dance",), "invalid choice: 'dance'"),
]


@pytest.mark.parametrize("call, words", MISTAKES, ids=[" ".join(call) for call, _ in MISTAKES])
def test_a_mistake_is_one_line_and_leaves_nothing_behind(here, small, tmp_path, call, words):
    done = here(*call)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1 and words in done.stderr, done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["small.toml"]


@pytest.mark.parametrize("call, words", [MISTAKES[1], MISTAKES[-1]], ids=["of the program", "of the parser"])
def test_a_mistake_is_one_line_of_a_process_too(jello, small, tmp_path, call, words):
    done = jello(*call)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1 and words in done.stderr, done.stderr
    assert "Traceback" not in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["small.toml"]


def test_code_that_fails_in_a_python_scene_is_one_line(here, tmp_path):
    """Also where it runs after the scene is loaded."""
    begin = (
        "from taichi_jello import *\nfrom taichi_jello.scene.description import Jello\nclass Z(Jello):\n  shape = 'z'\n"
    )
    end = "\ndef scene(): return Scene(jello=[Z()])\n"
    for body, words in (
        ("", "jello.0: expected Z to define body()"),
        ("  def body(self): return 1 / 0", "line 5: it fails with ZeroDivisionError: division by zero"),
        ("  def body(self): return 'a\\n'", r"jello.0: expected Z.body() to return a Body, got 'a\n'"),
    ):
        (tmp_path / "own.py").write_text(begin + body + end)
        done = here("run", "own.py", "-o", "x.npz")
        assert done.returncode == 2 and done.stderr == f"jello: own.py: {words}\n"


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is sent in another way there")
def test_ctrl_c_ends_a_python_scene_that_does_not_end(tmp_path):
    (tmp_path / "never.py").write_text("print('begun', flush=True)\nwhile True: pass\n")
    command = [sys.executable, "-m", "taichi_jello", "run", "never.py", "-o", "x.npz"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    with process:
        assert process.stdout.readline() == "begun\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 130
        assert process.stderr.read() in [f"jello: never.py: line {k}: stopped while it was loaded\n" for k in (1, 2)]


def test_a_room_smaller_than_the_jello_is_refused(here, small, tmp_path):
    (tmp_path / "small.toml").write_text(SMALL.replace('"plane"', '"box"\nmax = [0.3, 0.9, 2.0]'))
    done = here("explain", "small.toml")
    assert done.returncode == 2 and "small.toml: line 4: collider.0: expected a box around jello.0" in done.stderr


def test_study_speed_measures_and_writes_json(here, tmp_path, monkeypatch):
    """With two cubes in place of the demo `crowd`, which takes long to compile."""
    cubes = [Box(points=(2, 2, 2), position=(x, 0.0, 0.0)) for x in (0.0, 0.9)]
    monkeypatch.setattr(scenes, "load", {"crowd": Scene(jello=cubes)}.get)
    done = here("study", "speed", "--quick", "--json", "speed.json")
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "speed.json").read_text())
    assert {row["n"] for row in told["kernels"]} == {4, 8}
    for row in told["kernels"]:
        assert row["us_per_pass"]["median"] >= row["us_per_pass"]["min"] > 0
        # A plain explicit f32 scene from 8³ on stays below 400 bytes a particle.
        assert row["bytes_per_particle"] < 400 or row["n"] < 8 or row["precision"] == "f64"
    cube = next(row for row in told["kernels"] if row["n"] == 8 and row["threads"] == 1)
    numpy = next(row for row in told["numpy_gather"] if row["n"] == 8)
    assert cube["million_springs_per_second"] > 10 * numpy["million_springs_per_second"]
    assert {row["renderer"] for row in told["renderers"]} >= {"raster"}


def test_a_ledger_is_kept_and_drawn_where_it_is_asked_for(here, small, tmp_path):
    done = here("run", small, "-o", "out.npz", "--plot", "out.png")
    assert done.returncode == 0 and "work [J]" in done.stdout and "residual" in done.stdout, done.stderr
    assert (tmp_path / "out.png").read_bytes()[:4] == b"\x89PNG"
    with np.load(tmp_path / "out.npz") as out:
        energy = sum(out[f"energy_{kind}"] for kind in ("kinetic", "elastic", "gravity", "contact"))
        work = sum(out[name] for name in out.files if name.startswith("work_"))
        assert {"work_dashpots", "work_friction", "work_contact_dashpots"} <= set(out.files)
        assert out["energy_residual"] == pytest.approx(energy - energy[0] - work, abs=1e-9)
        assert work[-1] < 0.0
