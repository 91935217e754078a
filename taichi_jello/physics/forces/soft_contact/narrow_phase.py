"""Narrow phase: which points touch which other jello, and where; once a step, where the step is about to end."""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.contact_law import ContactLaw
from taichi_jello.physics.forces.soft_contact.contacts import Contacts
from taichi_jello.physics.forces.soft_contact.fast.inelastic_brake import Brake
from taichi_jello.physics.forces.soft_contact.search.neighbour_list import BUSY, NeighbourList
from taichi_jello.physics.forces.soft_contact.solid_contacts import SolidContacts
from taichi_jello.physics.forces.soft_contact.surface.surface_fields import SurfaceFields
from taichi_jello.physics.forces.soft_contact.thin_contacts import ThinContacts
from taichi_jello.physics.forces.springs.spring_state import SpringState
from taichi_jello.physics.forces.springs.tearing import still_there
from taichi_jello.physics.state import Memory
from taichi_jello.scene.body import Body

ROUNDS = 5


@ti.data_oriented
class NarrowPhase:
    """tears: whether springs of any jello may tear; an element that is torn apart is not touched any more."""

    def __init__(
        self,
        title: str,
        body: Body,
        memory: Memory,
        surface: SurfaceFields,
        near: NeighbourList,
        law: ContactLaw,
        tears: bool,
    ):
        self.body, self.surface, self.near = body, surface, near
        self.contacts = Contacts(title, memory, surface, law)
        can_brake = surface.others and int(np.sum(~surface.touching.shapes.loose)) > 1
        self.brake: Any = Brake(title, memory, surface) if can_brake else None
        self.brakes = can_brake
        whole = np.ones(surface.elements, np.int32)
        self.intact = memory.table(title, "elements not parted", whole) if tears else None
        found = self.contacts, near, self.brake, self.intact
        self.solids: Any = SolidContacts(title, memory, *found) if surface.solid else None
        self.thin: Any = ThinContacts(title, body, memory, *found) if surface.has_thin else None

    def set_state(self, state: SpringState) -> None:
        """Let go of elements that are torn (see spring_state.py)."""
        if self.intact is not None and state.whole is not None:
            nodes, solid = self.surface.touching.nodes, self.surface.solid
            there = still_there(self.body, state.whole, nodes[:solid], nodes[solid:, :3])
            self.intact.from_numpy(there.astype(np.int32))

    @ti.func
    def find_contacts(self, r: ti.template(), system, first, last, x, v, ahead):
        """Round r of the search for contacts at x + ahead v, which all members of a team finish before the next one
        begins; by the member whose particles are first … last - 1, for its share of everything."""
        busy = ti.static(self.near.busy)
        from_, to = system.share_of(first, self.surface.count), system.share_of(last, self.surface.count)
        if ti.static(r == 0):
            for i in range(first, last):
                self.contacts.ahead[i] = x[i] + ahead * v[i]
            for q in range(from_, to):
                self.contacts.clear(q)
            for _ in range(ti.select(first == 0, 1, 0)):
                self.contacts.listed[0] = 0
                if ti.static(self.brakes):
                    self.brake.reset()
        elif ti.static(r == 1):
            for q in range(from_, to):
                if self.near.meets_any[self.surface.jello_of(q)]:
                    self.contacts.place[q] = self.surface.at(q, self.contacts.ahead)
            if ti.static(self.surface.solid > 0):
                nodes = self.near.boxes_of_nodes
                for n in range(system.share_of(first, nodes), system.share_of(last, nodes)):
                    if self.near.is_found[n] and self.solids.block[n] >= 0:
                        self.solids.fit(n)
        elif ti.static(r == 2):
            some = self.near.state[BUSY]
            for k in range(system.share_of(first, some), system.share_of(last, some)):
                if ti.static(self.surface.solid > 0):
                    self.solids.find(busy[k])
                if ti.static(self.surface.has_thin):
                    self.thin.find(busy[k], v, ahead)
        elif ti.static(r == 3):
            self.contacts.list_pressing(busy, self.near.state[BUSY], from_, to)
        else:
            some = self.near.state[BUSY]
            for k in range(system.share_of(first, some), system.share_of(last, some)):
                self.contacts.share_loads(busy[k])
