"""Films as a person makes them, decoded again: their frames, their times, and what is left when one ends early."""

import re
import signal
import subprocess
import sys
import time
from fractions import Fraction

import numpy as np
import pytest

from taichi_jello import Simulation, scenefiles
from taichi_jello.film import Film, FilmProblem, Mesh
from taichi_jello.support import runtime

SMALL = """
title = "Small"
seconds = 0.2
[camera]
eye = [1.6, 1.2, 2.4]
target = [0.0, 0.6, 0.0]
[[collider]]
type = "plane"
[[jello]]
shape = "box"
points = [3, 3, 3]
position = [0.0, 1.0, 0.0]
velocity = [0.0, -3.0, 0.0]
"""
SIZE = (160, 120)
SMALL_SIZE = ("--size", "160x120", "--renderer", "raster")


@pytest.fixture
def small(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    return "small.toml"


@pytest.fixture
def simulation(small, tmp_path):
    """The same scene in this process."""
    runtime.start("cpu", "f32")
    return Simulation(scenefiles.load(str(tmp_path / small)))


def decoded(path):
    """The exact times [s] and the pictures of an MP4."""
    import av

    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
    return [Fraction(f.pts) * f.time_base for f in frames], [f.to_ndarray(format="rgb24") for f in frames]


def difference(one, other):
    return np.abs(one.astype(float) - other).mean()


def luma(picture):
    """How bright each pixel is; the colours of a film have half its resolution, so thin lines lose theirs."""
    return picture @ np.array([0.2126, 0.7152, 0.0722])


def drawn(simulation, at):
    """The picture at `at` [s]."""
    simulation.reset()
    simulation.step(round(at / simulation.dt))
    return simulation.render(SIZE, renderer="raster")


def left_over(folder):
    return [path.name for path in folder.iterdir() if path.name.endswith(".part")]


def written(folder):
    """Bytes of a film that is not yet at its place."""
    return sum(file.stat().st_size for name in left_over(folder) for file in (folder / name).iterdir())


def test_an_mp4_shows_every_moment_at_its_time(jello, small, simulation, tmp_path):
    done = jello("video", small, "-o", "out.mp4", *SMALL_SIZE)
    assert done.returncode == 0 and "out.mp4: 12 frames, 0.2 s" in done.stdout, done.stderr
    times, pictures = decoded(tmp_path / "out.mp4")
    assert times == [Fraction(k, 60) for k in range(12)]
    for k, near in ((0, 1), (11, 10)):
        picture, own, other = (luma(p) for p in (pictures[k], drawn(simulation, k / 60), drawn(simulation, near / 60)))
        assert picture.shape == own.shape
        assert difference(picture, own) < 4.0
        moves = np.abs(own - other) > 8.0  # more than what the codec does to a floor
        assert moves.sum() > 50
        assert difference(picture[moves], own[moves]) < 0.5 * difference(picture[moves], other[moves])
    assert not left_over(tmp_path) and not done.stderr


@pytest.mark.parametrize("fps", [0.5, 12.5, 29.97, Fraction(30000, 1001), 1000])
def test_times_are_exact_at_any_rate(fps, tmp_path):
    with Film(tmp_path / "x.mp4", (32, 16), fps) as film:
        for k in range(10):
            film.add(np.full((16, 32, 3), 20 * k, np.uint8))
    times, pictures = decoded(tmp_path / "x.mp4")
    assert film.kept and film.frames == 10 and float(film.rate) == pytest.approx(float(fps), abs=1e-9)
    assert times == [k / film.rate for k in range(10)]
    assert [p.mean() for p in pictures] == pytest.approx([20 * k for k in range(10)], abs=2.5)


def test_a_gif_in_slow_motion_keeps_its_total_and_loops(jello, small, simulation, tmp_path):
    from PIL import Image

    done = jello("video", small, "-o", "out.gif", "--fps", "30", "--speed", "0.25", "--seconds", "0.1", *SMALL_SIZE)
    assert done.returncode == 0, done.stderr
    gif = Image.open(tmp_path / "out.gif")
    assert gif.n_frames == 12 and gif.size == SIZE and gif.info["loop"] == 0
    delays = []
    for k in range(12):
        gif.seek(k)
        delays.append(gif.info["duration"])
        assert (
            difference(np.asarray(gif.convert("RGB")), drawn(simulation, k * 0.25 / 30)) < 2.5
        )  # 256 colours for a smooth floor
    assert sum(delays) == 400 and set(delays) == {30, 40}


def test_png_frames_are_the_pictures(jello, small, simulation, tmp_path):
    from PIL import Image

    done = jello("video", small, "-o", "f-%03d.png", "--fps", "29.97", *SMALL_SIZE)
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in tmp_path.glob("*.png")) == [f"f-{k:03d}.png" for k in range(6)]
    for k in (0, 5):
        picture = np.asarray(Image.open(tmp_path / f"f-{k:03d}.png"))
        assert np.array_equal(picture, drawn(simulation, k / 29.97))


