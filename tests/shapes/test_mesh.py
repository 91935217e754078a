"""Meshes from files: filled, welded, embedded; and one clear line for what cannot be."""

import numpy as np
import pytest

from taichi_jello import Mesh, SceneError, scenefiles
from taichi_jello.shapes._meshfiles import reading
from taichi_jello.shapes._meshfiles.stl import MeshWarning
from taichi_jello.shapes._skin import parts
from taichi_jello.shapes._voxels import ASIDE, enclosed, passed_through
from taichi_jello.shapes.ball import sphere

trimesh = pytest.importorskip("trimesh")


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


@pytest.fixture
def saved(tmp_path):
    """saved(mesh, name) -> the file's name."""

    def save(mesh, name="mesh.ply"):
        mesh.export(str(tmp_path / name))
        return str(tmp_path / name)

    return save


def written(tmp_path, content, name):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return str(path)


def surface(points, triangles):
    return trimesh.Trimesh(points, triangles, process=False)


def volume(body):
    a, b, c = (body.skin_points(body.rest)[body.skin[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def problem(**options):
    with pytest.raises(SceneError) as caught:
        Mesh(**options).body()
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("form", ["obj", "stl", "ply", "glb"])
def test_every_format_gives_the_same_body(form, saved):
    """A torus: what is filled, where, how heavy, and its own surface as the skin."""
    torus = trimesh.creation.torus(1.0, 0.35)
    body = Mesh(file=saved(torus, f"torus.{form}"), resolution=12, size=2.7, mass=3.0).body()
    points = body.skin_points(body.rest)
    assert np.ptp(points, axis=0) == pytest.approx([2.7, 2.7, 0.7], abs=1e-5)
    assert volume(body) == pytest.approx(torus.volume, rel=1e-4)
    assert body.mass.sum() == pytest.approx(3.0) and body.mass @ body.rest == pytest.approx(0.0, abs=0.01)
    assert len(np.unique(points.round(5), axis=0)) == len(points)  # welded, also where the file repeats points
    # The hole stays open: no particle near the axis.
    assert np.hypot(*body.rest[:, :2].T).min() > 0.3


def test_what_is_inside_agrees_with_the_formula():
    points, triangles = sphere(0.1)
    inside = enclosed(10.0 * points + 12.0, triangles, (24, 24, 24), signed=True)
    place = (np.indices(inside.shape) + 0.5).reshape(3, -1).T / 2.0 + ASIDE - 12.0
    radius = np.linalg.norm(place, axis=1).reshape(inside.shape)
    # Facets of edge 0.1 lie up to 0.1²/6 of the radius inside the sphere.
    assert inside[radius < 10.0 * (1 - 0.1**2 / 6)].all() and not inside[radius > 10.0].any()
    met = passed_through(10.0 * points + 12.0, triangles, (24, 24, 24))
    assert met[tuple(np.floor(10.0 * points + 12.0).astype(int).T)].all()
    middle = np.linalg.norm((np.indices(met.shape) + 0.5).reshape(3, -1).T - 12.0, axis=1).reshape(met.shape)
    assert not met[np.abs(middle - 10.0) > 0.5 * np.sqrt(3.0) + 0.1].any()


def test_a_mesh_of_a_single_cell_keeps_its_surface(saved):
    """Whether there is more inside before or behind a triangle is no longer told by the cells."""
    points, triangles = sphere(0.3)
    body = Mesh(file=saved(surface(points, triangles)), resolution=1, scale=1.0).body()
    assert len(body.cells) == 1 and volume(body) == pytest.approx(surface(points, triangles).volume, rel=1e-5)


def test_overlapping_parts_are_one(saved):
    """Two boxes that overlap by half: inside both counts once."""
    boxes = trimesh.util.concatenate([trimesh.creation.box((2, 2, 2)), trimesh.creation.box((2, 2, 2))])
    boxes.vertices[8:, 0] += 1.0
    body = Mesh(file=saved(boxes), resolution=6, size=3.0).body()
    assert len(body.cells) == 6 * 4 * 4
    assert np.all(body.mass >= body.mass.max() / 8.0 - 1e-12)


def test_triangles_that_face_both_ways_are_turned(saved):
    points, triangles = sphere(0.3)
    expected = surface(points, triangles).volume
    triangles[::3] = triangles[::3, ::-1]
    with pytest.warns(MeshWarning, match="ply: its triangles do not all face outwards"):  # no edge is open
        body = Mesh(file=saved(surface(points, triangles)), resolution=8, scale=1.0).body()
    assert volume(body) == pytest.approx(expected, rel=1e-5)


def test_an_inside_out_mesh_is_turned(saved):
    points, triangles = sphere(0.3)
    with pytest.warns(MeshWarning, match="its triangles all face inwards; they were turned"):
        body = Mesh(file=saved(surface(points, triangles[:, ::-1])), resolution=8, scale=1.0).body()
    assert volume(body) == pytest.approx(surface(points, triangles).volume, rel=1e-5)


def test_an_open_mesh_works_with_a_warning(saved):
    points, triangles = sphere(0.2)
    lid = points[triangles].mean(1)[:, 1] > 0.9
    closed = Mesh(file=saved(surface(points, triangles)), resolution=8).body()
    with pytest.warns(MeshWarning, match="edges of its surface are open"):
        opened = Mesh(file=saved(surface(points, triangles[~lid])), resolution=8).body()
    assert len(opened.cells) >= 0.95 * len(closed.cells)


def test_a_thin_ring_hangs_together_at_any_resolution(saved):
    file = saved(trimesh.creation.torus(1.0, 0.03))
    for resolution in (5, 16, 40):
        body = Mesh(file=file, resolution=resolution).body()
        reached, near = np.zeros(len(body), bool), np.array([0])
        while len(near):  # along springs, from particle to particle
            reached[near] = True
            touching = body.springs[reached[body.springs].any(1)]
            near = np.setdiff1d(touching, np.flatnonzero(reached))
        assert reached.all() and 0.0 < volume(body) < 0.01


def test_parts_that_do_not_hang_together_are_told(saved):
    two = trimesh.util.concatenate([trimesh.creation.box((2, 2, 2)), trimesh.creation.box((1, 1, 1))])
    two.vertices[8:, 0] += 2.0
    with pytest.warns(MeshWarning, match=r"falls into 2 parts, .* resolution = (\d+) joins them") as told:
        Mesh(file=saved(two), resolution=20).body()
    resolution = int(str(told[0].message).split("resolution = ")[1].split()[0])
    body = Mesh(file=saved(two), resolution=resolution).body()  # without a warning
    assert len(body.cells) > 0
    assert parts(np.array([[[True, False, True, True]]])) == [2, 1]


def test_mistakes_are_one_line(saved, tmp_path):
    ball = saved(surface(*sphere(0.5)))
    assert "no such file" in problem(file=str(tmp_path / "nothing.ply"))
    assert "ending in .obj, .stl, .ply, .glb" in problem(file=str(tmp_path / "nothing.txt"))
    assert "file: expected" in problem(file="")
    assert "either size or scale" in problem(file=ball, size=1.0, scale=1.0)
    assert "size: expected a finite number greater than 0, got 0" in problem(file=ball, size=0.0)
    assert "resolution: expected a whole number of at least 1" in problem(file=ball, resolution=0)
    assert "resolution: expected at most" in problem(file=ball, resolution=215)
    for name in ("mesh.obj", "mesh.stl", "mesh.ply", "mesh.glb"):
        for content in (b"", b"hello world\n" * 20, bytes(range(256)) * 4):
            assert name in problem(file=written(tmp_path, content, name))
    with open(ball, "rb") as file:
        content = file.read()
    for name in ("other.obj", "other.stl", "other.glb"):
        assert name in problem(file=written(tmp_path, content, name))
    assert "cut.ply" in problem(file=written(tmp_path, content[: len(content) // 2], "cut.ply"))
    assert "has none" in problem(file=written(tmp_path, "v 0 0 0\nv 1 0 0\n", "points.obj"))
    one = written(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "one.obj")
    assert "nothing is inside" in problem(file=one)
    assert "finite" in problem(file=written(tmp_path, "v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n", "nan.obj"))
    assert "one place" in problem(file=written(tmp_path, "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "flat.obj"))


def test_too_many_triangles_are_refused(saved, monkeypatch):
    monkeypatch.setattr(reading, "MAX_TRIANGLES", 100)
    assert "expected at most 100 triangles, got 320" in problem(file=saved(surface(*sphere(0.3))))


def test_a_scene_file_looks_beside_itself(tmp_path, monkeypatch):
    (tmp_path / "shapes").mkdir()
    surface(*sphere(0.5)).export(str(tmp_path / "shapes" / "ball.stl"))
    text = '[[jello]]\nshape = "mesh"\nfile = "shapes/ball.stl"\nresolution = 4\n'
    scene = scenefiles.load(written(tmp_path, text, "scene.toml"))
    monkeypatch.chdir("/")
    assert len(scene.jello[0].body().skin) >= 320
