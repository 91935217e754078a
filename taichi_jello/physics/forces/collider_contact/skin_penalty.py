"""Penalty contact of embedded skins with colliders: at the skin's points, given to the corners of their cells."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import even_block
from taichi_jello.physics.forces.collider_contact.collider_penalty import PenaltyContact
from taichi_jello.physics.forces.collider_contact.continuous_collision import Sweep
from taichi_jello.physics.forces.collider_contact.surface_points import SurfacePoints, of_skin, steepest
from taichi_jello.physics.particles import Particles
from taichi_jello.scene.description import Scene


@ti.func
def cell_weight(k: ti.template(), at):
    """The trilinear weight of corner k = 4a + 2b + c at a place in the cell."""
    w = at[0] if ti.static(k & 4) else 1.0 - at[0]
    w *= at[1] if ti.static(k & 2) else 1.0 - at[1]
    w *= at[2] if ti.static(k & 1) else 1.0 - at[2]
    return w


@ti.data_oriented
class SkinContact(PenaltyContact):
    """Contact as in PenaltyContact, at points Σ w x of skins. `prepare` goes over the cells that hold skin: in a cell
    that may touch, it sums the forces on its points, each times its weight, for each of its `width` corners. Then
    every particle takes the sums of the cells around it, in a fixed order."""

    title = "skin contact"
    prepares = True

    def __init__(self, scene: Scene, particles: Particles, colliders: Sequence[Any], points: SurfacePoints):
        self.touching, self.width = points, points.corners.shape[1]
        super().__init__(scene, particles, colliders, len(points))
        self.in_passes = False
        body, memory = particles.body, particles.memory
        cells, cell = np.unique(points.corners, axis=0, return_inverse=True)
        cell = cell.ravel()
        order, self.points = np.argsort(cell, kind="stable"), len(cells)
        by_particle = np.argsort(cells.ravel(), kind="stable")
        skin = np.column_stack([points.place, points.share])[order]
        self.cells, self.skin_cells, self.skin_rows = cells, cell[order], skin
        self.corners = memory.table(self.title, "corners", cells)
        self.start = memory.table(self.title, "start", np.searchsorted(cell[order], np.arange(len(cells) + 1)))
        self.skin = memory.table(self.title, "skin", skin)
        first = np.searchsorted(cells.ravel()[by_particle], np.arange(len(body) + 1))
        self.first = memory.table(self.title, "first", first)
        self.around = memory.table(self.title, "around", by_particle)  # width · cell + corner, for each particle
        self.near = memory.table(self.title, "near", np.zeros(len(cells), np.int32))
        self.forces = memory.table(self.title, "forces", np.zeros((self.width * len(cells), 3)))

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list[PenaltyContact]:
        wanted = scene.collider and scene.contact.stiffness != 0.0 and len(particles.body.skin_corners)
        return [cls(scene, particles, scene.collider, of_skin(particles.body))] if wanted else []

    def steepest(self, each: np.ndarray) -> float:
        body, points = self.particles.body, self.touching
        share = points.share * each[body.jello[points.corners[:, 0]]]
        return steepest(body.mass, points.corners, points.weights, share)

    def _make_sweep(self, particles: Particles) -> Sweep:
        """For the particles inside a skin, which stand for it; the others only carry it."""
        return Sweep(self, particles, particles.body.embedded & particles.body.inside)

    @ti.func
    def weight(self, k: ti.template(), at):
        return cell_weight(k, at)

    @ti.func
    def at_point(self, q, cell, x):
        """Σ w x, the value of a field at the skin's point q in a cell."""
        p = ti.Vector([0.0, 0.0, 0.0])
        for k in ti.static(range(self.width)):
            p += self.weight(k, self.skin[q]) * x[self.corners[cell][k]]
        return p

    @ti.func
    def may_touch(self, cell, x, t):
        """Whether a surface is nearer to one corner than the farthest other corner is: else none reaches a point
        between the corners, since distances to a surface differ by no more than the way from point to point."""
        corners = self.corners[cell]
        p, squared_reach = x[corners[0]], ti.cast(0.0, float)
        for k in ti.static(range(1, self.width)):
            way = x[corners[k]] - p
            squared_reach = ti.max(squared_reach, way.dot(way))
        return ti.select(self.gap(p, t) <= ti.sqrt(squared_reach), 1, 0)

    @ti.func
    def prepare(self, first, last, x, v, t):
        for cell in range(first, last):
            near = self.may_touch(cell, x, t)
            self.near[cell] = near
            if near:
                law, sums = self.law.of(self.corners[cell][0]), ti.Matrix.zero(float, self.width, 3)
                for q in range(self.start[cell], self.start[cell + 1]):
                    p, u = self.at_point(q, cell, x), self.at_point(q, cell, v)
                    force = self.push(law, q, p, u, t, self.skin[q][3])
                    for k in ti.static(range(self.width)):
                        for axis in ti.static(range(3)):
                            sums[k, axis] += self.weight(k, self.skin[q]) * force[axis]
                for k in ti.static(range(self.width)):
                    self.forces[self.width * cell + k] = ti.Vector([sums[k, 0], sums[k, 1], sums[k, 2]])

    @ti.func
    def end_step(self, system, first, last, x, t):
        system.wait_for_team()  # until x of all particles is there
        for cell in range(system.share_of(first, self.points), system.share_of(last, self.points)):
            if self.near[cell]:
                for q in range(self.start[cell], self.start[cell + 1]):
                    self.hold(self.law.of(self.corners[cell][0]), q, self.at_point(q, cell, x), t)

    @ti.func
    def on(self, i, x, v, t):
        force = ti.Vector([0.0, 0.0, 0.0])
        for e in range(self.first[i], self.first[i + 1]):
            if self.near[self.around[e] // self.width]:
                force += self.forces[self.around[e]]
        return force

    @ti.func
    def curvature(self, i, x, v, t, h):
        """The eight weights of a point sum to one, so w times its block bounds what ties this corner to the others."""
        total = even_block(ti.cast(0.0, float))
        for e in range(self.first[i], self.first[i + 1]):
            cell, own = self.around[e] // self.width, self.around[e] % self.width
            if self.near[cell]:
                for q in range(self.start[cell], self.start[cell + 1]):
                    share = ti.cast(0.0, float)
                    for k in ti.static(range(self.width)):
                        share += self.weight(k, self.skin[q]) * (own == k)
                    p, u = self.at_point(q, cell, x), self.at_point(q, cell, v)
                    total += share * self.stiffening(self.law.of(i), q, p, u, t, h, self.skin[q][3])
        return total

    @ti.func
    def sum_over_own_points(self, i, term: ti.template(), x, v, t, zero):
        """Over the points of the cells that have particle i for their first corner."""
        total = zero
        for e in range(self.first[i], self.first[i + 1]):
            if self.around[e] % self.width == 0:
                cell = self.around[e] // self.width
                for q in range(self.start[cell], self.start[cell + 1]):
                    p, u = self.at_point(q, cell, x), self.at_point(q, cell, v)
                    total += term(self.law.of(i), q, p, u, t, self.skin[q][3])
        return total

    @ti.func
    def energy_of(self, law, q, p, u, t, share):
        return share * self.pressed_energy(law, p, t)

    @ti.func
    def energy(self, i, x, t):
        return self.sum_over_own_points(i, self.energy_of, x, x, t, ti.cast(0.0, float))

    @ti.func
    def powers(self, i, x, v, t):
        return self.sum_over_own_points(i, self.losses, x, v, t, ti.Vector([0.0, 0.0, 0.0]))
