"""A run that is saved and gone on with, where springs remember."""

import io
import zipfile

import numpy as np
import pytest

from taichi_jello import Box, Keyframe, Move, Pin, Scene, Simulation
from taichi_jello.run.trajectory import StateError, Trajectory, last_moment


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def test_torn_and_frozen_it_goes_on_from_its_file_to_the_same_bits(tmp_path):
    path = [Move(time=0.0, offset=(0.0, 0.0, 0.0)), Move(time=0.3, offset=(0.9, 0.0, 0.0))]
    pins = [Pin(max=(0.0, 1.0, 1.0)), Pin(min=(1.0, 0.0, 0.0), keyframe=path)]
    frozen = [Keyframe(time=0.0, stiffness=0.5), Keyframe(time=0.2, freeze=True)]
    scene = Scene(
        jello=[Box(points=(4, 2, 2), damping=1.0, yield_strain=0.3, tear_strain=0.6, pin=pins, keyframe=frozen)]
    )
    simulation = Simulation(scene)
    trajectory = Trajectory(simulation)
    simulation.step(14 * simulation.substeps + 1)
    trajectory.add()
    file = tmp_path / "half.npz"
    trajectory.save(file)
    with np.load(file) as arrays:
        assert {"memory_rest_length", "memory_whole", "memory_frozen"} <= set(arrays)
    simulation.step(9 * simulation.substeps)
    end = simulation.snapshot()
    assert not end.memory["whole"].all()
    simulation.reset()
    simulation.restore(last_moment(file, simulation.body))
    simulation.step(9 * simulation.substeps)
    assert np.array_equal(simulation.x, end.x) and np.array_equal(simulation.v, end.v)
    assert simulation.work == pytest.approx({name: float(end.memory[f"work.0.{name}"]) for name in simulation.work})


def test_bdf2_goes_on_from_its_file_to_the_same_bits(tmp_path):
    """It remembers a whole step, x and v of all particles."""
    simulation = Simulation(Scene(jello=[Box(points=(3, 3, 3), spin=(1.0, 2.0, 0.0))]), method="bdf2")
    simulation.frame()
    simulation.frame()
    trajectory = Trajectory(simulation)
    trajectory.add()
    trajectory.save(tmp_path / "half.npz")
    simulation.frame()
    x = simulation.x
    simulation.restore(last_moment(tmp_path / "half.npz", simulation.body))
    simulation.frame()
    assert np.array_equal(simulation.x, x)


def test_a_memory_of_another_scene_is_refused(tmp_path):
    body = Simulation(Scene(jello=[Box(points=(2, 2, 2))])).body
    np.savez(tmp_path / "odd.npz", x=body.x, v=body.v, memory_whole=np.ones(3, bool))
    with pytest.raises(ValueError, match="memory_whole: expected a state of this scene"):
        last_moment(tmp_path / "odd.npz", body)


@pytest.fixture(scope="module")
def body():
    return Simulation(Scene(jello=[Box(points=(2, 2, 2))])).body


def npz(path, compression=zipfile.ZIP_STORED, **members):
    """An NPZ of raw members: arrays, or the bytes of what stands for one."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in members.items():
            if not isinstance(content, bytes):
                file = io.BytesIO()
                np.save(file, content)
                content = file.getvalue()
            archive.writestr(f"{name}.npy", content)
    return path


def header(text):
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


STATE = np.zeros((8, 3))


@pytest.mark.parametrize(
    "members, words",
    [
        ({"time": np.array(np.nan)}, "time: expected 0 to 1e+09 s, got nan"),
        ({"time": np.array([0.0, np.inf])}, "time: expected 0 to 1e+09 s, got inf"),
        ({"time": np.array(1e300)}, "time: expected 0 to 1e+09 s, got 1e+300"),
        ({"time": np.array(-1.0)}, "time: expected 0 to 1e+09 s, got -1"),
        ({"time": np.zeros(1, [("a", "<f4")])}, "time: expected numbers, got [('a', '<f4')]"),
        ({"x": b"words"}, "x: expected an array as numpy.savez writes it"),
        ({"x": header("{'descr': '<f8', 'fortran_order': False, 'shape': (9, (}")}, "x: expected an array as numpy"),
        ({"x": header("{'descr': '<f8', 'fortran_order': False, 'shape': (8, 3)}" + " " * 60_000)}, "x: expected an"),
        ({"x": header("{'descr': '<f8', 'fortran_order': False, 'shape': (8, 3)}")}, "x: expected 192 bytes as its"),
        (
            {"x": header("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000, 8, 3)}")},
            "x: expected 192000000000000000 bytes as its header says, got",
        ),
        ({"x": np.zeros((10**6, 3))}, "x: expected a state of this scene, it is of another one, its shape is (1000000"),
        ({"memory_whole": np.array(np.nan)}, "memory_whole: expected finite numbers"),
        ({"memory_\x1b[2J": np.array("x")}, r"memory_\x1b[2J: expected numbers"),
    ],
)
def test_a_file_without_a_state_is_one_line(tmp_path, body, members, words):
    path = npz(tmp_path / "odd.npz", **({"x": STATE, "v": STATE} | members))
    with pytest.raises(StateError) as caught:
        last_moment(path, body)
    assert str(caught.value).startswith(words) and str(caught.value).isprintable() and len(str(caught.value)) < 300


def test_damaged_and_encrypted_files_are_one_line(tmp_path, body):
    whole = npz(tmp_path / "whole.npz", zipfile.ZIP_DEFLATED, x=STATE + np.arange(3), v=STATE).read_bytes()
    central, local = whole.index(b"PK\x01\x02"), 0
    for change in (
        {local + 8: 99, central + 10: 99},
        {local + 6: 1, central + 8: 1},
        {local + 40: 0xFF, local + 41: 0xFF},
    ):
        data = bytearray(whole)
        for at, byte in change.items():
            data[at] = byte
        (tmp_path / "odd.npz").write_bytes(data)
        with pytest.raises(StateError, match=r"^x: expected an array as numpy.savez writes it, it is damaged or encr"):
            last_moment(tmp_path / "odd.npz", body)
    for data in (b"", b"words", whole[:100], b"PK\x05\x06" + b"\xff" * 18):
        (tmp_path / "odd.npz").write_bytes(data)
        with pytest.raises(StateError, match=r"^expected"):
            last_moment(tmp_path / "odd.npz", body)


def test_of_many_moments_only_the_last_is_kept_in_memory(tmp_path, body):
    """Zeros take a thousandth of their length in the file."""
    x = np.zeros((20_000, 8, 3))
    x[-1] = np.arange(24).reshape(8, 3)
    path = npz(tmp_path / "long.npz", zipfile.ZIP_DEFLATED, x=x, v=x[0].T.copy().T, time=np.arange(20_000.0))
    moment = last_moment(path, body)
    assert moment.time == 19_999.0 and np.array_equal(moment.x, x[-1]) and moment.x.base is None
