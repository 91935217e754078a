"""What is left of a body's skins when springs are torn."""

import numpy as np
import pytest

from taichi_jello import Ball, Box, Sheet
from taichi_jello.physics.forces.springs.tearing import parted
from taichi_jello.run.assembly import built
from taichi_jello.scene.body import join


def cut(body, at=0.0, axis=0):
    """(S,) the springs that do not cross the plane where x is `at`."""
    side = body.rest[:, axis][body.springs] > at
    return side[:, 0] == side[:, 1]


def volume(body, triangles, points=None):
    a, b, c = ((body.rest if points is None else points)[triangles[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0


def test_nothing_torn_nothing_lost():
    body = join([built(Box(points=(3, 4, 5))), built(Sheet(points=(4, 4)))])
    left = parted(body, np.ones(len(body.springs), bool))
    assert np.array_equal(left.surface, body.surface) and np.array_equal(left.cells, body.cells)


def test_a_solid_cut_in_two_has_two_closed_skins():
    """A layer of cells goes; the rest, of the same volume as its cells, faces outwards all around."""
    body = join([built(Box(points=(6, 4, 4), size=(5.0, 3.0, 3.0))), built(Box(points=(3, 3, 3)))])
    whole = cut(body) | (body.jello[body.springs[:, 0]] == 1)
    left = parted(body, whole)
    first = left.surface[left.jello[left.surface[:, 0]] == 0]
    assert volume(left, first) == pytest.approx(4 * 9.0)
    assert len(first) == 2 * 2 * (2 * 9 + 4 * 6)
    other = body.surface[body.jello[body.surface[:, 0]] == 1]
    assert np.array_equal(left.surface[left.jello[left.surface[:, 0]] == 1], other)


def test_a_sheet_and_an_embedded_skin_lose_their_triangles_on_the_cut():
    sheet = built(Sheet(points=(6, 4)))
    left = parted(sheet, cut(sheet))
    assert len(left.surface) == len(sheet.surface) * 4 // 5
    assert not np.ptp(np.sign(sheet.rest[left.surface][:, :, 0]), axis=1).any()
    ball = built(Ball(resolution=6))
    rent = parted(ball, cut(ball, 0.01))
    assert 0 < len(rent.skin) < len(ball.skin)
    right = ball.rest[ball.skin_corners[rent.skin]][..., 0] > 0.01
    assert np.array_equal(right.any((1, 2)), right.all((1, 2)))
