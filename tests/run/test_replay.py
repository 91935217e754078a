"""A play that was recorded gives the same bits again, and a file that is none says so."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from taichi_jello import Box, CallableField, Camera, Grab, GridField, Plane, Scene, Simulation, Sphere
from taichi_jello.run import replay
from taichi_jello.run.replay import CALLS, Recorded, Replay, Replayed, ReplayError, ReplayOver, fingerprint, playable
from taichi_jello.support import runtime

SCENE = playable(
    Scene(
        jello=[Box(points=(4, 4, 4), position=(0.0, 0.8, 0.0))],
        collider=[Plane(), Sphere(center=(0.0, 0.0, 0.2), radius=0.3, swing=(0.3, 0.0, 0.0), period=0.7)],
    )
)


@pytest.fixture(autouse=True)
def taichi(best_precision, anew):
    anew()


def gust(x, v, t):
    return x


def play(simulation):
    """Everything a person can do, some of it twice."""
    for frame in range(40):
        if frame == 5:
            simulation.grab([3, 7, 12], [0.2, 0.5, 0.3], [0.1, 1.0, 0.0])
        if 5 < frame < 15:
            simulation.move_grab([0.1, 1.0 + 0.05 * frame, 0.02 * frame])
        if frame == 15:
            simulation.release()
            simulation.push((0.5, 1.0, 0.0), 0)
        if frame == 20:
            simulation.tune(stiffness=3.0, gravity=(0.0, 2.0, 0.0), friction=0.1, wind=(2.0, 0.0, -1.0))
        if frame == 25:
            simulation.change_method("symplectic-euler")
        if frame == 27:
            simulation.change_step(substeps=200)
        if frame == 30:
            simulation.reset()
            simulation.grab([0], [1.0], np.array([0.0, 2.0, 0.0]))
        simulation.frame()


def test_replay_gives_the_same_bits(tmp_path):
    first = Recorded(Simulation(SCENE), tmp_path / "play.jsonl")
    play(first)
    first.energies()  # looking changes nothing
    first.close()
    again = Simulation(SCENE)
    replayed = Replayed(again, Replay(tmp_path / "play.jsonl"))
    replayed.step(17)
    assert replayed.frames == 17 and replayed.repeating
    replayed.advance(100.0)
    assert replayed.frames == 40 and replayed.time == 40 * replayed.dt  # the clock was set back at frame 30
    assert np.array_equal(first.x, again.x) and np.array_equal(first.v, again.v) and again.time == first.time
    with pytest.raises(ReplayOver):
        replayed.frame()
    assert replayed.repeating and again.time == first.time
    replayed.frame()  # who insists begins a new run
    assert not replayed.repeating and again.time > first.time


def test_a_play_that_was_killed_replays_up_to_its_last_call_or_second(tmp_path):
    first = Recorded(Simulation(SCENE), tmp_path / "play.jsonl")
    play(first)
    assert Replay(tmp_path / "play.jsonl").frames == 30
    for _ in range(50):
        first.frame()
    assert Replay(tmp_path / "play.jsonl").frames == 60


def test_every_way_to_change_a_simulation_is_recorded():
    """Whoever adds a public method decides: it changes how the simulation goes on and is one of CALLS, or not."""
    others = {"advance", "energies", "frame", "render", "restore", "snapshot", "step"}
    public = {name for name, member in vars(Simulation).items() if callable(member) and not name.startswith("_")}
    assert public == others | set(CALLS)


def test_a_fingerprint_is_of_what_a_scene_does(tmp_path):
    """The same in another process, for functions too; another one for any other number, deep in an array too; and a
    key that nobody set changes nothing."""
    values = np.zeros((12, 12, 12, 3))
    other = values.copy()
    other[5, 5, 5, 1] = 1.0

    def made(field, **more):
        return Scene(jello=[Box(points=(4, 4, 4), **more)], force=[field])

    scenes = [
        made(GridField(values=values)),
        made(GridField(values=other)),
        made(CallableField(function=gust)),
        made(Grab()),
        made(Grab(), stiffness={"structural": 5.0}),
    ]
    prints = [fingerprint(scene) for scene in scenes]
    assert len(set(prints)) == len(prints)
    assert fingerprint(made(Grab(), stiffness=200.0)) == prints[3]
    assert fingerprint(replace(scenes[3], title="x", seconds=1.0, camera=Camera(color="plain"))) == prints[3]
    told = "from taichi_jello import *; from taichi_jello.run.replay import fingerprint; "
    told += "print(fingerprint(Scene(jello=[Box(points=(4, 4, 4))], force=[Grab()])))"
    again = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True).stdout
    assert again.strip() == prints[3]


def test_whoever_takes_the_mouse_begins_a_new_run(tmp_path):
    first = Recorded(Simulation(SCENE), tmp_path / "play.jsonl")
    play(first)
    first.close()
    replayed = Replayed(Simulation(SCENE), Replay(tmp_path / "play.jsonl"))
    replayed.step(10)
    assert replayed.held is not None and replayed.repeating
    replayed.release()
    for _ in range(10):
        replayed.frame()
    assert replayed.held is None and not replayed.repeating and replayed.tuning["stiffness"] == 1.0


def test_the_recorded_hand_lets_go_where_somebody_else_takes_over(tmp_path):
    first = Recorded(Simulation(SCENE), tmp_path / "play.jsonl")
    play(first)
    first.close()
    replayed = Replayed(Simulation(SCENE), Replay(tmp_path / "play.jsonl"))
    replayed.step(10)
    replayed.push((0.0, 1.0, 0.0))
    assert replayed.held is None and not replayed.repeating


def test_going_back_and_forth_in_a_play_passes_the_same_states(tmp_path, monkeypatch):
    """Also where a call changed the method, the numbers or the grip, and with few moments kept."""
    first = Recorded(Simulation(SCENE), tmp_path / "play.jsonl")
    play(first)
    first.close()
    monkeypatch.setattr(replay, "BUDGET", 10 * 2 * 64 * 3 * 8)
    replayed = Replayed(Simulation(SCENE), Replay(tmp_path / "play.jsonl"))
    straight = {}
    for frame in range(1, 41):
        replayed.step()
        straight[frame] = replayed.simulation.snapshot()
    assert 2 <= len(replayed._kept) <= 11
    for wanted in (12, 27, 3, 33, 18, 40):
        replayed.scrub(wanted - replayed.frames)
        assert replayed.frames == wanted and replayed.repeating
        now, then = replayed.simulation.snapshot(), straight[wanted]
        assert np.array_equal(now.x, then.x) and np.array_equal(now.v, then.v) and now.time == then.time
    assert np.array_equal(now.x, first.x) and np.array_equal(now.v, first.v)
    replayed.scrub(-1000)
    assert replayed.frames == 0 and np.array_equal(replayed.x, replayed.start.x)
    replayed.scrub(1000)
    assert replayed.frames == 40 and replayed.repeating


def test_refused_calls_leave_no_trace(tmp_path):
    recorded = Recorded(Simulation(SCENE), tmp_path / "play.jsonl")
    with pytest.raises(ValueError, match="stiffness: expected"):
        recorded.tune(stiffness=-1.0)
    with pytest.raises(ValueError, match="particles: expected 1 to 24"):
        recorded.grab([99], [1.0], (0.0, 0.0, 0.0))
    recorded.close()
    assert [call["call"] for call in Replay(tmp_path / "play.jsonl").calls] == ["end"]


def test_files_that_are_no_play_of_this_scene(tmp_path):
    path = tmp_path / "play.jsonl"
    for text, words in (
        ("", "expected a recorded play"),
        ("[1, 2]\n", "expected a recorded play"),
        ('{"jello_play": 99}\n', "expected format 2, got 99"),
        ('{"jello_play": 2}\n{"frame": 0, "call": "explode"}\n', "line 2: expected a call"),
        ('{"jello_play": 2}\n{"frame": 0, "call": "push", "with": [[NaN, 0, 0]]}\n', "line 2: expected a call of a"),
    ):
        path.write_text(text)
        with pytest.raises(ReplayError, match=words):
            Replay(path)
    recorded = Recorded(Simulation(SCENE), path)
    recorded.close()
    other = replace(SCENE, jello=[Box(points=(4, 4, 4), position=(0.0, 0.9, 0.0))])
    with pytest.raises(ReplayError, match="another scene"):
        Replayed(Simulation(other), Replay(path))
    newer = json.loads(path.read_text().splitlines()[0]) | {"version": "99.0"}
    (tmp_path / "newer.jsonl").write_text(json.dumps(newer) + "\n")
    with pytest.raises(ReplayError, match=r"version '99\.0', this is"):
        Replayed(Simulation(SCENE), Replay(tmp_path / "newer.jsonl"))
    with pytest.raises(ReplayError, match="method 'rk4', this is 'verlet'"):
        Replay(path).check(Simulation(SCENE, method="verlet"))
    assert json.loads(path.read_text().splitlines()[0])["jello_play"] == 2
    call = {"frame": 0, "call": "tune", "with": [], "named": {"stiffness": -1.0}}
    path.write_text(f"{path.read_text()}{json.dumps(call)}\n{json.dumps({'frame': 1, 'call': 'end'})}\n")
    with pytest.raises(ReplayError, match="line 3: tune: stiffness: expected"):
        Replayed(Simulation(SCENE), Replay(path)).frame()


TOML = """
[[jello]]
shape = "box"
points = [4, 4, 4]
position = [0.0, 0.8, 0.0]
[[collider]]
type = "plane"
[[collider]]
type = "sphere"
center = [0.0, 0.0, 0.2]
radius = 0.3
swing = [0.3, 0.0, 0.0]
period = 0.7
"""


def test_the_command_line_repeats_a_play(tmp_path, request):
    """jello run --replay ends in the recorded bits; shot and video draw on the way; another scene is refused."""
    (tmp_path / "scene.toml").write_text(TOML)
    first = Recorded(Simulation(SCENE), tmp_path / "play.jsonl")
    play(first)
    first.close()

    def jello(*words):
        command = [sys.executable, "-m", "taichi_jello", words[0], "scene.toml", "--replay", "play.jsonl", *words[1:]]
        options = ["--arch", runtime.current().arch, "--precision", runtime.current().precision]
        return subprocess.run([*command, *options], cwd=tmp_path, capture_output=True, text=True)

    done = jello("run", "-o", "out.npz", "--every", "0.1")
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "out.npz") as out:
        assert len(out["time"]) == 1 + 40 // 6 + 1
        assert np.array_equal(out["x"][-1], first.x) and np.array_equal(out["v"][-1], first.v)
    renderer = ["--renderer", "raster"] if runtime.current().on_cpu else []
    assert jello("shot", "-o", "x.png", "--at", "0.3", "--size", "160x90", *renderer).returncode == 0
    done = jello("video", "-o", "x-%02d.ply", "--fps", "10")
    assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.glob("x-*.ply"))) == round(40 / 60 * 10)
    for words, told in (
        (["--set", "jello.0.stiffness=300"], "play.jsonl: was played with another scene"),
        (["--from", "out.npz"], "give one of --from and --replay"),
        (["--replay", "none.jsonl"], "--replay none.jsonl: No such file"),
        (["--replay", "scene.toml"], "expected a recorded play"),
    ):
        done = jello("run", "-o", "no.npz", *words)
        assert done.returncode == 2 and told in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr
    assert not (tmp_path / "no.npz").exists()
    done = jello("shot", "-o", "no.png", "--at", "0")
    assert done.returncode == 0  # before anything was done
