"""What tests of jellos that touch share: their contact force, and pairs placed beside each other."""

import numpy as np

from taichi_jello import Snapshot
from taichi_jello.physics.forces.soft_contact.soft_penalty import Touch


def touch(simulation):
    return next(force for force in simulation.system.all_forces if isinstance(force, Touch))


def placed(simulation, turns, shift, v=None):
    """The first two jellos about the origin, each turned by a matrix; the second shifted."""
    body = simulation.body
    x = body.x.copy()
    for j in (0, 1):
        rest = body.rest[body.jello == j]
        x[body.jello == j] = (rest - rest.mean(0)) @ turns[j].T + j * np.asarray(shift)
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x) if v is None else v))
