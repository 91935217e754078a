"""The same physics once more, in plain NumPy and SciPy, sharing no code with the kernels."""

import numpy as np
from scipy.integrate import solve_ivp


def read(memory, field):
    """(N, 3) values of a particle field."""
    return field.to_numpy()[memory.guard : memory.guard + memory.particles].astype(np.float64)


def spring_forces(body, x, v):
    """(N, 3) Hooke and dashpot forces, added spring by spring."""
    i, j = body.springs.T
    d = x[i] - x[j]
    length = np.linalg.norm(d, axis=1, keepdims=True)
    n = d / length
    pull = body.stiffness[:, None] * (length - body.rest_length[:, None])
    pull = pull + body.damping[:, None] * np.sum((v[i] - v[j]) * n, axis=1, keepdims=True)
    f = np.zeros_like(x)
    np.add.at(f, i, -pull * n)
    np.add.at(f, j, pull * n)
    return f


def elastic_energy(body, x):
    i, j = body.springs.T
    stretch = np.linalg.norm(x[i] - x[j], axis=1) - body.rest_length
    return 0.5 * np.sum(body.stiffness * stretch**2)


def solve(body, x, v, seconds, gravity=(0.0, 0.0, 0.0)):
    """x and v after `seconds` by DOP853 at a relative tolerance of 1e-12."""
    shape = x.shape

    def slope(t, y):
        x, v = y.reshape(2, *shape)
        return np.concatenate([v.ravel(), (spring_forces(body, x, v) / body.mass[:, None] + gravity).ravel()])

    start = np.concatenate([x.ravel(), v.ravel()])
    solution = solve_ivp(slope, (0.0, seconds), start, method="DOP853", rtol=1e-12, atol=1e-13)
    assert solution.success
    return solution.y[:, -1].reshape(2, *shape)


def twisted(x, degrees=36.0, stretch=0.1):
    """A cube twisted about the vertical through its middle and stretched along it."""
    angle = np.radians(degrees) * x[:, 1]
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x[:, 0] + s * x[:, 2], (1.0 + stretch) * x[:, 1], c * x[:, 2] - s * x[:, 0]], 1)
