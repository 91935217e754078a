"""What tests of jellos that touch share: their contact force, and pairs placed half in each other."""

import numpy as np

from taichi_jello import Snapshot
from taichi_jello.physics.forces.touch import Touch
from taichi_jello.studies._pairs import half_in


def touch(simulation):
    return next(force for force in simulation.system.all_forces if isinstance(force, Touch))


def tangles(simulation):
    return touch(simulation).contacts.tangles


def overlap_by_half(simulation, pose):
    """At rest, turned by chance, and along a way by chance over half of the lesser extent; see half_in."""
    x = half_in(simulation, pose)
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
