"""Jellos that have gone through each other: which way they come apart again, found once a frame.

A thin body has no inside that would tell on which side of it a point belongs: by the nearest side alone half of a sheet
that crosses another would be held on either side, for good. Where edges go through a sheet, the larger part of what it
cuts is on the right side (as in Baraff, Witkin & Kass 2003, "Untangling cloth"); around the cut contact leads there and
is soft, so that what is pulled through does not come out like a shot.

Solids that are not both compact, as bars and rings, may hold each other in the same way where they cross; there they
part by the least way that leads what is around of one out of what is around of the other. A rope that goes through a
solid parts from it as a whole.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.body import Body
from taichi_jello.physics.boxes import meet, which_meet
from taichi_jello.physics.crossed import ways_apart
from taichi_jello.physics.cuts import surface_edges, ways_back
from taichi_jello.physics.neighbours import Neighbours
from taichi_jello.physics.state import Memory
from taichi_jello.physics.threads import Threads
from taichi_jello.physics.touching import AT_ONCE

SOFT = 0.05  # times as hard as usual is contact around a cut
FIRM = 0.1  # s in which it grows e times harder again when the cut is gone
TURNED = 0.5  # the cosine beyond which a side leads against the way
DEEP = 0.3  # of the way to a core: as deep as what holds each other is
COMPACT, SLENDER, ROPE = 1, 2, 3  # solids that are compact, or not, and ropes; 0: others
NEVER = -1e30  # s
TANGLE = "tangle_"  # begins their names in a snapshot's memory
HELD, NAMES = f"{TANGLE}held", tuple(f"{TANGLE}{name}" for name in ("time", "beside", "way"))


@ti.func
def as_unturned(distance, apart):
    """How much a contact counts for whose normal is turned round, `distance` [m] from what it is to keep `apart` [m]
    from, so that it stores the energy that it would unturned."""
    return (ti.max(0.0, apart - distance) / (apart + distance)) ** 2


@ti.data_oriented
class Tangles:
    """The point q is to leave jello beside[q] - 1, if that is not negative, along way[q], if that is not zero; what it
    touches of that jello counts for soft[q]. All this holds for a frame."""

    def __init__(self, title: str, body: Body, memory: Memory, near: Neighbours):
        touching = near.touching
        self.body, self.near, self.jellos, self.count = body, near, near.jellos, near.count
        self.whose, self.owner = body.jello[touching.points], body.jello[touching.nodes[:, 0]]
        self.has_sheets, self.has_slender = touching.has_sheets, touching.has_slender
        if self.has_sheets:
            edges = surface_edges(touching)
            self.edges = edges[~touching.loose[self.whose[edges[:, 0]]]]
            self.ends = memory.table(title, "edges", self.edges)
            self.sheet = memory.table(title, "sheets", touching.sheet.astype(np.int32))
        self.soft = memory.table(title, "softness", np.ones(self.count))
        self.beside = memory.zeros(title, "jellos to leave", (self.count,), whole=True)
        self.way = memory.zeros(title, "ways to leave them", (self.count, 3))
        self.threads = Threads(touching, body) if touching.has_threads else None
        self.has_holds = self.has_slender or touching.has_threads
        if self.has_holds:
            kinds = COMPACT * touching.compact + SLENDER * touching.slender + ROPE * touching.rope
            self.kind = memory.table(title, "what can hold", kinds.astype(np.int32))
            self.deep = memory.zeros(title, "any so deep that it may be held", (1,), whole=True)
            self.looked = False  # at `deep` for the frame that has just begun
        self.number = memory.number
        self.now = self._none()

    def _none(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.full(self.count, NEVER), np.zeros(self.count, np.int32), np.zeros((self.count, 3))

    @property
    def tangled(self) -> bool:
        """Whether anything is, or was not long ago."""
        return bool(np.any(self.now[0] > NEVER) or self.now[1].any())

    def remembered(self) -> dict[str, np.ndarray]:
        """What a snapshot has to hold."""
        told = dict(zip(NAMES, self.now, strict=True)) if self.tangled else {}
        return told | ({HELD: np.array(1)} if self.has_holds and self.deep[0] else {})

    def recall(self, memory: dict[str, np.ndarray], start: float) -> None:
        """Be as a snapshot remembers, in the frame that begins at `start` [s]."""
        values = self._none()
        if all(name in memory and memory[name].shape == none.shape for name, none in zip(NAMES, values, strict=True)):
            values = memory[NAMES[0]], memory[NAMES[1]], memory[NAMES[2]]
        self._put(*values, start)
        if self.has_holds:
            self.deep[0], self.looked = int(HELD in memory), False

    def begin(self) -> None:
        """The first step of a frame follows."""
        if self.has_holds and self.looked:
            self.deep[0], self.looked = 0, False

    def _put(self, cut: np.ndarray, beside: np.ndarray, way: np.ndarray, start: float) -> None:
        with np.errstate(over="ignore"):
            soft = np.clip(SOFT * np.exp((start - cut) / FIRM), SOFT, 1.0)
        self.now = np.where(soft < 1.0, cut, NEVER), np.where(soft < 1.0, beside, 0), way
        self.soft.from_numpy(soft.astype(self.number))
        self.beside.from_numpy(self.now[1].astype(np.int32))
        self.way.from_numpy(way.astype(self.number))

    def look_over(self, system: Any, contacts: Any, x: np.ndarray, start: float) -> None:
        """Find what holds what as the frame begins, at `start` [s], with the particles at x (N, 3) [m]."""
        deep = bool(self.has_holds and self.deep[0])
        self.looked = True
        hits = self._crossed(system) if self.has_sheets else None
        touched = self._held(system, contacts) if self.has_slender and deep else None
        close = self.threads.close(x, deep or self.tangled) if self.threads else []
        if hits is None and touched is None and not close and not self.tangled:
            return
        touching, jello = self.near.touching, self.body.jello
        place = touching.places(x).astype(float)
        ways: list[tuple[np.ndarray, int, np.ndarray]] = []
        if self.threads:
            leaving = np.where(self.now[2].any(1), self.now[1], 0) - 1
            ways += self.threads.ways_off(x, place, close, leaving)
        if touched is not None:
            ways += ways_apart(touching, jello, x, place, touched)
        if hits is not None:
            ways += ways_back(touching, jello, x, place, self.edges, hits)
        if ways or self.tangled:
            cut, beside, way = self.now[0].copy(), self.now[1].copy(), self._none()[2]
            for points, other, out in ways:
                beside[points], way[points], cut[points] = other + 1, out, start
            self._put(cut, beside, way, start)

    def _crossed(self, system) -> np.ndarray | None:
        """(E,) the elements that the edges go through, see _cross; None if none does."""
        hits = np.empty(len(self.edges), np.int32)
        return hits if self._cross(system, hits) else None

    def _held(self, system, contacts) -> np.ndarray | None:
        """(AT_ONCE Q, 6) the contacts of solids that may hold each other, see _press; None if none is deep."""
        self.beside.fill(0)  # by the nearest faces
        system.probe.find_touched()
        touched = np.zeros((self.count, AT_ONCE, 6), self.number)
        return touched.reshape(-1, 6) if self._press(system, contacts, touched) else None

    @ti.func
    def turned(self, q, b, n, distance, apart):
        """The way along which point q is to leave a thin body of jello b that is `distance` [m] away against n, and
        how much that counts for. A turned contact stores the energy that it would unturned; see Exits.leave."""
        counts = self.softness(q, b)
        if n.dot(self.way_out(q, b)) < -TURNED:
            n = -n
            counts *= as_unturned(distance, apart)
        return n, counts

    @ti.func
    def softness(self, q, b):
        """How much what point q touches of jello b counts for."""
        return ti.select(self.beside[q] == b + 1, self.soft[q], 1.0)

    @ti.func
    def way_out(self, q, b):
        """The way along which point q is to leave jello b; zero if that does not matter."""
        return ti.select(self.beside[q] == b + 1, self.way[q], 0.0 * self.way[q])

    @ti.func
    def notice(self, a, b):
        """Jello a has a point deep in jello b."""
        if ti.static(self.has_holds):  # noqa: SIM102 - decided when it is compiled
            if self.may_hold(a, b) or self.may_thread(a, b):
                self.deep[0] = 1

    @ti.func
    def may_hold(self, a, b):
        """Whether jellos a and b are two solids that may hold each other."""
        return a != b and ti.min(self.kind[a], self.kind[b]) > 0 and ti.max(self.kind[a], self.kind[b]) == SLENDER

    @ti.func
    def may_thread(self, a, b):
        """Whether jellos a and b are a rope and a solid."""
        return 0 < ti.min(self.kind[a], self.kind[b]) < ROPE and ti.max(self.kind[a], self.kind[b]) == ROPE

    @ti.kernel
    def _press(self, system: ti.template(), contacts: ti.template(), touched: ti.types.ndarray()) -> int:
        """For each contact of a pair of solids that may hold each other its normal, its depth and how deep
        [m] is deep, and the other jello's number + 1. Returns how many are so deep."""
        found = 0
        for q in range(self.count):
            a = self.near.jello[self.near.points[q]]
            for k in range(contacts.own[q]):
                contact = q * AT_ONCE + k
                b = self.near.jello[self.near.points[contacts.corners[contact][0]]]
                if self.may_hold(a, b):
                    depth, deep = contacts.depth(contact, system.state.x), DEEP * contacts.core[contact]
                    for axis in ti.static(range(3)):
                        touched[q, k, axis] = contacts.normal[contact][axis]
                    touched[q, k, 3], touched[q, k, 4], touched[q, k, 5] = depth, deep, b + 1
                    found += depth > deep
        return found

    @ti.kernel
    def _cross(self, system: ti.template(), hits: ti.types.ndarray(dtype=ti.i32, ndim=1)) -> int:
        """Returns how many edges go through triangles of thin bodies, and tells which: elements, -1 for none."""
        found = 0
        for edge in range(hits.shape[0]):
            hits[edge] = -1
            a = self.near.jello[self.near.points[self.ends[edge][0]]]
            if self.near.meets_any[a]:
                hits[edge] = self._hit(a, edge, system.state.x)
                found += hits[edge] >= 0
        return found

    @ti.func
    def _hit(self, a, edge, x):
        """A triangle of a thin body between the ends of an edge of jello a, or -1: one of the first body that the edge
        goes through an odd number of times. Found as in the search."""
        p, q = self.near.at(self.ends[edge][0], x), self.near.at(self.ends[edge][1], x)
        hit, k = -1, 0
        while k < self.jellos and self.near.met[a * self.jellos + k] >= 0 and hit < 0:
            b = self.near.met[a * self.jellos + k]
            k += 1
            since = -self.near.clock[0] * self.near.drift[b]
            inside = meet(self.near.hull[b], ti.min(p, q) - since, ti.max(p, q) - since)
            if a != b and self.sheet[b] == 1 and inside:
                hit = self._hit_in(b, p, q, x)
        return hit

    @ti.func
    def _hit_in(self, b, p, q, x):
        hit, often, gone = -1, 0, self.near.centre[b] - self.near.clock[0] * self.near.drift[b]
        here, there = self.near.along(b, p - gone), self.near.along(b, q - gone)
        low, high = ti.min(here, there), ti.max(here, there)
        n = self.near.tree_start[b]
        while n < self.near.tree_start[b + 1]:
            block = self.near.tree_block[n]
            if block >= 0:
                touched, leaf = which_meet(self.near.leaf_box, block, low, high), self.near.tree_leaf[block]
                while touched != 0:
                    e = self.near.tree_order[self.near.tree_first[leaf]]
                    if touched & 1 and self._goes_through(p, q, e, x):
                        hit = e
                        often += 1
                    touched >>= 1
                    leaf += 1
                n = self.near.tree_skip[n]
            elif meet(self.near.node_box[n], low, high):
                n += 1
            else:
                n = self.near.tree_skip[n]
        return ti.select(often % 2 == 1, hit, -1)

    @ti.func
    def _goes_through(self, p, q, e, x):
        """Whether the edge from p to q goes through the triangle e."""
        nodes = self.near.nodes[e]
        a, b, c, way = x[nodes[0]] - p, x[nodes[1]] - p, x[nodes[2]] - p, q - p
        normal = (b - a).cross(c - a)
        u, v, w = way.dot(b.cross(c)), way.dot(c.cross(a)), way.dot(a.cross(b))  # volumes, of one sign inside
        inside = (ti.min(u, v, w) > 0.0) or (ti.max(u, v, w) < 0.0)
        return inside and a.dot(normal) * (a - way).dot(normal) < 0.0
