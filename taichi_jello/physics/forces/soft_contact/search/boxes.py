"""Boxes along the axes that a jello has now: the axes, and whether two boxes meet."""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.soft_contact.search.box_tree import WIDE
from taichi_jello.scene.body import Body

TINY = 1e-12


def levers(body: Body) -> np.ndarray:
    """(N, 3): by which the places of a jello's particles give its stretch and turn, Σ x ⊗ lever, by least squares."""
    found = np.zeros((len(body), 3))
    for j in range(int(body.jello.max()) + 1):
        own = body.jello == j
        arm = body.rest[own] - body.rest[own].mean(0)
        found[own] = arm @ np.linalg.pinv(arm.T @ arm, rcond=1e-6)
    return found


@ti.func
def axes_of(a):
    """Three unit vectors square to each other, the rows of a matrix, along the columns of a as well as may be."""
    e0 = ti.Vector([a[0, 0], a[1, 0], a[2, 0]])
    e0 = ti.select(e0.norm() > TINY, e0 / ti.max(e0.norm(), TINY), ti.Vector([1.0, 0.0, 0.0]))
    e1 = ti.Vector([a[0, 1], a[1, 1], a[2, 1]])
    e1 -= e0.dot(e1) * e0
    if not e1.norm() > 1e-3 * ti.abs(a).max():
        e1 = ti.select(ti.abs(e0[0]) < 0.7, ti.Vector([1.0, 0.0, 0.0]), ti.Vector([0.0, 1.0, 0.0]))
        e1 -= e0.dot(e1) * e0
    e1 /= e1.norm()
    return ti.Matrix.rows([e0, e1, e0.cross(e1)])


@ti.func
def box_around(low, high):
    return ti.Vector([low[0], low[1], low[2], high[0], high[1], high[2]])


@ti.func
def larger(a, b):
    """ti.max in one instruction: that takes six, since it gives a number where one of the two is none."""
    return ti.select(a > b, a, b)


@ti.func
def meet(box, low, high):
    """Whether a box meets the one from `low` to `high`: whether no gap between them is wider than nothing. One
    comparison, since the compiler would make five branches of six."""
    gap = larger(box[0] - high[0], low[0] - box[3])
    for axis in ti.static(range(1, 3)):
        gap = larger(gap, larger(box[axis] - high[axis], low[axis] - box[axis + 3]))
    return gap <= 0.0


@ti.func
def which_meet(boxes: ti.template(), block, low, high):
    """Which of the WIDE boxes of a block of `boxes` (B, 6, WIDE) meet the one from `low` to `high`, as bits. They are
    stored axis by axis, so that the compiler makes vector code of it."""
    found = 0
    for k in range(WIDE):
        gap = larger(boxes[block, 0, k] - high[0], low[0] - boxes[block, 3, k])
        for axis in ti.static(range(1, 3)):
            gap = larger(gap, larger(boxes[block, axis, k] - high[axis], low[axis] - boxes[block, axis + 3, k]))
        found |= ti.select(gap <= 0.0, 1 << k, 0)
    return found


@ti.func
def put_box(boxes: ti.template(), block, k, low, high):
    """Make the box from `low` to `high` the k-th of a block; one from FAR to -FAR meets no other."""
    for axis in ti.static(range(3)):
        boxes[block, axis, k], boxes[block, axis + 3, k] = low[axis], high[axis]
