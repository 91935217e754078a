"""Sheets and ropes that have gone through something: which way they come apart again.

A thin body has no inside that would tell on which side of it a point belongs: by the nearest side alone half of a sheet
that crosses another would be held on either side, for good. Where edges go through a sheet, the larger part of what it
cuts is on the right side (as in Baraff, Witkin & Kass 2003, "Untangling cloth"); around the cut contact leads there and
is soft, so that what is pulled through does not come out like a shot.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.body import Body
from taichi_jello.physics.boxes import meet, which_meet
from taichi_jello.physics.cuts import right_side, surface_edges
from taichi_jello.physics.neighbours import Neighbours
from taichi_jello.physics.state import Memory

SOFT = 0.05  # times as hard as usual is contact around a cut
FIRM = 0.1  # s in which it grows e times harder again when the cut is gone
TURNED = 0.5  # the cosine beyond which a side leads against the way
AROUND = 2.0  # distances between the points: how far from a cut that is
NEVER = -1e30  # s
NAMES = ("tangle_time", "tangle_beside", "tangle_way")  # in a snapshot's memory


@ti.data_oriented
class Tangles:
    """At a cut the point q is beside jello beside[q] - 1, and its contacts count for soft[q]; jello a leaves jello b
    along way[J a + b], zero where they do not cross. All this holds for a frame."""

    def __init__(self, title: str, body: Body, memory: Memory, near: Neighbours):
        touching = near.touching
        self.body, self.near, self.jellos, self.count = body, near, near.jellos, near.count
        self.whose, self.owner = body.jello[touching.points], body.jello[touching.nodes[:, 0]]
        self.edges = surface_edges(touching)
        self.ends = memory.table(title, "edges", self.edges)
        self.beside = memory.zeros(title, "cuts beside points", (self.count,), whole=True)
        self.soft = memory.table(title, "softness at cuts", np.ones(self.count))
        self.way = memory.zeros(title, "ways out of cuts", (self.jellos**2, 3))
        self.number = memory.number
        self.now = self._none()

    def _none(self) -> tuple[np.ndarray, ...]:
        return np.full(self.count, NEVER), np.zeros(self.count, np.int32), np.zeros((self.jellos**2, 3))

    @property
    def tangled(self) -> bool:
        """Whether anything is, or was not long ago."""
        return bool(np.any(self.now[0] > NEVER))

    def remembered(self) -> dict[str, np.ndarray]:
        """What a snapshot has to hold."""
        return dict(zip(NAMES, self.now, strict=True)) if self.tangled else {}

    def recall(self, memory: dict[str, np.ndarray], start: float) -> None:
        """Be as a snapshot remembers, in the frame that begins at `start` [s]."""
        none = self._none()
        asked = tuple(np.asarray(memory.get(name, usual)) for name, usual in zip(NAMES, none, strict=True))
        fits = all(one.shape == usual.shape for one, usual in zip(asked, none, strict=True))
        self._put(*(asked if fits else none), start)

    def _put(self, cut: np.ndarray, beside: np.ndarray, way: np.ndarray, start: float) -> None:
        with np.errstate(over="ignore"):
            soft = np.clip(SOFT * np.exp((start - cut) / FIRM), SOFT, 1.0)
        self.now = np.where(soft < 1.0, cut, NEVER), beside, way
        self.soft.from_numpy(soft.astype(self.number))
        self.beside.from_numpy(beside.astype(np.int32))
        self.way.from_numpy(way.astype(self.number))

    def look_over(self, system: Any, x: np.ndarray, start: float) -> None:
        """Find what crosses what as the frame begins, at `start` [s], with the particles at x (N, 3) [m]."""
        hits = np.empty(len(self.edges), np.int32)
        crossed = self._cross(system, hits) > 0
        if crossed or self.tangled:
            cut, beside, way = self.now[0].copy(), *self._none()[1:]
            if crossed:
                self._tell(x.astype(float), hits, beside, way)
            cut[beside > 0] = start
            self._put(cut, beside, way, start)

    def _tell(self, x, hits, beside, way) -> None:
        """Fill in what is to be known of the edges that go through the elements `hits` (E,), -1 for none."""
        touching = self.near.touching
        place = np.concatenate([x[touching.points[: touching.bare]], self.body.skin_points(x)])
        cut = np.flatnonzero(hits >= 0)
        a, b, c = np.moveaxis(x[touching.nodes[hits[cut], :3]], 1, 0)
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        first, last = np.moveaxis(place[self.edges[cut]], 1, 0)
        above, below = (np.abs(np.einsum("kd,kd->k", end - a, normal))[:, None] for end in (first, last))
        where = (below * first + above * last) / (above + below)
        pair = np.stack([self.whose[self.edges[cut, 0]], self.owner[hits[cut]]], 1)
        for both in np.unique(np.sort(pair, 1), axis=0):
            found = []
            for one, other in (both, both[::-1]):
                own = np.flatnonzero((pair == (one, other)).all(1))
                if len(own):
                    points = np.flatnonzero(self.whose == one)  # in a row only among the bare ones and among the skin's
                    edges = np.flatnonzero(self.whose[self.edges[:, 0]] == one)
                    wrong, out = right_side(
                        place[points],
                        np.searchsorted(points, self.edges[edges]),
                        np.searchsorted(edges, cut[own]),
                        where[own],
                        normal[own],
                    )
                    found.append((wrong, one, other, out))
                    reach = AROUND * touching.spacing[both].max()
                    for q in np.flatnonzero(np.isin(self.whose, both)):
                        if np.linalg.norm(where[own] - place[q], axis=1).min() < reach:
                            beside[q] = 1 + both.sum() - self.whose[q]
            _, one, other, out = min(found, key=lambda f: f[:2])
            way[one * self.jellos + other], way[other * self.jellos + one] = out, -out

    @ti.func
    def turned(self, q, b, n, distance, apart):
        """The way along which point q is to leave a thin body of jello b that is `distance` [m] away against n, and
        how much that counts for. A turned contact stores the energy that it would unturned; see Exits.leave."""
        counts = self.soft[q]
        if self.beside[q] == b + 1:
            a = self.near.jello[self.near.points[q]]
            if n.dot(self.way[a * self.jellos + b]) < -TURNED:
                n = -n
                counts *= (ti.max(0.0, apart - distance) / (apart + distance)) ** 2
        return n, counts

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
            if a != b and self.near.radius[b] > 0.0:
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
