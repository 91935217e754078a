"""What the cursor is on: points that are projected are picked where they were."""

import numpy as np
import pytest

from taichi_jello.physics.forces.grab import MOST
from taichi_jello.scene.body import join
from taichi_jello.shapes.ball import Ball
from taichi_jello.shapes.lattice import Box
from taichi_jello.view.camera import Viewpoint
from taichi_jello.view.picking import pick, ray

SIZES = [(1280, 720), (800, 1000)]
EYES = [(2.6, 1.9, 3.6), (0.9, 1.2, 1.0), (25.0, 18.0, 40.0), (0.001, 6.0, 0.001)]
CUBE = join([Box(position=(0.0, 0.5, 0.0), points=(4, 4, 4)).body()])


def view(eye, target=(0.0, 0.5, 0.0)):
    return Viewpoint(np.array(eye), np.array(target))


def outward(body, x):
    """(T, 3) unit normals and middles of the skin's triangles."""
    a, b, c = (x[body.surface[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True), (a + b + c) / 3.0


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("eye", EYES)
def test_visible_middles_and_corners_are_picked_back(size, eye):
    seen_from, x = view(eye), CUBE.x
    normal, middle = outward(CUBE, x)
    front = np.einsum("ij,ij->i", normal, seen_from.eye - middle) > 1e-3
    for index in np.flatnonzero(front):
        for point in (middle[index], *x[CUBE.surface[index]]):
            at = seen_from.project(point[None], size)[0]
            found = pick(CUBE, x, seen_from, tuple(at), size)
            assert found is not None
            again = np.array(found.weights) @ x[list(found.particles)]
            assert sum(found.weights) == pytest.approx(1.0) and again == pytest.approx(found.point)
            assert np.linalg.norm(seen_from.project(again[None], size)[0] - at) < 0.01
            assert np.linalg.norm(again - point) < 1e-6  # the front, not the back


@pytest.mark.parametrize("size", SIZES)
def test_beside_the_jello_there_is_nothing(size):
    seen_from = view(EYES[0])
    places = seen_from.project(CUBE.x, size)
    low, high = places.min(0) - 3.0, places.max(0) + 3.0
    for at in [(low[0], low[1]), (high[0], 0.5 * (low[1] + high[1])), (0.0, 0.0), (size[0], size[1])]:
        assert pick(CUBE, CUBE.x, seen_from, at, size) is None
        assert pick(CUBE, CUBE.x, seen_from, (at[0] - 9.0, at[1] - 9.0), size, skin=False) is None


def test_nothing_behind_the_eye_is_picked():
    away = view((0.0, 0.5, 3.0), target=(0.0, 0.5, 6.0))
    assert pick(CUBE, CUBE.x, away, (640.0, 360.0), (1280, 720)) is None
    assert pick(CUBE, CUBE.x, away, (640.0, 360.0), (1280, 720), skin=False) is None


def test_of_two_jellos_the_front_one_is_picked():
    body = join([Box(position=(0.0, 0.5, z), points=(3, 3, 3)).body() for z in (-2.0, 2.0)])
    for eye, jello in (((0.0, 0.5, 9.0), 1), ((0.0, 0.5, -9.0), 0)):
        found = pick(body, body.x, view(eye), (640.0, 360.0), (1280, 720))
        assert set(body.jello[list(found.particles)]) == {jello}


def test_without_a_skin_the_front_particle_near_the_cursor_is_picked():
    seen_from = view((0.0, 0.5, 4.0))  # looks along rows of particles
    front = int(np.argmin(np.linalg.norm(CUBE.x - [-1 / 6, 0.5 + 1 / 6, 0.5], axis=1)))
    at = seen_from.project(CUBE.x[[front]], (1280, 720))[0]
    found = pick(CUBE, CUBE.x, seen_from, (at[0] + 4.0, at[1] - 3.0), (1280, 720), skin=False)
    assert found.particles == (front,) and found.weights == (1.0,)
    assert pick(CUBE, CUBE.x, seen_from, (at[0] + 30.0, at[1]), (1280, 720), skin=False) is None


def test_a_jello_of_threads_is_picked_by_its_particles():
    thread = join([Box(position=(0.0, 0.5, 0.0), points=(5, 1, 1)).body()])
    seen_from = view((0.0, 0.5, 4.0))
    at = seen_from.project(thread.x[[3]], (1280, 720))[0]
    assert pick(thread, thread.x, seen_from, tuple(at), (1280, 720)).particles == (3,)


def test_ray_and_projection_are_each_others_inverse():
    seen_from = view((1.0, 2.0, 3.0))
    eye, way = ray(seen_from, (123.0, 456.0), (1280, 720))
    assert seen_from.project((eye + 2.5 * way)[None], (1280, 720))[0] == pytest.approx([123.0, 456.0])
    assert -seen_from.axes()[2] @ way == pytest.approx(1.0)


def test_an_embedded_skin_is_picked_where_it_is_drawn():
    body = join([Ball(resolution=4, radius=0.5, position=(0.0, 0.5, 0.0)).body(), Box(position=(0, 0.5, -3)).body()])
    x = body.x * [1.2, 1.0, 0.9]
    for at in ((652.0, 371.0), (700.0, 330.0), (600.0, 440.0)):
        found = pick(body, x, view((0.0, 0.5, 4.0)), at, (1280, 720))
        assert found is not None and 4 <= len(found.particles) <= MOST and set(body.jello[list(found.particles)]) == {0}
        assert sum(found.weights) == pytest.approx(1.0)
        again = np.array(found.weights) @ x[list(found.particles)]
        assert again == pytest.approx(found.point)
        assert view((0.0, 0.5, 4.0)).project(again[None], (1280, 720))[0] == pytest.approx(at, abs=0.01)
        # On the near side of the ellipsoid; its facets lie up to 2 % inside.
        assert 0.95 < np.linalg.norm((again - [0.0, 0.5, 0.0]) / [0.6, 0.5, 0.45]) < 1.001 and again[2] > 0.3