def read_ply(path):
    header, _, body = path.read_bytes().partition(b"end_header\n")
    vertices, faces = (int(re.search(rf"element {name} (\d+)", header.decode())[1]) for name in ("vertex", "face"))
    x = np.frombuffer(body, np.dtype([("x", "<f4", 3), ("rgb", "u1", 3)]), vertices)
    f = np.frombuffer(body, np.dtype([("n", "u1"), ("index", "<i4", 3)]), faces, x.nbytes)
    assert len(body) == x.nbytes + f.nbytes and set(f["n"]) == {3}
    return x["x"], x["rgb"], f["index"]


def read_obj(path):
    rows = [line.split() for line in path.read_text().splitlines()]
    v = np.array([row[1:] for row in rows if row[0] == "v"], float)
    return v[:, :3], np.round(255 * v[:, 3:]), np.array([row[1:] for row in rows if row[0] == "f"], int) - 1


@pytest.mark.parametrize("suffix, read", [(".ply", read_ply), (".obj", read_obj)])
def test_mesh_frames_move_one_closed_surface(suffix, read, jello, small, simulation, tmp_path):
    done = jello("video", small, "-o", f"skin%d{suffix}", "--fps", "30", "--seconds", "0.1")
    assert done.returncode == 0, done.stderr
    frames = [read(tmp_path / f"skin{k}{suffix}") for k in range(3)]
    assert not (tmp_path / f"skin3{suffix}").exists()
    for k, (x, rgb, index) in enumerate(frames):
        assert np.array_equal(index, frames[0][2]) and len(x) == len(rgb)
        edges = {tuple(edge) for edge in index[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)}
        assert all((b, a) in edges for a, b in edges)
        assert 0 <= rgb.min() < rgb.max() <= 255
        simulation.reset()
        simulation.step(round(k / 30 / simulation.dt))
        assert x.min(0) == pytest.approx(simulation.x.min(0), abs=1e-5)
        assert x.max(0) == pytest.approx(simulation.x.max(0), abs=1e-5)


MISTAKES = [
    (("-o", "x.mp4", "--size", "161x120"), "-o x.mp4: size: expected even numbers of pixels"),
    (("-o", "x.gif", "--fps", "60"), "-o x.gif: fps: expected at most 50"),
    (("-o", "x.mp4", "--fps", "2000"), "fps: expected 0.001 to 1000"),
    (("-o", "x.avi"), "expected a name ending in .gif, .mp4"),
    (("-o", "x.png"), "expected a number in the name of each frame, as in name-%04d.png"),
    (("-o", "no/x.mp4"), "expected a file in a folder that exists"),
    (("-o", "x.mp4", "--speed", "0"), "--speed: expected a number greater than 0"),
]


@pytest.mark.parametrize("call, words", MISTAKES, ids=[" ".join(call) for call, _ in MISTAKES])
def test_a_mistake_is_one_line_and_leaves_nothing_behind(here, small, tmp_path, call, words):
    done = here("video", small, *call)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and words in done.stderr, done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["small.toml"]


def test_a_scene_without_a_skin_gives_no_meshes(here, small, tmp_path):
    (tmp_path / small).write_text(SMALL.replace("[3, 3, 3]", "[3, 1, 1]"))
    done = here("video", small, "-o", "skin-%d.ply")
    assert done.returncode == 2 and done.stderr == "jello: -o skin-%d.ply: this scene has no skin to write as a mesh\n"


BLOCKED = """
import sys
sys.modules[{module!r}] = None
from taichi_jello.app import cli
cli.make_simulation = None  # what is missing is told before anything is simulated
sys.exit(cli.main(["video", "cube", "-o", {name!r}]))
"""


@pytest.mark.parametrize("module, name", [("av", "x.mp4"), ("PIL", "x.gif")])
def test_a_missing_extra_is_told_at_once(module, name, tmp_path):
    command = [sys.executable, "-c", BLOCKED.format(module=module, name=name)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr
    assert "pip install 'taichi_jello[video]'" in done.stderr and not list(tmp_path.iterdir())


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc")
def test_a_folder_that_takes_no_files_is_one_line(here, small):
    done = here("video", small, "-o", "/proc/x.mp4", *SMALL_SIZE)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and "/proc/x.mp4" in done.stderr, done.stderr


def most_bytes(count):
    """In the process to come no file grows beyond that, as on a full disk."""
    import resource

    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (count, count))


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on a file's size")
@pytest.mark.parametrize("name", ["x.mp4", "x.gif"])
def test_a_full_disk_is_one_line_and_leaves_the_old_film(name, jello, small, tmp_path):
    (tmp_path / name).write_text("old")
    done = jello("video", small, "-o", name, *SMALL_SIZE, preexec_fn=most_bytes(4000))
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and name in done.stderr, done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["small.toml", name]
    assert (tmp_path / name).read_text() == "old"


