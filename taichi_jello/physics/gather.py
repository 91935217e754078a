"""The spring network as each particle sees it, packed in blocks of neighbouring particles (NumPy only).

A particle sums its own springs, in a fixed order: no atomics, the same bits every time. Particles are taken in
blocks of LANES. For a block, all springs that lead from particle i to i + shift with the same material make ONE
entry: the shift, the material and a mask of the particles that have such a spring. On a lattice a block has about
32 nearly full entries, so the table is small (12 bytes a particle) and a loop over a block's particles reads
neighbouring memory, which the compiler turns into vector code. Any other network works too, with emptier masks.
"""

from dataclasses import dataclass

import numpy as np

from taichi_jello.body import Body
from taichi_jello.physics.state import LANES


@dataclass(frozen=True)
class GatherTable:
    """Block b owns the entries start[b] to start[b + 1]; entries (E, 3) int32: shift, mask, material;
    materials (M, 6): stiffness [N/m], rest length [m], damping [N·s/m], unit direction towards the neighbour."""

    start: np.ndarray
    entries: np.ndarray
    materials: np.ndarray


def reach(body: Body) -> int:
    """How far from a block's particles the gather reads."""
    far = int(np.max(body.springs[:, 1] - body.springs[:, 0])) if len(body.springs) else 0
    return far + LANES if far else 0


def distinct_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The different rows and, for each row, which of them it is; by a hash, checked, since sorting rows is slow."""
    weights = np.random.default_rng(1).uniform(1.0, 2.0, rows.shape[1])
    _, first, which = np.unique(rows @ weights, return_index=True, return_inverse=True)
    if not np.array_equal(rows[first][which], rows):
        return np.unique(rows, axis=0, return_inverse=True)
    return rows[first], which


def pack(body: Body) -> GatherTable:
    """Both directions of every spring of `body`, sorted by block, then by shift and material."""
    i, j = body.springs[:, 0].astype(np.int64), body.springs[:, 1].astype(np.int64)
    coefficients = np.stack([body.stiffness, body.rest_length, body.damping], 1)
    forward, which = distinct_rows(np.hstack([coefficients, body.direction]))
    materials = np.concatenate([forward, forward * [1, 1, 1, -1, -1, -1]])

    owner, shift = np.concatenate([i, j]), np.concatenate([j - i, i - j])
    material = np.concatenate([which, which + len(forward)])
    far = int(shift.max())
    key = ((owner // LANES) * (2 * far + 1) + shift + far) * len(materials) + material
    entry_key, entry = np.unique(key, return_inverse=True)
    mask = np.bincount(entry, weights=np.exp2(owner % LANES), minlength=len(entry_key)).astype(np.uint32)

    block, rest = np.divmod(entry_key, (2 * far + 1) * len(materials))
    blocks = -(-len(body) // LANES)
    shift = rest // len(materials) - far
    entries = np.stack([shift, mask.view(np.int32), rest % len(materials)], 1).astype(np.int32)
    return GatherTable(np.searchsorted(block, np.arange(blocks + 1)).astype(np.int32), entries, materials)
