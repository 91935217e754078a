"""Ball, sheet and rope, and lattices of which only some cells are filled."""

import numpy as np
import pytest

from taichi_jello import Ball, Box, Pin, Ring, Rope, SceneError, Sheet
from taichi_jello.scene.body import join
from taichi_jello.shapes._skin import split_edges
from taichi_jello.shapes.lattice import body_of, corners


def volume(body):
    """Enclosed by the surface triangles (divergence theorem)."""
    a, b, c = (body.rest[body.surface[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def edges(surface):
    return np.concatenate([surface[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])


def rows(array):
    return {tuple(row) for row in array.tolist()}


def test_a_filled_grid_is_the_box():
    box, filled = Box(points=(4, 3, 5), size=(3.0, 2.0, 4.0)), np.ones((3, 2, 4), bool)
    cut, whole = body_of(box, corners(filled), np.ones(3), filled), box.body()
    for name in ("rest", "springs", "rest_length", "direction", "family", "cells"):
        assert getattr(cut, name) == pytest.approx(getattr(whole, name), abs=1e-12), name
    assert rows(np.sort(cut.surface, 1)) == rows(np.sort(whole.surface, 1)) and volume(cut) == pytest.approx(24.0)


def test_springs_do_not_cross_a_gap():
    """Two towers on a plate, one empty cell apart: nothing but the plate connects them."""
    filled = np.ones((3, 3, 1), bool)
    filled[1, 1:] = False
    body = body_of(Box(), corners(filled), np.ones(3), filled)
    assert len(body) == 32 and volume(body) == pytest.approx(7.0)
    x, y = (body.rest + 1.5).round(9).T[:2]
    ends_x, ends_y = x[body.springs], y[body.springs]
    across = (ends_x.min(1) <= 1.0) & (ends_x.max(1) >= 2.0) & (ends_y.min(1) > 1.0)
    assert not across.any()
    assert np.any((ends_x.min(1) <= 1.0) & (ends_x.max(1) >= 2.0) & (ends_y.max(1) <= 1.0))


@pytest.mark.parametrize("resolution", [2, 5, 12])
def test_a_balls_cells_are_closed_and_symmetric(resolution):
    body = Ball(radius=0.3, resolution=resolution, mass=2.0).body()
    assert body.mass.sum() == pytest.approx(2.0) and body.mass @ body.rest == pytest.approx(0.0, abs=1e-12)
    found = edges(body.surface)
    assert rows(found) == rows(found[:, ::-1])
    assert volume(body) == pytest.approx((0.6 / resolution) ** 3 * len(body.cells))
    assert {tuple(p) for p in (body.rest * [-1, 1, 1]).round(9) + 0.0} == {tuple(p) for p in body.rest.round(9) + 0.0}


@pytest.mark.parametrize("resolution", [3, 8])
def test_a_balls_skin_is_a_sphere_carried_by_its_cells(resolution):
    body = Ball(radius=0.3, resolution=resolution).body()
    points = body.skin_points(body.rest)
    assert np.linalg.norm(points, axis=1) == pytest.approx(0.3)
    found = edges(body.skin)
    assert len(rows(found)) == len(found) and rows(found) == rows(found[:, ::-1])
    corners = points[body.skin]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all(np.einsum("ij,ij->i", normal, corners.mean(1)) > 0)
    assert np.array_equal(body.inside, np.linalg.norm(body.rest, axis=1) <= 0.3 + 1e-12)
    # Trilinear interpolation repeats what is linear in each coordinate, and its weights are shares.
    bent = np.stack([body.rest[:, 0] * body.rest[:, 1], body.rest[:, 2], body.rest.prod(1)], 1)
    assert body.skin_points(bent) == pytest.approx(
        np.stack([points[:, 0] * points[:, 1], points[:, 2], points.prod(1)], 1), abs=1e-12
    )
    assert body.skin_weights.sum(1) == pytest.approx(1.0) and body.skin_weights.min() >= 0.0


def test_skins_join_with_their_own_particles():
    ball, box = Ball(resolution=3).body(), Box(points=(2, 2, 2)).body()
    both = join([box, ball, ball])
    for k in (0, 1):
        x = both.x[8 + k * len(ball) : 8 + (k + 1) * len(ball)]
        own = both.skin_points(both.x)[both.skin[k * len(ball.skin) : (k + 1) * len(ball.skin)]]
        assert np.array_equal(own, ball.skin_points(x)[ball.skin])
    assert np.array_equal(both.embedded, both.jello > 0) and rows(both.bare_surface) == rows(box.surface)
    assert both.inside[:8].all() and not both.inside.all()


def test_long_edges_are_cut_without_gaps():
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 4.0]])
    triangles = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    more, cut = split_edges(points, triangles, 0.3)
    found = edges(cut)
    assert np.linalg.norm(more[found[:, 0]] - more[found[:, 1]], axis=1).max() <= 0.3
    assert len(rows(found)) == len(found) and rows(found) == rows(found[:, ::-1])
    a, b, c = (more[cut[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(8.0 / 6.0)


def test_a_sheet_lies_level_and_has_both_sides():
    body = Sheet(points=(4, 3), size=(3.0, 1.0), pin=[Pin(max=(0.0, 1.0, 1.0))]).body()
    assert np.ptp(body.rest, axis=0) == pytest.approx([3.0, 0.0, 1.0])
    assert np.bincount(body.family).tolist() == [17, 12, 10]
    assert len(body.surface) == 2 * 2 * 6 and len(body.cells) == 0
    assert rows(edges(body.surface)) == rows(edges(body.surface)[:, ::-1])
    assert volume(body) == pytest.approx(0.0)
    assert np.array_equal(body.pinned, body.rest[:, 0] < -1.4)


def test_a_rope_has_springs_along_it_only():
    body = Rope(points=10, length=1.8).body()
    assert np.bincount(body.family).tolist() == [9, 0, 8] and len(body.surface) == 0
    assert np.ptp(body.rest, axis=0) == pytest.approx([1.8, 0.0, 0.0])
    assert body.rest_length == pytest.approx([0.2] * 9 + [0.4] * 8)


@pytest.mark.parametrize(
    "shape, wrong, key",
    [
        (Ball, {"radius": 0.0}, "radius"),
        (Ball, {"resolution": 1}, "resolution"),
        (Ball, {"resolution": 5000}, "resolution"),
        (Sheet, {"points": (4, 0)}, "points.1"),
        (Sheet, {"points": (4, 3, 2)}, "points"),
        (Sheet, {"size": (1.0, 1.0, 1.0)}, "size"),
        (Sheet, {"size": (1.0, -1.0)}, "size.1"),
        (Rope, {"points": 0}, "points"),
        (Rope, {"length": float("inf")}, "length"),
    ],
)
def test_what_cannot_be_is_named(shape, wrong, key):
    with pytest.raises(SceneError) as caught:
        shape(**wrong)
    assert caught.value.key == key and "expected" in caught.value.problem


def test_a_ring_is_closed_and_the_same_all_round():
    body = Ring(radius=1.0, thickness=0.4, points=(20, 3)).body()
    around = 2.0 * np.pi / 20.0
    assert len(body) == 180 and len(body.cells) == 80 and not np.any(np.unique(body.cells) != np.arange(180))
    # Pappus: a polygon of 20 sides instead of the circle.
    assert volume(body) == pytest.approx(0.4**2 * 2.0 * np.pi * np.sin(around) / around, rel=1e-9)
    assert {2} == set(np.unique(np.sort(edges(body.surface), 1), axis=0, return_counts=True)[1].tolist())
    degree = np.bincount(body.springs.ravel()).reshape(20, 9)
    assert np.all(degree == degree[0])
    for points in ((4, 3), (12, 1)):
        with pytest.raises(SceneError, match="points: expected at least 5 around and 2 across"):
            Ring(points=points)
