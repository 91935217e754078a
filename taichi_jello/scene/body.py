"""Body: points, masses, springs and skin of one jello or of a whole scene, as frozen NumPy arrays."""

from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

FAMILY_NAMES = ("structural", "shear", "bend", "other")
CORNERS = np.array(list(np.ndindex(2, 2, 2)))  # of a cell, in steps along its x, y and z


@dataclass(frozen=True, kw_only=True)
class Body:
    """N particles, S springs and T surface triangles, SI units.

    rest (N, 3): undeformed positions in the shape's own frame. x, v (N, 3): initial positions and velocities.
    mass (N,); pinned (N,) bool; jello (N,): index of the particle's jello in the scene.
    springs (S, 2): particle pairs, the lower index first; rest_length, stiffness, damping (S,); family (S,): index in
    FAMILY_NAMES; direction (S, 3): unit vector between the rest positions, along which a spring of zero length pushes.
    surface (T, 3): outward, counter-clockwise triangles.
    cells (C, 8): corners, in the order of CORNERS, of the hexahedra that fill a solid; none for a sheet or a rope.

    A jello may have a finer skin of V points embedded in its cells. It is then drawn, grabbed and touched in place of
    `surface`. skin_corners (V, 8): corners of the cell around each point, ordered as in cells; skin_weights (V, 8):
    trilinear weights ≥ 0 that sum to 1; skin (T', 3): triangles over these points. inside (N,) bool: whether the
    particle's rest position is inside the skin; true without one.
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
        """(T, 3): triangles of `surface` of the jellos without an embedded skin."""
        return self.surface[~self.embedded[self.surface[:, 0]]]

    @cached_property
    def ropes(self) -> np.ndarray:
        """The numbers of the jellos without a surface."""
        return np.setdiff1d(self.jello, self.jello[self.surface])

    @cached_property
    def spacing(self) -> float:
        """The median rest length [m] of structural springs, of all springs if there are none."""
        near = self.rest_length[self.family == 0]
        return float(np.median(near if len(near) else self.rest_length))

    def skin_points(self, x: np.ndarray) -> np.ndarray:
        """(V, 3) positions of the embedded skin's points for particles at x (N, 3)."""
        return np.einsum("vk,vkd->vd", self.skin_weights, x[self.skin_corners])

    def extent(self, jello: int) -> tuple[np.ndarray, np.ndarray]:
        """Opposite corners (3,) [m] of the initial bounding box of a jello, of its skin if it has one."""
        points = self.x[self.jello == jello]
        if self.embedded[self.jello == jello].any():
            points = self.skin_points(self.x)[self.jello[self.skin_corners[:, 0]] == jello]
        return points.min(0), points.max(0)


def join(bodies: list[Body]) -> Body:
    """All bodies as one, with the indices in springs, triangles, cells and skins shifted."""
    particles = np.cumsum([0] + [len(body) for body in bodies])
    points = np.cumsum([0] + [len(body.skin_corners) for body in bodies])
    shifts = dict.fromkeys(("springs", "surface", "cells", "skin_corners"), particles) | {"skin": points}
    parts = {each.name: [getattr(body, each.name) for body in bodies] for each in fields(Body)}
    for name, shift in shifts.items():
        parts[name] = [a + start for a, start in zip(parts[name], shift, strict=False)]
    parts["jello"] = [np.full_like(a, index) for index, a in enumerate(parts["jello"])]
    return Body(**{name: np.concatenate(arrays) for name, arrays in parts.items()})
