"""Ball, sheet and rope, and lattices of which only some cells are filled."""

import numpy as np
import pytest

from taichi_jello import Ball, Box, Pin, Rope, SceneError, Sheet
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
def test_a_ball_is_closed_and_symmetric(resolution):
    body = Ball(radius=0.3, resolution=resolution, mass=2.0).body()
    assert body.mass.sum() == pytest.approx(2.0)
    found = edges(body.surface)
    assert len(rows(found)) == len(found) and rows(found) == rows(found[:, ::-1])
    mirrored = np.lexsort((body.rest * [-1, 1, 1]).round(9).T), np.lexsort(body.rest.round(9).T)
    assert (body.rest * [-1, 1, 1])[mirrored[0]] == pytest.approx(body.rest[mirrored[1]], abs=1e-9)
    cells = 8 * np.prod(0.3 / resolution * np.ones(3)) * len(body.cells)
    assert volume(body) == pytest.approx(cells)


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
