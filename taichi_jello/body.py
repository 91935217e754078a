"""Body: points, masses, springs and skin of one jello or of a whole scene, as frozen NumPy arrays."""

from dataclasses import dataclass, fields

import numpy as np

FAMILY_NAMES = ("structural", "shear", "bend", "other")


@dataclass(frozen=True, kw_only=True)
class Body:
    """N particles, S springs and T surface triangles, SI units.

    rest (N, 3): undeformed positions in the shape's own frame. x, v (N, 3): where they start and how fast.
    mass (N,); pinned (N,) bool: held still; jello (N,): which jello of the scene a particle belongs to.
    springs (S, 2): particle pairs, the lower index first; rest_length, stiffness, damping (S,);
    family (S,): 0 structural, 1 shear, 2 bend, 3 other; direction (S, 3): unit vector between the rest positions,
    which decides where a spring of no length pushes. surface (T, 3): outward, counter-clockwise triangles.
    cells (C, 8): the corners of the hexahedra that fill a solid body, corner 4a + 2b + c at a, b, c ∈ {0, 1} steps
    along its x, y and z; none for a sheet or a rope.
    """

    rest: np.ndarray
    x: np.ndarray
    v: np.ndarray
    mass: np.ndarray
    pinned: np.ndarray
    jello: np.ndarray
    springs: np.ndarray
    rest_length: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    family: np.ndarray
    direction: np.ndarray
    surface: np.ndarray
    cells: np.ndarray

    def __post_init__(self) -> None:
        for each in fields(self):
            getattr(self, each.name).setflags(write=False)

    def __len__(self) -> int:
        return len(self.rest)


def join(bodies: list[Body]) -> Body:
    """All bodies as one; indices of springs, triangles and cells follow their particles."""
    starts = np.cumsum([0] + [len(body) for body in bodies])
    parts: dict[str, np.ndarray] = {}
    for each in fields(Body):
        arrays = [getattr(body, each.name) for body in bodies]
        if each.name in ("springs", "surface", "cells"):
            arrays = [a + start for a, start in zip(arrays, starts, strict=False)]
        elif each.name == "jello":
            arrays = [np.full_like(a, index) for index, a in enumerate(arrays)]
        parts[each.name] = np.concatenate(arrays)
    return Body(**parts)
