"""Body: points, masses, springs and skin of one jello or of a whole scene, as frozen NumPy arrays."""

from dataclasses import dataclass, field, fields
from functools import cached_property

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

    A jello may have a finer skin of V points, embedded in its cells: skin_corners (V, 8): the corners of the cell
    that each lies in, in the order of cells; skin_weights (V, 8): trilinear weights, none negative, which sum to 1, so
    that a point is Σ weight · x[corner] wherever the corners are; skin (T', 3): outward, counter-clockwise triangles
    over these points. It is what is seen, grabbed and touched of such a jello, in place of its `surface`.
    inside (N,) bool: whether the particle's rest position is inside that skin; true where there is none.
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
    skin_corners: np.ndarray = field(default_factory=lambda: np.zeros((0, 8), np.int32))
    skin_weights: np.ndarray = field(default_factory=lambda: np.zeros((0, 8)))
    skin: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.int32))
    inside: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))

    def __post_init__(self) -> None:
        if len(self.inside) != len(self.rest):
            object.__setattr__(self, "inside", np.ones(len(self.rest), bool))
        for each in fields(self):
            getattr(self, each.name).setflags(write=False)

    def __len__(self) -> int:
        return len(self.rest)

    @cached_property
    def embedded(self) -> np.ndarray:
        """(N,) bool: whether the particle's jello has an embedded skin."""
        return np.isin(self.jello, self.jello[self.skin_corners[:, 0]])

    @cached_property
    def bare_surface(self) -> np.ndarray:
        """(T, 3): the triangles of `surface` that are a jello's skin themselves."""
        return self.surface[~self.embedded[self.surface[:, 0]]]

    def skin_points(self, x: np.ndarray) -> np.ndarray:
        """(V, 3): where the embedded skin's points are while the particles are at x (N, 3)."""
        return np.einsum("vk,vkd->vd", self.skin_weights, x[self.skin_corners])

    def extent(self, jello: int) -> tuple[np.ndarray, np.ndarray]:
        """The least and the largest coordinates (3,) [m] at the start of what is seen of a jello."""
        points = self.x[self.jello == jello]
        if self.embedded[self.jello == jello].any():
            points = self.skin_points(self.x)[self.jello[self.skin_corners[:, 0]] == jello]
        return points.min(0), points.max(0)


def join(bodies: list[Body]) -> Body:
    """All bodies as one; indices of springs, triangles, cells and skins follow what they count."""
    starts = np.cumsum([0] + [len(body) for body in bodies])
    points = np.cumsum([0] + [len(body.skin_corners) for body in bodies])
    parts: dict[str, np.ndarray] = {}
    for each in fields(Body):
        arrays = [getattr(body, each.name) for body in bodies]
        if each.name in ("springs", "surface", "cells", "skin_corners"):
            arrays = [a + start for a, start in zip(arrays, starts, strict=False)]
        elif each.name == "skin":
            arrays = [a + start for a, start in zip(arrays, points, strict=False)]
        elif each.name == "jello":
            arrays = [np.full_like(a, index) for index, a in enumerate(arrays)]
        parts[each.name] = np.concatenate(arrays)
    return Body(**parts)
