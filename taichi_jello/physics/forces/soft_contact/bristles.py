"""Static friction between jellos: how far each contact has been dragged along the surface since it stuck.

As at colliders (see collider_contact/friction.py) a contact pulls back like a spring that is stretched no farther than
Coulomb's law allows. The contacts are found anew in every step, so a point passes the stretch on to the next contact
that it has with the same jello.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.collider_contact.friction import TINY, memory_of, recall
from taichi_jello.physics.state import Memory

NOBODY = -1


@ti.data_oriented
class Bristles:
    """Of a contact in this step: `offset`, its `along` (see Touch) as the step began, less the stretch [m] it had then.
    Kept from step to step, in the places of a point's contacts: the jello touched and the stretch."""

    def __init__(self, title: str, memory: Memory, contacts: int, per_point: int):
        self.title, self.per_point = title, per_point
        self.offset = memory.zeros(title, "offsets of contacts", (contacts, 3))
        self.jello = memory.table(title, "jellos that contacts stick to", np.full(contacts, NOBODY, np.int32))
        self.kept = memory.zeros(title, "stretches kept", (contacts, 3))

    @ti.func
    def begin(self, contact, other, n, along):
        """A contact with jello `other` and the normal n is where it is as the step begins."""
        stretch = ti.Vector([0.0, 0.0, 0.0])
        first = contact // self.per_point * self.per_point
        for k in range(first, first + self.per_point):
            if self.jello[k] == other:
                stretch = self.kept[k]
        self.offset[contact] = along - (stretch - stretch.dot(n) * n)

    @ti.func
    def end(self, contact, other, along, longest):
        """It is there as the step ends, with a stretch of `longest` [m] at most."""
        stretch = along - self.offset[contact]
        self.kept[contact] = ti.min(1.0, longest / ti.max(stretch.norm(), TINY)) * stretch
        self.jello[contact] = other

    @ti.func
    def let_go(self, contact):
        self.jello[contact] = NOBODY

    def remembered(self) -> dict[str, np.ndarray]:
        """The contacts that stick, the jellos touched and the stretches; nothing if there are none."""
        return memory_of(self.title, self.jello, self.kept, NOBODY)

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Restore the moment of `memory`; without one, all contacts are new. Raises ValueError for another scene's."""
        recall(memory, self.title, self.jello, self.kept, NOBODY)
