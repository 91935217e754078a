"""Which points are near which elements: a uniform grid on the deformed bodies, searched again when they have moved.

A list made with a margin stays right until something has moved by half of it, as in molecular dynamics (Verlet 1967).
Here every jello has a margin of its own, about as wide as it goes in a frame. A list may hold too much: what it holds
beyond the points that touch adds nothing, so no number depends on when a list was made.
"""

import numpy as np
import taichi as ti

from taichi_jello.body import Body
from taichi_jello.physics.state import ALONE, Memory
from taichi_jello.physics.touching import Touching

ROOM = 40  # places in the list for each point
SPARE = 0.8  # of a margin after which the lists are made again; the rest covers the step that follows
OWN = 2.5  # distances between the points within which a jello does not touch itself: there its springs hold
LEAST, MOST = 0.1, 0.6  # a margin's usual size, in distances between the points


@ti.data_oriented
class Neighbours:
    """found[start[q]] … found[start[q + 1] - 1]: the elements near point q, in ascending order."""

    def __init__(self, title: str, body: Body, memory: Memory, touching: Touching, others: bool, itself: np.ndarray):
        """others: whether jellos meet other ones; itself (J,) bool: which meet themselves."""

        def table(name: str, values: np.ndarray) -> ti.Field:
            return memory.table(title, name, values)

        def zeros(name: str, *shape: int) -> ti.Field:
            return memory.zeros(title, name, shape, whole=True)

        self.touching, self.number, self.particles = touching, memory.number, memory.particles
        self.count, self.elements, self.jellos = len(touching.points), len(touching.nodes), len(touching.radius)
        self.serial = memory.owner.on_cpu and memory.particles < ALONE
        self.room = ROOM * self.count
        self.bins = 1 << (2 * self.count - 1).bit_length()
        self.first = np.searchsorted(body.jello, np.arange(self.jellos))
        self.points, self.nodes = table("points", touching.points), table("elements", touching.nodes)
        self.bare, self.skinned = touching.bare, touching.bare < self.count
        if self.skinned:
            self.corners, self.weights = (
                table("skin corners", touching.corners),
                table("skin weights", touching.weights),
            )
        self.jello, self.radius = table("jello", body.jello), table("radius", touching.radius)
        self.margin = memory.zeros(title, "margins", (self.jellos,))
        self.reach = memory.zeros(title, "reach", (self.jellos,))
        self.ref = memory.vectors(title, "x at the last search")
        self.state = zeros("stale, pairs", 2)
        self.pairs, self.found, self.start = (
            zeros("pairs", self.room, 2),
            zeros("found", self.room),
            zeros("start", self.count + 1),
        )
        self.bin_start, self.cursor = zeros("bins", self.bins + 1), zeros("cursor", max(self.count, self.bins))
        self.bin_of, self.items = zeros("bin of each point", self.count), zeros("points by bin", self.count)
        self.item_jello, self.item_x = (
            zeros("their jellos", self.count),
            memory.zeros(title, "their x", (self.count, 3)),
        )
        self.others, self.itself, self.with_self = others, itself, bool(itself.any())
        self.meets = np.where(np.eye(self.jellos, dtype=bool), itself, others)
        if self.with_self:
            self.alone = table("meets itself", itself.astype(np.int32))
            self.rest = table("rest", body.rest)
            self.apart = table("own neighbourhood", OWN * touching.spacing)
        self.fresh = False

    def refresh(self, x: np.ndarray, v: np.ndarray, positions: ti.MatrixField, dt: float, frame_dt: float) -> None:
        """Search again, for particles at x that move at v, (N, 3) each, as `positions` has them too."""
        if not np.isfinite(x).all() or not np.isfinite(v).all():
            self._forget()  # the numbers went bad; whoever looks at them says so
            return
        speed = np.maximum.reduceat(np.sqrt(np.einsum("ia,ia->i", v, v)), self.first).astype(float)
        low, high = np.minimum.reduceat(x, self.first).astype(float), np.maximum.reduceat(x, self.first).astype(float)
        spacing = self.touching.spacing
        margin = np.maximum(max(1.5 * frame_dt, 4.0 * dt) * speed, LEAST * spacing)
        zones = self._zones(low, high, margin)
        if np.any(zones[:, 0] <= zones[:, 3]):
            margin = np.maximum(np.minimum(margin, MOST * spacing), 4.0 * dt * speed)
            zones = self._zones(low, high, margin)
        least = 4.0 * dt * speed
        while self._search_within(positions, zones, margin) > self.room and np.any(margin > least):
            margin = np.maximum(0.5 * margin, least)
        self.fresh = True

    def _search_within(self, positions: ti.MatrixField, zones: np.ndarray, margin: np.ndarray) -> int:
        width = float(2.0 * np.mean(self.touching.spacing) + 2.0 * margin.max())
        widest = float((margin + self.touching.radius).max())
        return self._search(positions, zones.astype(self.number), margin.astype(self.number), width, widest)

    def _zones(self, low: np.ndarray, high: np.ndarray, margin: np.ndarray) -> np.ndarray:
        """(J, 6): the box outside of which no part of a jello can touch another one; its low above its high if it
        meets none."""
        reach = margin + self.touching.radius
        reach = (reach[:, None] + reach[None])[..., None]
        meet = np.all((low[:, None] <= high[None] + reach) & (low[None] <= high[:, None] + reach), -1) & self.meets
        zone_low = np.where(meet[..., None], low[None] - reach, np.inf).min(1)
        zone_high = np.where(meet[..., None], high[None] + reach, -np.inf).max(1)
        return np.hstack([zone_low, zone_high])

    @ti.func
    def at(self, q, x):
        """What the point q has of a field x of the particles."""
        p = x[self.points[q]]
        if ti.static(self.skinned):  # noqa: SIM102
            if q >= self.bare:
                p *= 0.0
                for k in range(8):
                    p += self.weights[q - self.bare][k] * x[self.corners[q - self.bare][k]]
        return p

    @ti.func
    def bin_at(self, place):
        """The bin of a cell of the grid."""
        return (place[0] * 73856093 ^ place[1] * 19349663 ^ place[2] * 83492791) & (self.bins - 1)

    @ti.func
    def box(self, e, x):
        """The box around element e, as far as a point may be that it touches or soon may touch."""
        nodes = self.nodes[e]
        low = x[nodes[0]]
        high = low
        for k in ti.static(range(1, 8)):
            low, high = ti.min(low, x[nodes[k]]), ti.max(high, x[nodes[k]])
        reach = self.reach[self.jello[nodes[0]]]
        return low - reach, high + reach

    @ti.func
    def note(self, place, e, a, low, high):
        """List element e of jello a with the point at a place in the bins, if it is near, and of another jello or else
        far on its own. (It may come twice, if two cells share a bin; that does no harm.)"""
        b = self.item_jello[place]
        if (a != b and self.others) or (a == b and self.with_self):
            p, reach = self.item_x[place], self.reach[b]
            if (p > low - reach).all() and (p < high + reach).all():
                q, meets = self.items[place], True
                if ti.static(self.with_self):  # noqa: SIM102
                    if a == b:
                        apart = (self.rest[self.points[q]] - self.rest[self.nodes[e][0]]).norm()
                        meets = self.alone[a] and apart > self.apart[a]
                if meets:
                    k = ti.atomic_add(self.state[1], 1)
                    if k < self.room:
                        self.pairs[k] = ti.Vector([q, e])
                        ti.atomic_add(self.start[q + 1], 1)

    @ti.kernel
    def _forget(self):
        self.state[0] = 0

    @ti.kernel
    def _search(self, x: ti.template(), zones: ti.types.ndarray(), margins: ti.types.ndarray(),
                width: float, widest: float) -> int:  # fmt: skip
        """List all pairs; returns how many there are, which may be more than there is room for."""
        self.state[0], self.state[1] = 0, 0
        ti.loop_config(serialize=self.serial)
        for j in range(self.jellos):
            self.margin[j], self.reach[j] = margins[j], margins[j] + self.radius[j]
        ti.loop_config(serialize=self.serial)
        for h in range(self.bins + 1):
            self.bin_start[h] = 0
        ti.loop_config(serialize=self.serial)
        for i in range(self.particles):
            self.ref[i] = x[i]
        ti.loop_config(serialize=self.serial)
        for q in range(self.count):
            self.start[q + 1] = 0
            p, j = self.at(q, x), self.jello[self.points[q]]
            self.bin_of[q] = -1
            if self.in_zone(p, p, j, zones):
                self.bin_of[q] = self.bin_at(ti.floor(p / width, ti.i32))
                ti.atomic_add(self.bin_start[self.bin_of[q] + 1], 1)
        ti.loop_config(serialize=True)
        for h in range(self.bins):
            self.cursor[h] = self.bin_start[h]
            self.bin_start[h + 1] = self.bin_start[h + 1] + self.bin_start[h]
        ti.loop_config(serialize=self.serial)
        for q in range(self.count):
            if self.bin_of[q] >= 0:
                place = ti.atomic_add(self.cursor[self.bin_of[q]], 1)
                self.items[place], self.item_jello[place] = q, self.jello[self.points[q]]
                self.item_x[place] = self.at(q, x)
        ti.loop_config(serialize=self.serial, block_dim=64)
        for e in range(self.elements):
            low, high = self.box(e, x)
            j = self.jello[self.nodes[e][0]]
            if self.in_zone(low, high, j, zones):
                self._look(e, low, high, width, widest)
        ti.loop_config(serialize=True)
        for q in range(self.count):
            self.cursor[q] = self.start[q]
            self.start[q + 1] = self.start[q + 1] + self.start[q]
        ti.loop_config(serialize=self.serial)
        for k in range(ti.min(self.state[1], self.room)):
            self.found[ti.atomic_add(self.cursor[self.pairs[k][0]], 1)] = self.pairs[k][1]
        ti.loop_config(serialize=self.serial, block_dim=64)
        for q in range(self.count):
            for k in range(self.start[q] + 1, self.start[q + 1]):  # insertion sort
                e, place = self.found[k], k
                while place > self.start[q] and self.found[place - 1] > e:
                    self.found[place] = self.found[place - 1]
                    place -= 1
                self.found[place] = e
        return self.state[1]

    @ti.func
    def in_zone(self, low, high, j, zones: ti.template()):
        inside = True
        for axis in ti.static(range(3)):
            inside = inside and low[axis] <= zones[j, 3 + axis] and high[axis] >= zones[j, axis]
        return inside

    @ti.func
    def _look(self, e, low, high, width, widest):
        """Note the points in the bins of the cells that the box from `low` to `high` meets, grown by the widest
        margin of a point; or all points, if those are fewer than the cells."""
        first, last = ti.floor((low - widest) / width, ti.i32), ti.floor((high + widest) / width, ti.i32)
        n, a = last - first + 1, self.jello[self.nodes[e][0]]
        if float(n[0]) * n[1] * n[2] > self.count:
            for place in range(self.bin_start[self.bins]):
                self.note(place, e, a, low, high)
        else:
            for k in range(n[0] * n[1] * n[2]):
                cell = first + ti.Vector([k // (n[1] * n[2]), k // n[2] % n[1], k % n[2]])
                h = self.bin_at(cell)
                for place in range(self.bin_start[h], self.bin_start[h + 1]):
                    self.note(place, e, a, low, high)

    @ti.func
    def watch(self, first, last, x, v, dt):
        """Mark the lists as stale if one of the particles first … last - 1 may leave its margin in the next step."""
        for i in range(first, last):
            if (x[i] - self.ref[i]).norm() + 2.0 * dt * v[i].norm() > SPARE * self.margin[self.jello[i]]:
                self.state[0] = 1
