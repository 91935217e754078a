"""Classic Jello Cube worlds: every number of a small file where it belongs, and every way a file can be broken."""

import numpy as np
import pytest

from taichi_jello import Box, Scene, SceneError, Simulation, scenefiles
from taichi_jello.run.assembly import assembled

HEAD = ["RK4", "0.0005 5", "200 0.25 400.0 0.5", "0.001953125", "1", "-1 1 1 2", "3"]


def world(head=HEAD):
    """The lines of a file: a field that says which node it is at, positions that say which point, all at 0.5 m/s."""
    steps = range(int(head[-1]))
    nodes = [f"{i} {10 * j} {100 * k}" for i in steps for j in steps for k in steps]
    points = [f"{i / 7} {j / 7} {k / 7 - 0.25}" for i in range(8) for j in range(8) for k in range(8)]
    return [*head, *nodes, *points, *["0.5 0 0"] * 512]


def written(tmp_path, lines):
    path = tmp_path / "cube.w"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def test_every_number_is_where_it_belongs(tmp_path):
    scene = scenefiles.load(written(tmp_path, world()))
    body = assembled(scene)
    assert scene.solver.method == "rk4" and scene.solver.dt == 5e-4 and scene.solver.frame_dt == 2.5e-3
    assert scene.gravity == (0.0, 0.0, 0.0) and scene.drag == 0.0
    assert (scene.contact.stiffness, scene.contact.damping, scene.contact.friction) == (400.0, 0.5, 0.0)
    assert len(body) == 512 and len(body.springs) == 6220
    assert set(body.stiffness) == {200.0} and set(body.damping) == {0.25}
    assert body.mass == pytest.approx(0.001953125)
    assert body.rest_length.min() == pytest.approx(1 / 7) and body.rest_length.max() == pytest.approx(2 / 7)
    i, j, k = np.unravel_index(np.arange(512), (8, 8, 8))
    assert body.x == pytest.approx(np.stack([i / 7, j / 7, k / 7 - 0.25], 1))
    assert np.array_equal(body.v, np.tile([0.5, 0.0, 0.0], (512, 1)))
    room, plane = scene.collider
    assert room.min == (-2.0, -2.0, -2.0) and room.max == (2.0, 2.0, 2.0)
    # -x + y + z + 2 > 0 where the cube starts, so that it stays where x is small.
    assert np.array(plane.normal) * np.sqrt(3.0) == pytest.approx([-1.0, 1.0, 1.0])
    assert np.dot([-1.0, 1.0, 1.0], plane.point) == pytest.approx(-2.0)
    field = scene.force[0]
    assert field.min == (-2.0, -2.0, -2.0) and field.max == (2.0, 2.0, 2.0)
    assert field.values.shape == (3, 3, 3, 3) and list(field.values[2, 1, 0]) == [2.0, 10.0, 0.0]


def test_the_plane_faces_the_cube_and_a_world_may_have_neither_plane_nor_field(tmp_path):
    turned = [*HEAD[:5], "1 -1 -1 -2", "0"]
    assert scenefiles.load(written(tmp_path, world(turned))).collider[1].normal[0] < 0.0
    plain = scenefiles.load(written(tmp_path, world(["Euler", *HEAD[1:4], "0", "0"])))
    assert len(plain.collider) == 1 and plain.force == () and plain.solver.method == "euler"


def test_a_byte_order_mark_and_an_upper_case_ending_are_no_mistake(tmp_path):
    (tmp_path / "CUBE.W").write_text("\n".join(world()), encoding="utf-8-sig")
    assert scenefiles.load(str(tmp_path / "CUBE.W")).solver.method == "rk4"


def test_a_world_runs(tmp_path, best_precision):
    """Free and undamped by anything outside, its middle moves on at 0.5 m/s."""
    simulation = Simulation(scenefiles.load(written(tmp_path, world(["RK4", *HEAD[1:4], "0", "0"]))))
    assert simulation.dt == pytest.approx(5e-4) and simulation.substeps == 5
    start = simulation.x.mean(0)
    simulation.step(20)
    assert simulation.x.mean(0) - start == pytest.approx([0.005, 0.0, 0.0], abs=1e-6)


def broken(line, text):
    lines = world()
    lines[line - 1] = text
    return lines


@pytest.mark.parametrize(
    "lines, words",
    [
        ([], "line 1: expected an integrator, Euler or RK4, got the end of the file"),
        (broken(1, "Verlet"), "line 1: expected an integrator, Euler or RK4, got 'Verlet'"),
        (broken(2, "0.001"), "line 2: expected the time step"),
        (broken(2, "0 5"), "line 2: expected the time step"),
        (broken(2, "0.001 2.5"), "line 2: expected the time step and a whole number"),
        (broken(3, "200 0.25 stiff 0.5"), "line 3: expected four numbers of at least 0: kElastic"),
        (broken(3, "-200 0.25 400 0.5"), "line 3: expected four numbers of at least 0: kElastic"),
        (broken(4, "0"), "line 4: expected the mass of one point"),
        (broken(5, "2"), "line 5: expected 0, or 1 for an inclined plane"),
        (broken(6, "1 2 3"), "line 6: expected four numbers a b c d"),
        (broken(6, "0 0 0 1"), "line 6: expected an inclined plane a b c d with a direction"),
        (broken(7, "1"), "line 7: expected the force field's resolution"),
        (broken(7, "many"), "line 7: expected the force field's resolution"),
        (broken(10, ""), "line 10: expected three numbers, force 3 of 27, got ''"),
        (broken(40, "1 2 nan"), "line 40: expected three numbers, position 6 of 512"),
        (world()[:600], "line 601: expected three numbers, velocity 55 of 512, got the end of the file"),
        ([*world(), "1 2 3"], "line 1059: expected the end of the file after 512 velocities"),
    ],
)
def test_every_mistake_names_file_and_line(tmp_path, lines, words):
    path = written(tmp_path, lines)
    with pytest.raises(SceneError) as caught:
        scenefiles.load(path)
    assert str(caught.value).startswith(f"{path}: {words}") and "\n" not in str(caught.value)


def test_starting_points_must_be_as_many_as_the_shape_has():
    with pytest.raises(SceneError, match=r"jello.0.v: expected 8 points, got 2"):
        assembled(Scene(jello=[Box(points=(2, 2, 2), v=np.zeros((2, 3)))]))
    for value, words in (
        ([1, 2], r"x: expected a list of \[x, y, z\]"),
        ([[0, 0, float("nan")]], "x: expected finite"),
    ):
        with pytest.raises(SceneError, match=words):
            Box(x=value)
