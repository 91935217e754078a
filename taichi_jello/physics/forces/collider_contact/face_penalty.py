"""Contact of faces and edges with colliders small enough to slip between particles."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.collider_contact.collider_penalty import PenaltyContact
from taichi_jello.physics.forces.collider_contact.point_sweep import PointSweep
from taichi_jello.physics.forces.collider_contact.skin_penalty import SkinContact, cell_weight
from taichi_jello.physics.forces.collider_contact.surface_points import (
    Faces,
    SurfacePoints,
    any_finite,
    between_particles,
    between_skin_points,
    parts_wanted,
)
from taichi_jello.physics.forces.springs.spring_state import SpringState
from taichi_jello.physics.forces.springs.tearing import still_there
from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Scene

# For each form: its title, its faces, and the function that puts points on them.
FORMS = (("edge contact", Faces.bare, between_particles), ("skin edge contact", Faces.skins, between_skin_points))


@ti.data_oriented
class FaceContact(SkinContact):
    """Like SkinContact, but at a grid of points on faces and edges, and with small colliders only. Points between
    particles depend on the three corners of a triangle, points on a skin on the eight corners of a cell."""

    title = "edge contact"

    def __init__(self, title: str, scene: Scene, particles: Particles, colliders: Sequence[Any], points: SurfacePoints):
        self.title = title  # type: ignore[misc]
        super().__init__(scene, particles, colliders, points)
        self.whole = np.ones(len(self.cells), bool)

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list[PenaltyContact]:
        if not any_finite(scene.collider) or scene.contact.stiffness == 0.0:
            return []
        made: list[PenaltyContact] = []
        for title, faces_of, points_on in FORMS:
            faces = faces_of(particles.body)
            parts, small = parts_wanted(scene, faces)
            if small:
                made.append(cls(title, scene, particles, small, points_on(particles.body, faces, parts)))
        return made

    def _make_sweep(self, particles: Particles) -> PointSweep:
        return PointSweep(self, particles)

    def set_state(self, state: SpringState) -> None:
        """Switch off the points on torn faces and cells (see tearing.py)."""
        if state.whole is not None:
            cells, faces = np.split(self.cells, [0 if self.width == 3 else len(self.cells)])
            whole = still_there(self.particles.body, state.whole, cells.reshape(-1, 8), faces.reshape(-1, 3))
            if not np.array_equal(whole, self.whole):
                self.whole, rows = whole, self.skin_rows.copy()
                rows[:, 3] *= whole[self.skin_cells]
                self.skin.from_numpy(rows.astype(self.particles.memory.number))

    @ti.func
    def weight(self, k: ti.template(), at):
        w = at[k % 3]
        if ti.static(self.width == 8):
            w = cell_weight(k, at)
        return w
