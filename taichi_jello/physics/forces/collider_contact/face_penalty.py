"""Penalty contact of faces and edges with small colliders."""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.collider_contact.skin_penalty import SkinContact
from taichi_jello.physics.forces.collider_contact.surface_points import MAX_PARTS, between, parts_needed
from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Scene


@ti.data_oriented
class FaceContact(SkinContact):
    """Contact as in SkinContact at points between particles, with the colliders that fit between these."""

    title = "contact between particles"
    guards = False

    @classmethod
    def made_for(cls, scene, particles):
        if not scene.collider or scene.contact.stiffness == 0.0:
            return []
        parts = parts_needed(particles.body, scene.collider)
        small = [c for c, n in zip(scene.collider, parts.max(0), strict=True) if n > 1]
        import os
        global MAX_PARTS
        MAX_PARTS = int(os.environ.get("MAXP", MAX_PARTS))
        if not small:
            return []
        points = between(particles.body, np.minimum(parts.max(1), MAX_PARTS))
        sh = os.environ.get("SHARE")
        if sh: points.share[:] = np.minimum(1.0, points.share*float(sh))
        return [cls(scene, particles, small, points)]

    @ti.func
    def weight(self, k: ti.template(), at):
        return at[k]
