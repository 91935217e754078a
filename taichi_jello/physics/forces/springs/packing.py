"""The spring network as each particle sees it, packed in blocks of neighbouring particles (NumPy only).

A particle sums its own springs, in a fixed order: no atomics, the same bits every time. A block is LANES particles.
All springs of a block from particle i to i + shift with the same material make one entry: the shift, the material and
a mask of the particles that have such a spring. On a lattice a block has about 32 nearly full entries, so the table is
small (12 bytes a particle) and a loop over a block's particles reads neighbouring memory, which the compiler turns
into vector code. Any other network works too, with emptier masks.

Where springs differ one by one (a painted stiffness, a body that yields or tears), entries of one material would be
nearly empty. Then an entry holds all springs of its shift, and each of its LANES places has a material of its own.
"""

from dataclasses import dataclass

import numpy as np

from taichi_jello.physics.state import LANES
from taichi_jello.scene.body import Body

ALWAYS_SHARED = 256  # materials, up to which entries are always of one material
TOO_MANY_ENTRIES = 2.0  # of one material each, for each shift: then sharing materials does not pay


@dataclass(frozen=True)
class GatherTable:
    """Block b owns the entries start[b] to start[b + 1]; entries (E, 3) int32: shift, mask, material;
    materials (M, 6): stiffness [N/m], rest length [m], damping [N·s/m], unit direction towards the neighbour.
    single: a spring's material is that of its entry plus its place in the block.
    example (M,): a spring of each material, -1 where no spring has it. of_spring (S,): the material of each spring as
    its lower particle sees it."""

    start: np.ndarray
    entries: np.ndarray
    materials: np.ndarray
    single: bool
    example: np.ndarray
    of_spring: np.ndarray


def reach(body: Body) -> int:
    """How many places beyond a block the kernels read."""
    far = int(np.max(body.springs[:, 1] - body.springs[:, 0])) if len(body.springs) else 0
    return far + LANES if far else 0


def distinct_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """np.unique of rows and its inverse, by a checked hash, since sorting rows is slow."""
    weights = np.random.default_rng(1).uniform(1.0, 2.0, rows.shape[1])
    _, first, which = np.unique(rows @ weights, return_index=True, return_inverse=True)
    if not np.array_equal(rows[first][which], rows):
        return np.unique(rows, axis=0, return_inverse=True)
    return rows[first], which


def pack(body: Body, apart: np.ndarray | None = None, single: bool = False) -> GatherTable:
    """Both directions of every spring of `body`, sorted by block, then by shift and material.

    apart (S,): springs with different numbers there never share a material. single: every spring has one of its own;
    also chosen where sharing would not pay."""
    i, j = body.springs[:, 0].astype(np.int64), body.springs[:, 1].astype(np.int64)
    owner, shift = np.concatenate([i, j]), np.concatenate([j - i, i - j])
    far = int(shift.max())
    place = (owner // LANES) * (2 * far + 1) + shift + far
    coefficients = np.stack([body.stiffness, body.rest_length, body.damping], 1)
    rows = np.hstack([coefficients, body.direction, *([] if apart is None else [apart[:, None]])])
    if not single:
        shared, which = distinct_rows(rows)
        material = np.concatenate([which, which + len(shared)])
        key = place * (2 * len(shared)) + material
        single = len(shared) > ALWAYS_SHARED and len(np.unique(key)) > TOO_MANY_ENTRIES * len(np.unique(place))
    if single:
        key = place * len(rows) + _rank(owner * (2 * far + 1) + shift + far)  # two springs may join the same pair
    per_place = len(rows) if single else 2 * len(shared)

    entry_key, entry = np.unique(key, return_inverse=True)
    mask = np.bincount(entry, weights=np.exp2(owner % LANES), minlength=len(entry_key)).astype(np.uint32)
    if single:
        material = entry * LANES + owner % LANES
        base, count = np.arange(len(entry_key)) * LANES, len(entry_key) * LANES
    else:
        base, count = entry_key % per_place, per_place
    example = np.full(count, -1)
    example[material] = np.concatenate([np.arange(len(i)), np.arange(len(i))])
    backward = np.zeros(count, bool)
    backward[material[len(i) :]] = True
    materials = np.where(example[:, None] < 0, 0.0, rows[example, :6])
    materials[backward, 3:] *= -1.0

    block, rest = np.divmod(entry_key // per_place, 2 * far + 1)
    blocks = -(-len(body) // LANES)
    entries = np.stack([rest - far, mask.view(np.int32), base], 1).astype(np.int32)
    start = np.searchsorted(block, np.arange(blocks + 1)).astype(np.int32)
    return GatherTable(start, entries, materials, single, example, material[: len(i)])


def _rank(key: np.ndarray) -> np.ndarray:
    """(n,) how many equal keys stand before each."""
    order = np.argsort(key, kind="stable")
    rank = np.empty(len(key), np.int64)
    rank[order] = np.arange(len(key)) - np.searchsorted(key[order], key[order])
    return rank