KILLED = """
import os, sys
import numpy as np
from taichi_jello.film import Film
picture = np.random.default_rng(0).integers(0, 255, (64, 96, 3), np.uint8)
with Film("x.mp4", (96, 64), 30) as film:
    while film.frames < 120:
        film.add(np.roll(picture, 3 * film.frames, 1))
    os.kill(os.getpid(), 9)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_process_that_is_killed_leaves_a_film_that_plays(tmp_path):
    """All but the second that is not yet written and what the encoder looks ahead, 40 frames and a few a thread."""
    assert subprocess.run([sys.executable, "-c", KILLED], cwd=tmp_path, timeout=60).returncode == -9
    (folder,) = tmp_path.glob("*.part")
    assert not folder.name.startswith(".")
    times, _ = decoded(folder / "x.mp4")
    assert len(times) >= 30 and times == [Fraction(k, 30) for k in range(len(times))]


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on a file's size")
@pytest.mark.parametrize(
    "name, room, plays", [("x.mp4", 150_000, True), ("x.mp4", 3000, False), ("x.gif", 90_000, True)]
)
def test_a_disk_that_fills_up_may_keep_what_it_has(name, room, plays, tmp_path):
    import resource

    picture = np.random.default_rng(0).integers(0, 255, (64, 96, 3), np.uint8)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, limits[1]))
    try:
        with pytest.raises(OSError, match=name), Film(tmp_path / name, (96, 64), 30, keep=(OSError,)) as film:
            for k in range(300):
                film.add(np.roll(picture, 3 * k, 1))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert film.kept == plays and [p.name for p in tmp_path.iterdir()] == [name] * plays
    if plays and name == "x.mp4":
        assert 30 <= len(decoded(tmp_path / name)[0]) <= film.frames


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_leaves_a_film_that_plays(small, tmp_path):
    command = [sys.executable, "-m", "taichi_jello", "video", small, "-o", "out.mp4", "--seconds", "600"]
    command += ["--size", "640x360"]  # whose frames soon fill what the encoder keeps back
    running = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 60
    while not written(tmp_path) and time.monotonic() < until:
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    try:
        told = running.communicate(timeout=60)[1]
    finally:
        running.kill()  # if it goes on, its 600 s must not slow the other tests
    assert running.returncode == 130 and len(told.splitlines()) == 1, told
    count = int(re.search(r"out.mp4 has the first (\d+) of 36000 frames", told)[1])
    times, _ = decoded(tmp_path / "out.mp4")
    assert times == [Fraction(k, 60) for k in range(count)] and count > 1
    assert not left_over(tmp_path)


def test_bad_numbers_keep_the_film_and_the_last_good_state(here, small, tmp_path):
    bad = ("--dt", "0.016", "--set", "jello.0.stiffness=2000", "--seconds", "5")
    done = here("video", small, "-o", "out.mp4", *bad, *SMALL_SIZE)
    assert done.returncode == 3 and "Traceback" not in done.stderr
    count = int(re.search(r"out.mp4 has the first (\d+) of 300 frames", done.stderr)[1])
    assert len(decoded(tmp_path / "out.mp4")[0]) == count
    with np.load(tmp_path / "out.last-good.npz") as kept:
        assert np.isfinite(kept["x"]).all()


def test_an_error_on_the_way_leaves_what_was_there(tmp_path):
    (tmp_path / "x.gif").write_text("old")
    picture = np.zeros((16, 32, 3), np.uint8)
    with pytest.raises(ZeroDivisionError), Film(tmp_path / "x.gif", (32, 16)) as film:
        film.add(picture)
        raise ZeroDivisionError
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("x.gif", "old")]


def test_a_film_takes_frames_of_its_own_kind_and_size(tmp_path):
    with Film(tmp_path / "x.gif", (32, 16)) as film:
        for wrong in (np.zeros((32, 16, 3), np.uint8), np.zeros((16, 32, 3)), Mesh(*[np.zeros((1, 3))] * 3)):
            with pytest.raises(ValueError, match="expected a"):
                film.add(wrong)
    assert film.frames == 0 and not list(tmp_path.iterdir())
    for wrong in (float("nan"), 0, float("inf")):
        with pytest.raises(FilmProblem, match="fps"):
            Film(tmp_path / "x.gif", (32, 16), wrong)
