"""The same physics once more, in plain NumPy and SciPy, sharing no code with the kernels."""

import numpy as np

from taichi_jello import Box, Scene
from taichi_jello.studies._reference import Reference, elastic_energy, spring_forces, twisted

__all__ = ["elastic_energy", "frame_energies", "read", "solve", "spring_forces", "twisted"]


def read(memory, field):
    """(N, 3) values of a particle field."""
    return field.to_numpy()[memory.guard : memory.guard + memory.particles].astype(np.float64)


def frame_energies(simulation, frames):
    """(frames + 1,) the total energy [J] now and after each frame."""
    energies = [sum(simulation.energies().values())]
    for _ in range(frames):
        simulation.frame()
        energies.append(sum(simulation.energies().values()))
    return np.array(energies)


def solve(body, x, v, seconds, gravity=(0.0, 0.0, 0.0)):
    """x and v after `seconds` under springs and gravity by DOP853 at a relative tolerance of 1e-12."""
    return Reference(Scene(gravity=gravity, jello=[Box()]), body).solve(x, v, seconds, seconds)
