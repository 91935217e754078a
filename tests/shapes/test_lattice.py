"""The lattice: counts, rest lengths, each spring once, skin; down to a single point."""

import numpy as np
import pytest

from taichi_jello import Box, Pin, SceneError
from taichi_jello.scene.body import join


def expected_counts(n, m, k):
    structural = (n - 1) * m * k + n * (m - 1) * k + n * m * (k - 1)
    faces = 2 * ((n - 1) * (m - 1) * k + (n - 1) * m * (k - 1) + n * (m - 1) * (k - 1))
    bodies = 4 * (n - 1) * (m - 1) * (k - 1)
    bend = max(n - 2, 0) * m * k + n * max(m - 2, 0) * k + n * m * max(k - 2, 0)
    return [structural, faces + bodies, bend]


@pytest.mark.parametrize(
    "points",
    [(8, 8, 8), (1, 1, 1), (2, 1, 1), (2, 2, 2), (1, 4, 3), (1, 1, 6), (3, 1, 2), (5, 3, 4), (2, 2, 3)],
)
def test_counts_each_spring_once(points):
    body = Box(points=points).body()
    assert np.bincount(body.family, minlength=3).tolist() == expected_counts(*points)
    assert len(np.unique(body.springs, axis=0)) == len(body.springs)
    assert np.all(body.springs[:, 0] < body.springs[:, 1])


def test_the_workshops_cube():
    body = Box().body()
    assert len(body) == 512 and body.mass == pytest.approx(1 / 512)
    assert np.bincount(body.family).tolist() == [1344, 2352 + 1372, 1152]
    h = 1 / 7
    lengths, counts = np.unique(body.rest_length.round(12), return_counts=True)
    assert lengths == pytest.approx([h, np.sqrt(2) * h, np.sqrt(3) * h, 2 * h])
    assert counts.tolist() == [1344, 2352, 1372, 1152]
    degree = np.bincount(body.springs.ravel())
    assert degree.min() == 10 and degree.max() == 32
    assert len(np.unique(body.surface)) == 296


def test_rest_length_and_direction_are_those_of_the_rest_shape():
    body = Box(points=(3, 4, 2), size=(1.0, 0.6, 0.2), rotation=(10.0, 50.0, -20.0), position=(1.0, 2.0, 3.0)).body()
    i, j = body.springs.T
    d = body.rest[j] - body.rest[i]
    assert body.direction * body.rest_length[:, None] == pytest.approx(d, abs=1e-12)
    assert np.linalg.norm(body.x[j] - body.x[i], axis=1) == pytest.approx(body.rest_length)
    assert body.x.mean(0) == pytest.approx([1.0, 2.0, 3.0])


def test_families_have_their_own_coefficients():
    box = Box(points=(3, 3, 3), stiffness={"structural": 100.0, "bend": 5.0}, damping={"shear": 0.5})
    body = box.body()
    for family, k, c in ((0, 100.0, 0.0), (1, 0.0, 0.5), (2, 5.0, 0.0)):
        assert np.all(body.stiffness[body.family == family] == k)
        assert np.all(body.damping[body.family == family] == c)
    assert set(Box(points=(3, 3, 3), springs=("structural",)).body().family) == {0}


def test_skin_is_closed_and_faces_outward():
    body = Box(points=(3, 4, 5)).body()
    corners = body.rest[body.surface]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all(np.einsum("ij,ij->i", normal, corners.mean(1)) > 0)
    assert np.einsum("ij,ij->", corners.mean(1), normal) / 6 == pytest.approx(1.0)  # its volume
    edges = np.concatenate([body.surface[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert {tuple(e) for e in edges} == {tuple(e) for e in edges[:, ::-1]}


def test_velocity_spin_and_pins():
    box = Box(points=(2, 3, 2), velocity=(1.0, 0.0, 0.0), spin=(0.0, 2.0, 0.0), pin=[Pin(min=(0.0, 1.0, 0.0))])
    body = box.body()
    assert body.v == pytest.approx([1.0, 0.0, 0.0] + np.cross([0.0, 2.0, 0.0], body.x))
    assert np.array_equal(body.pinned, body.rest[:, 1] > 0.4)


def test_bodies_join_with_their_own_indices():
    a, b = Box(points=(2, 2, 2)).body(), Box(points=(3, 1, 1), mass=2.0).body()
    both = join([a, b])
    assert len(both) == 11 and both.jello.tolist() == [0] * 8 + [1] * 3
    assert np.array_equal(both.springs[len(a.springs) :], b.springs + 8)
    assert both.mass.sum() == pytest.approx(3.0)
    with pytest.raises(ValueError):
        both.x[0] = 0.0


@pytest.mark.parametrize(
    "wrong, key",
    [
        ({"points": (0, 2, 2)}, "points.0"),
        ({"points": (2, 2)}, "points"),
        ({"points": (2.5, 2, 2)}, "points.0"),
        ({"points": (1000, 1000, 1000)}, "points"),
        ({"size": (1.0, 0.0, 1.0)}, "size.1"),
        ({"mass": 0.0}, "mass"),
        ({"mass": float("nan")}, "mass"),
        ({"stiffness": -1.0}, "stiffness"),
        ({"stiffness": {"sheer": 1.0}}, "stiffness"),
        ({"damping": float("inf")}, "damping"),
        ({"springs": "shear"}, "springs"),
        ({"springs": ["diagonal"]}, "springs"),
        ({"rotation": (0.0, "x", 0.0)}, "rotation.1"),
        ({"velocity": 3.0}, "velocity"),
    ],
)
def test_what_cannot_be_is_named(wrong, key):
    with pytest.raises(SceneError) as caught:
        Box(**wrong)
    assert caught.value.key == key and "expected" in caught.value.problem


@pytest.mark.parametrize("points", [(4, 3, 2), (1, 4, 3), (5, 1, 1)])
def test_cells_fill_the_box(points):
    body = Box(points=points, size=(1.0, 2.0, 3.0)).body()
    solid = min(points) > 1
    assert len(body.cells) == (np.prod(np.array(points) - 1) if solid else 0)
    edges = body.rest[body.cells][:, [4, 2, 1]] - body.rest[body.cells][:, :1]  # along x, y and z
    assert np.linalg.det(edges).sum() == pytest.approx(6.0 if solid else 0.0)
