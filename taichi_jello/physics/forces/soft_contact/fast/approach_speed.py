"""How fast jellos approach each other: in how many parts a step must be taken so that none passes another in one part
(NumPy only)."""

from math import ceil

import numpy as np

from taichi_jello.scene.body import Body

APPROACH = 0.125  # of the thinner one's thickness, by which two jellos may approach in one step
MAX_PARTS = 10_000  # of a frame


class Approach:
    """Of the jellos of a body, `thickness` (J,) [m] each."""

    def __init__(self, body: Body, thickness: np.ndarray):
        self.first = np.searchsorted(body.jello, np.arange(len(thickness)))
        self.length = APPROACH * np.minimum(thickness[:, None], thickness)
        np.fill_diagonal(self.length, np.inf)  # its springs keep a jello from itself
        self.least = float(self.length.min())

    def parts(self, x: np.ndarray, v: np.ndarray, frame_dt: float, dt: float) -> int:
        """In how many parts to take steps of dt [s] in the frame that begins with the particles at x [m] and v [m/s],
        (N, 3) each: 1 unless two jellos that may meet in the frame approach faster than that."""
        if 2.0 * dt * float(np.sqrt(np.einsum("ij,ij->i", v, v).max())) <= self.least:
            return 1
        slow, fast = (f.reduceat(v, self.first) for f in (np.minimum, np.maximum))
        low, high = (f.reduceat(x, self.first) for f in (np.minimum, np.maximum))
        back, forth = slow - fast[:, None], fast - slow[:, None]  # of the second beside the first of each pair
        reach = low + frame_dt * np.minimum(back, 0.0), high + frame_dt * np.maximum(forth, 0.0)
        meet = np.all((reach[0] <= high[:, None] + self.least) & (low[:, None] - self.least <= reach[1]), axis=2)
        speed = np.linalg.norm(np.maximum(forth, -back), axis=2)
        needed = float(np.where(meet, dt * speed / self.length, 0.0).max())
        return min(max(1, ceil(needed * (1.0 - 1e-6))), max(1, ceil(MAX_PARTS * dt / frame_dt)))
