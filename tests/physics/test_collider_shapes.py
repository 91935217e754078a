"""What colliders say of themselves in NumPy: the same as in Taichi."""

import numpy as np
import pytest
import taichi as ti

from taichi_jello import Block, Plane, Room, Sphere

COLLIDERS = [
    Plane(point=(0.1, 0.2, 0.3), normal=(0.3, 1.0, -0.2)),
    Block(center=(0.2, 0.1, -0.3), size=(1.0, 0.4, 0.7)),
    Sphere(center=(0.1, -0.2, 0.3), radius=0.8),
    Room(min=(-0.9, -0.8, -0.7), max=(0.9, 0.6, 0.8)),
]


@pytest.mark.parametrize("collider", COLLIDERS)
def test_distances_and_heights_are_those_of_the_signed_distance(collider, best_precision, epsilon):
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (200, 3))
    found = np.zeros(len(points))
    rows = collider.rows(0.0, 1.0)
    signed_distance = collider.signed_distance

    @ti.kernel
    def nearest(p: ti.types.ndarray(), rows: ti.types.ndarray(), out: ti.types.ndarray()):
        for i in range(p.shape[0]):
            least = ti.cast(1e30, float)
            for r in range(rows.shape[0]):
                place = ti.Vector([p[i, 0] - rows[r, 0], p[i, 1] - rows[r, 1], p[i, 2] - rows[r, 2]])
                shape = ti.Vector([rows[r, 6], rows[r, 7], rows[r, 8], rows[r, 9]])
                least = ti.min(least, signed_distance(ti.cast(place, float), ti.cast(shape, float))[3])
            out[i] = least

    nearest(points, rows, found)
    local = points - collider.place(0.0)
    assert collider.distance(local) == pytest.approx(found, abs=20 * epsilon)
    height = collider.top(local[:, 0], local[:, 2])
    under = np.isfinite(height)
    raised = np.column_stack([local[:, 0], height, local[:, 2]])[under]
    assert under.any() and collider.distance(raised).max() < 1e-12
    above = collider.distance(raised + [0.0, 1e-6, 0.0])
    assert np.all(above[collider.distance(raised) > -1e-9] > 0.0)
