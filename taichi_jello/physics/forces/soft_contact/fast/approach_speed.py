"""How fast jellos come at each other: in how many parts a step must be taken so that none passes another in one
(NumPy only)."""

from math import ceil

import numpy as np

from taichi_jello.scene.body import Body

PART = 0.125  # of the thinner one's thickness, that two jellos may come nearer to each other in one part
MOST = 10_000  # parts of a frame


class Approach:
    """Of the jellos of a body, `thickness` (J,) [m] each."""

    def __init__(self, body: Body, thickness: np.ndarray):
        self.first = np.searchsorted(body.jello, np.arange(len(thickness)))
        self.length = PART * np.minimum(thickness[:, None], thickness)
        np.fill_diagonal(self.length, np.inf)  # how it meets itself is for its springs to resist
        self.least = float(self.length.min())

    def parts(self, x: np.ndarray, v: np.ndarray, frame_dt: float, dt: float) -> int:
        """In how many parts to take steps of dt [s] in the frame that begins with the particles at x [m] and v [m/s],
        (N, 3) each: 1 unless jellos come faster at each other than that within their way of the whole frame."""
        if 2.0 * dt * float(np.sqrt(np.einsum("ij,ij->i", v, v).max())) <= self.least:
            return 1
        slow, fast = (f.reduceat(v, self.first) for f in (np.minimum, np.maximum))
        low, high = (f.reduceat(x, self.first) for f in (np.minimum, np.maximum))
        back, forth = slow - fast[:, None], fast - slow[:, None]  # of the second beside the first of each pair
        reach = low + frame_dt * np.minimum(back, 0.0), high + frame_dt * np.maximum(forth, 0.0)
        meet = np.all((reach[0] <= high[:, None] + self.least) & (low[:, None] - self.least <= reach[1]), axis=2)
        speed = np.linalg.norm(np.maximum(forth, -back), axis=2)
        needed = float(np.where(meet, dt * speed / self.length, 0.0).max())
        return min(max(1, ceil(needed * (1.0 - 1e-6))), max(1, ceil(MOST * dt / frame_dt)))
