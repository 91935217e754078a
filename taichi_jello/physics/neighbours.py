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
LEAST, MOST = 0.2, 1.0  # a margin's usual size, in distances between the points
WIDTH = 2.5  # of the grid's cells, in distances between the points
# The axes along which it is asked which jellos are near each other: of a cube, and through its corners.
AXES = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1))
AXIS_COUNT, LENGTHS = len(AXES), np.linalg.norm(AXES, axis=1)


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
        self.owner = table("jello of each element", body.jello[touching.nodes[:, 0]])
        self.is_found, self.meets_any = zeros("elements near points", self.elements), zeros("meets any", self.jellos)
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
        x0, x1, x2 = np.ascontiguousarray(x.T)
        along = np.stack([x0, x1, x2, x0 + x1 + x2, x0 + x1 - x2, x0 - x1 + x2, x1 + x2 - x0])  # AXES · x
        low, high = (np.ascontiguousarray(f.reduceat(along, self.first, axis=1).T) for f in (np.minimum, np.maximum))
        speed = np.sqrt(np.maximum.reduceat((np.ascontiguousarray(v.T) ** 2).sum(0), self.first).astype(float))
        if not (np.isfinite(low).all() and np.isfinite(high).all() and np.isfinite(speed).all()):
            self._forget()  # the numbers went bad; whoever looks at them says so
            return
        spacing, least = self.touching.spacing, 4.0 * dt * speed
        margin = np.maximum(max(1.5 * frame_dt, 4.0 * dt) * speed, LEAST * spacing)
        meet = self._meet(low, high, margin)
        if meet.any():
            margin = np.maximum(np.minimum(margin, MOST * spacing), least)
            meet = self._meet(low, high, margin)
        while self._search_within(positions, low, high, meet, margin) > self.room and np.any(margin > least):
            margin = np.maximum(0.5 * margin, least)
        self.fresh = True

    def _search_within(self, positions: ti.MatrixField, low: np.ndarray, high: np.ndarray, meet: np.ndarray,
                       margin: np.ndarray) -> int:  # fmt: skip
        width = float(WIDTH * np.mean(self.touching.spacing))
        widest = float((margin + self.touching.radius).max())
        reach = (margin + self.touching.radius)[:, None] * LENGTHS
        hulls = np.hstack([low - reach, high + reach]).astype(self.number)
        start = np.append(0, np.cumsum(meet.sum(1))).astype(np.int32)
        others = np.append(np.nonzero(meet)[1], 0).astype(np.int32)  # never empty
        return self._search(positions, hulls, start, others, margin.astype(self.number), width, widest)

    def _meet(self, low: np.ndarray, high: np.ndarray, margin: np.ndarray) -> np.ndarray:
        """(J, J) whether two jellos may come to touch, by how far each reaches along every axis, (J, A) both."""
        reach = margin + self.touching.radius
        reach = (reach[:, None] + reach[None])[..., None] * LENGTHS
        return np.all((low[:, None] <= high[None] + reach) & (low[None] <= high[:, None] + reach), -1) & self.meets

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
    def bin_at(self, cell):
        """The bin of a cell of the grid; along z they follow each other."""
        return ((cell[0] * 73856093 ^ cell[1] * 19349663) + cell[2]) & (self.bins - 1)

    @ti.func
    def box(self, e, x):
        """The box around element e."""
        nodes = self.nodes[e]
        low = x[nodes[0]]
        high = low
        for k in ti.static(range(1, 8)):
            low, high = ti.min(low, x[nodes[k]]), ti.max(high, x[nodes[k]])
        return low, high

    @ti.func
    def note_all(self, first, last, e, low, high, row, width):
        """List element e with the points in the bins first … last - 1 that are in a row of cells (in any if `width` is
        0), if they are near, and of another jello or else far on its own."""
        if first < last:
            a = self.owner[e]
            for place in range(self.bin_start[first], self.bin_start[last]):
                b = self.item_jello[place]
                if (a != b and self.others) or (a == b and self.with_self):
                    p, reach = self.item_x[place], self.reach[b]
                    if (p > low - reach).all() and (p < high + reach).all():  # noqa: SIM102
                        if width == 0.0 or (ti.floor(p / width, ti.i32)[:2] == row).all():
                            self.note(self.items[place], e, a == b)

    @ti.func
    def note(self, q, e, own):
        meets = True
        if ti.static(self.with_self):  # noqa: SIM102 - decided when it is compiled
            if own:
                j = self.owner[e]
                apart = (self.rest[self.points[q]] - self.rest[self.nodes[e][0]]).norm()
                meets = self.alone[j] and apart > self.apart[j]
        if meets:
            self.is_found[e] = 1
            k = ti.atomic_add(self.state[1], 1)
            if k < self.room:
                self.pairs[k] = ti.Vector([q, e])
                ti.atomic_add(self.start[q + 1], 1)

    @ti.kernel
    def _forget(self):
        self.state[0] = 0

    @ti.kernel
    def _search(self, x: ti.template(), hulls: ti.types.ndarray(), met: ti.types.ndarray(), others: ti.types.ndarray(),
                margins: ti.types.ndarray(), width: float, widest: float) -> int:  # fmt: skip
        """List all pairs; returns how many there are, which may be more than there is room for. Jello j, with its
        margin, reaches from hulls[j, k] to hulls[j, k + AXIS_COUNT] along axis k; it meets others[met[j]] and all
        before others[met[j + 1]].
        """
        self.state[0], self.state[1] = 0, 0
        ti.loop_config(serialize=self.serial)
        for j in range(self.jellos):
            self.margin[j], self.reach[j] = margins[j], margins[j] + self.radius[j]
            self.meets_any[j] = met[j] < met[j + 1]
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
            if self.in_reach(p, p, j, hulls, met, others):
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
            self.is_found[e] = 0
            low, high = self.box(e, x)
            j = self.owner[e]
            if self.in_reach(low, high, j, hulls, met, others):
                self._look(e, low - self.reach[j], high + self.reach[j], width, widest)
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
    def in_reach(self, low, high, j, hulls: ti.template(), met: ti.template(), others: ti.template()):
        """Whether something of jello j in the box from `low` to `high` may come to touch another one."""
        middle, half, inside = 0.5 * (low + high), 0.5 * (high - low), False
        for k in range(met[j], met[j + 1]):
            if not inside:
                within, b = True, others[k]
                for axis in ti.static(range(AXIS_COUNT)):
                    if within:
                        u = ti.Vector(ti.static([float(a) for a in AXES[axis]]))
                        at, reach = u.dot(middle), abs(u).dot(half) + ti.static(float(LENGTHS[axis])) * self.reach[j]
                        within = at + reach >= hulls[b, axis] and at - reach <= hulls[b, axis + AXIS_COUNT]
                inside = within
        return inside

    @ti.func
    def _look(self, e, low, high, width, widest):
        """Note the points in the bins of the cells that the box from `low` to `high` meets, grown by the widest
        margin of a point; or all points, if those are fewer than the rows of cells."""
        first, last = ti.floor((low - widest) / width, ti.i32), ti.floor((high + widest) / width, ti.i32)
        n = last - first + 1
        if float(n[0]) * n[1] > self.count or n[2] > self.bins:
            self.note_all(0, self.bins, e, low, high, ti.Vector([0, 0]), 0.0)
        else:
            for i in range(first[0], last[0] + 1):
                for j in range(first[1], last[1] + 1):
                    row, start = ti.Vector([i, j]), self.bin_at(ti.Vector([i, j, first[2]]))
                    end = start + n[2]
                    self.note_all(start, ti.min(end, self.bins), e, low, high, row, width)
                    self.note_all(0, end - self.bins, e, low, high, row, width)

    @ti.func
    def watch(self, first, last, x, v, dt):
        """Mark the lists as stale if one of the particles first … last - 1 may leave its margin in the next step."""
        for i in range(first, last):
            if (x[i] - self.ref[i]).norm() + 2.0 * dt * v[i].norm() > SPARE * self.margin[self.jello[i]]:
                self.state[0] = 1
