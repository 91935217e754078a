"""A tree of boxes over the elements of each jello, by where they are in the undeformed body (NumPy only).

Boxes are fitted anew where the body moves, the tree stays (van den Bergen 1997, "Efficient collision detection of
complex deformable models using AABB trees"). Nodes follow each other as they are met on the way down, each with the
place to go on at if its box is missed, so that walking through needs no stack.
"""

from dataclasses import dataclass

import numpy as np

WIDE = 8  # elements of a leaf, where it holds more than one, and children of a node


@dataclass(frozen=True)
class BoxTree:
    """order (E,): the elements by jello, those of a node side by side. first, last (K,): node k holds the elements
    order[first[k]] … order[last[k] - 1]; skip (K,): the next node that is not inside it; for a leaf k + 1.
    start (J + 1,): jello j has the nodes start[j] … start[j + 1] - 1.
    Leaves stand in blocks of up to WIDE, those of one parent: block (K,) is the block whose parent node k is, or whose
    only leaf if that is a root, else -1; block b holds the leaves leaf[b] … behind[b] - 1, (B,) each."""

    order: np.ndarray
    first: np.ndarray
    last: np.ndarray
    skip: np.ndarray
    start: np.ndarray
    block: np.ndarray
    leaf: np.ndarray
    behind: np.ndarray

    @property
    def is_leaf(self) -> np.ndarray:
        """(K,) bool."""
        return self.skip == np.arange(1, len(self.skip) + 1)

    @classmethod
    def of(cls, owner: np.ndarray, middle: np.ndarray, single: np.ndarray) -> "BoxTree":
        """owner (E,): the jello of each element; middle (E, 3): where it is in the undeformed body; single (J,) bool:
        the jellos whose leaves hold one element each."""
        order = in_blocks(owner, middle)
        begin = np.searchsorted(owner[order], np.arange(len(single) + 1))
        first, last = [], []
        for low, high, one in zip(begin[:-1].tolist(), begin[1:].tolist(), single.tolist(), strict=True):
            size = 1 if one else WIDE
            while low < high:
                starts = np.arange(low, high, size)
                first.append(starts)
                last.append(np.minimum(starts + size, high))
                if size >= high - low:
                    break
                size *= WIDE
        firsts, lasts = (np.concatenate([np.zeros(0, int), *ends]) for ends in (first, last))
        down = np.lexsort((-lasts, firsts))
        firsts, lasts = firsts[down], lasts[down]
        skip, start, number = np.searchsorted(firsts, lasts), np.searchsorted(firsts, begin), np.arange(len(firsts))
        is_leaf = skip == number + 1
        leaves = np.append(0, np.cumsum(is_leaf))
        parent = np.where(is_leaf, np.isin(number, start), leaves[skip] - leaves[number] == skip - number - 1)
        block = np.where(parent, np.cumsum(parent) - 1, -1)
        return cls(order, firsts, lasts, skip, start, block, (number + ~is_leaf)[parent], skip[parent])


def in_blocks(owner: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """(E,): the elements by owner, halved again and again across the longest axis, so that every WIDE of them that
    follow each other, every WIDE² and so on are near each other."""
    order = np.argsort(owner, kind="stable")
    start = np.flatnonzero(np.diff(owner[order], prepend=-1))
    while len(order):
        size = np.diff(start, append=len(order))
        big = size > WIDE
        if not big.any():
            break
        part = np.repeat(np.arange(len(start)), size)
        places = middle[order]
        extent = np.maximum.reduceat(places, start) - np.minimum.reduceat(places, start)
        along = np.take_along_axis(places, extent.argmax(1)[part, None], 1)[:, 0]
        order = order[np.lexsort((np.where(big[part], along, 0.0), part))]
        half = WIDE * 2 ** (np.ceil(np.log2(np.maximum(size, 2 * WIDE) / WIDE)).astype(int) - 1)
        start = np.sort(np.concatenate([start, (start + half)[big]]))
    return order
