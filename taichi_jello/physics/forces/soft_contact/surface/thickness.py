"""How thick jellos are, which of them are convex and compact, and where their middles are (NumPy only)."""

import numpy as np

CORE = 0.25  # of a jello's thickness: the depth at which its core begins
ROUNDING = 1e-6  # of a length
COMPACT = 2.0  # times as long as it is thick is what is compact at most
PAIRS = 200  # of cells whose middles are joined to find out whether a body is convex


def thicknesses(way: np.ndarray, skinned: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """(C,) [m]: how thick the undeformed body is around each cell, the shortest of its straight ways through it, from
    the ways out `way` (C, 6) of `touching.ways_out`. A skin lies within its outermost cells: where `skinned` (C,), half
    a spacing (C,) [m] is taken off at either end, but no more than half of what there is."""
    through = (way[:, 0::2] + way[:, 1::2]).min(1, initial=np.inf)
    through = np.where(np.isfinite(through), through, spacing)
    return np.where(skinned, np.maximum(through - spacing, 0.5 * through), through)


def cores(thick: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """(C,) [m]: how deep the core begins of what is `thick` (C,) [m] and has points a `gap` (C,) [m] apart: of what
    comes in between points that are farther apart than half of the thickness these are less deep."""
    return CORE * (thick - np.clip(gap - 0.5 * thick, 0.0, 0.5 * thick))


def convex(rest: np.ndarray, cells: np.ndarray) -> bool:
    """Whether halfway between any two of the cells (C, 8) of a body there is a cell: asked of PAIRS of them, as far
    apart as chance makes them."""
    middle = rest[cells].mean(1)
    reach = 1.01 * np.linalg.norm(rest[cells] - middle[:, None], axis=2).max()
    first, second = np.random.default_rng(0).integers(len(cells), size=(2, PAIRS))
    halfway = 0.5 * (middle[first] + middle[second])
    return all(np.linalg.norm(middle - place, axis=1).min() <= reach for place in halfway)


def compact(rest: np.ndarray, cells: np.ndarray) -> bool:
    """Whether a body of the cells (C, 8), measured along their axes, is about as thick as it is long."""
    edges = rest[cells[0, [4, 2, 1]]] - rest[cells[0, 0]]
    extents = np.ptp(rest[np.unique(cells)] @ (edges / np.linalg.norm(edges, axis=1)[:, None]).T, axis=0)
    return bool(extents.max() <= (1.0 + ROUNDING) * COMPACT * extents.min())


def hearts(rest: np.ndarray, cells: np.ndarray, owner: np.ndarray, jellos: int) -> np.ndarray:
    """(J, 8) the corners of the cell in the middle of each jello, whose cells (C, 8) have the `owner` (C,); zeros where
    it has none. Its middle is the jello's own, however it moves."""
    found = np.zeros((jellos, 8), np.int32)
    for j in np.unique(owner):
        own = cells[owner == j]
        middle = rest[own].mean(1)
        found[j] = own[np.linalg.norm(middle - middle.mean(0), axis=1).argmin()]
    return found
