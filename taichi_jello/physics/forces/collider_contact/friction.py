"""Dry friction with a bristle at every touching point (Cundall & Strack 1979).

A spring holds the point along the surface, from the anchor where it came to touch, and a dashpot damps it; together
they pull with no more than Coulomb's μN. At the end of a step the anchor follows a point that has slid. So a point
rests where Coulomb's law holds it, without creep, and slides against μN where it does not.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.state import Memory

NO_SURFACE = -1
TINY = 1e-30  # N


@ti.func
def cone(wanted, limit):
    """The part of a friction force [N] that is within Coulomb's cone, μN = `limit` [N]."""
    return ti.min(1.0, limit / ti.max(wanted.norm(), TINY))


@ti.func
def friction_force(pressed, stretch, slide, friction, stiffness, grip):
    """The force [N] on a point pressed with N = `pressed` [N], `stretch` [m] along the surface from its anchor, which
    slides at `slide` [m/s]."""
    wanted = stiffness * stretch + grip * slide
    return -cone(wanted, friction * pressed) * wanted


@ti.func
def friction_stiffness(pressed, stretch, slide, friction, stiffness, grip, h):
    """How it stiffens an implicit step of h [s] across the normal [N/m]: as a spring and a dashpot that pull as hard
    now."""
    wanted = stiffness * stretch + grip * slide
    return cone(wanted, friction * pressed) * (stiffness + grip / h)


def memory_of(title: str, partner: Any, place: Any, nobody: int) -> dict[str, np.ndarray]:
    """The rows of `partner` (P,) that are not `nobody`, with their partners and places (P, 3)."""
    partners = partner.to_numpy()
    rows = np.flatnonzero(partners != nobody)
    values = {"held points": rows, "held by": partners[rows], "held at": place.to_numpy()[rows]}
    return {f"{title} {name}": value for name, value in values.items()} if len(rows) else {}


def recall(memory: dict[str, np.ndarray], title: str, partner: Any, place: Any, nobody: int) -> None:
    """Write what `memory_of` returned, and `nobody` to all other rows."""
    partners, places = np.full(partner.shape, nobody, np.int32), np.zeros((*place.shape, place.n), np.float64)
    if (rows := memory.get(f"{title} held points")) is not None:
        by, at = (memory.get(f"{title} {name}", np.zeros(0)) for name in ("held by", "held at"))
        if by.shape != rows.shape or at.shape != (len(rows), 3) or rows.min() < 0 or rows.max() >= len(partners):
            raise ValueError(f"{title} held points: expected a state of this scene")
        partners[rows.astype(int)], places[rows.astype(int)] = by, at
    partner.from_numpy(partners)
    place.from_numpy(places.astype(place.to_numpy().dtype))


@ti.data_oriented
class Anchors:
    """For each point the surface that holds it, and where on it, relative to the surface's own point [m]."""

    def __init__(self, title: str, memory: Memory, points: int):
        self.title = title
        self.anchor = memory.zeros(title, "anchors", (points, 3))
        self.surface = memory.table(title, "surfaces that hold", np.full(points, NO_SURFACE, np.int32))

    @ti.func
    def stretch(self, q, surface, p, n):
        """How far [m] the point q, at p relative to a surface's point, is from its anchor along the surface."""
        way = ti.Vector([0.0, 0.0, 0.0])
        if self.surface[q] == surface:
            way = p - self.anchor[q]
            way -= way.dot(n) * n
        return way

    @ti.func
    def follow(self, q, surface, p, n, longest):
        """At the end of a step: a surface holds the point, `longest` [m] from its anchor at most."""
        way = self.stretch(q, surface, p, n)
        self.anchor[q] = p - ti.min(1.0, longest / ti.max(way.norm(), TINY)) * way
        self.surface[q] = surface

    @ti.func
    def let_go(self, q):
        self.surface[q] = NO_SURFACE

    def remembered(self) -> dict[str, np.ndarray]:
        """The points that are held, their surfaces and anchors; nothing if there are none."""
        return memory_of(self.title, self.surface, self.anchor, NO_SURFACE)

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Restore the moment of `memory`; without one, points touch anew. Raises ValueError for another scene's."""
        recall(memory, self.title, self.surface, self.anchor, NO_SURFACE)
