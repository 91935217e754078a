"""Which points are near which elements: a uniform grid on the deformed bodies, searched again when they have moved.

A list made with a margin stays right until something has moved by half of it, as in molecular dynamics (Verlet 1967).
Here every particle has a margin of its own: how far its jello goes in a frame, within bounds, or itself in some steps.
A list may hold too much: what it holds beyond the points that touch adds nothing, so no number depends on when it was
made.
"""

import numpy as np
import taichi as ti

from taichi_jello.body import Body
from taichi_jello.physics.state import ALONE, Memory
from taichi_jello.physics.touching import Touching

ROOM = 40  # places in the list for each point
SPARE = 0.8  # of a margin after which the lists are made again; the rest covers the step that follows
OWN = 2.5  # distances between the points within which a jello does not touch itself: there its springs hold
LEAST, MOST = 0.4, 0.6  # a margin's usual size, in distances between the points
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
        self.body_jello, self.number_of = body.jello, np.bincount(body.jello)
        self.margin = memory.zeros(title, "margins", (memory.particles,))
        self.item_reach = memory.zeros(title, "their reach", (self.count,))
        self.ref = memory.vectors(title, "x at the last search")
        self.state = zeros("stale, pairs", 2)
        self.pairs, self.found, self.start = (
            zeros("pairs", self.room, 2),
            zeros("found", self.room),
            zeros("start", self.count + 1),
        )
        self.bin_start, self.cursor = zeros("bins", self.bins + 2), zeros("cursor", max(self.count, self.bins + 1))
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
        speed = np.sqrt((np.ascontiguousarray(v.T) ** 2).sum(0))
        if not (np.isfinite(along).all() and np.isfinite(speed).all()):
            self._forget()  # the numbers went bad; whoever looks at them says so
            return
        spacing = self.touching.spacing
        usual = np.sqrt(np.add.reduceat(speed**2, self.first) / self.number_of)  # [m/s] of each jello
        most = np.clip(1.5 * frame_dt * usual, LEAST * spacing, MOST * spacing)
        steps = np.where(speed > 2.0 * usual[self.body_jello], 8.0, 3.0)  # few are quicker than that
        while True:
            margin = np.maximum(most[self.body_jello], steps * dt * speed)
            widest = float((np.maximum(most, 6.0 * dt * usual) + self.touching.radius).max())
            if self._search_within(positions, along, margin, widest) <= self.room or most.max() < 0.01 * spacing.min():
                break
            most = 0.5 * most
        self.fresh = True

    def _search_within(self, positions: ti.MatrixField, along: np.ndarray, margin: np.ndarray,
                       widest: float) -> int:  # fmt: skip
        reach = margin + self.touching.radius[self.body_jello]
        grown = (LENGTHS[:, None] * reach).astype(self.number)
        low = np.minimum.reduceat(along - grown, self.first, axis=1).T
        high = np.maximum.reduceat(along + grown, self.first, axis=1).T
        meet = np.all((low[:, None] <= high[None]) & (low[None] <= high[:, None]), -1) & self.meets
        start = np.append(0, np.cumsum(meet.sum(1))).astype(np.int32)
        others = np.append(np.nonzero(meet)[1], 0).astype(np.int32)  # never empty
        width = float(WIDTH * np.mean(self.touching.spacing))
        hulls = np.hstack([low, high])
        return self._search(positions, hulls, start, others, margin.astype(self.number), width, widest)

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
    def reach_of(self, q):
        """How far from itself point q may touch before the lists are made again."""
        reach = self.margin[self.points[q]]
        if ti.static(self.skinned):  # noqa: SIM102
            if q >= self.bare:
                for k in range(8):
                    reach = ti.max(reach, self.margin[self.corners[q - self.bare][k]])
        return reach + self.radius[self.jello[self.points[q]]]

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
                    p, reach = self.item_x[place], self.item_reach[place]
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
            self.meets_any[j] = met[j] < met[j + 1]
        ti.loop_config(serialize=self.serial)
        for h in range(self.bins + 2):
            self.bin_start[h] = 0
        ti.loop_config(serialize=self.serial)
        for i in range(self.particles):
            self.ref[i], self.margin[i] = x[i], margins[i]
        ti.loop_config(serialize=self.serial)
        for q in range(self.count):
            self.start[q + 1] = 0
            p, j = self.at(q, x), self.jello[self.points[q]]
            self.bin_of[q] = -1
            if self.in_reach(p, p, j, self.reach_of(q), hulls, met, others):
                self.bin_of[q] = self.bin_at(ti.floor(p / width, ti.i32))
                if self.reach_of(q) > widest:
                    self.bin_of[q] = self.bins  # the last one, for those that reach far
                ti.atomic_add(self.bin_start[self.bin_of[q] + 1], 1)
        ti.loop_config(serialize=True)
        for h in range(self.bins + 1):
            self.cursor[h] = self.bin_start[h]
            self.bin_start[h + 1] = self.bin_start[h + 1] + self.bin_start[h]
        ti.loop_config(serialize=self.serial)
        for q in range(self.count):
            if self.bin_of[q] >= 0:
                place = ti.atomic_add(self.cursor[self.bin_of[q]], 1)
                self.items[place], self.item_jello[place] = q, self.jello[self.points[q]]
                self.item_x[place], self.item_reach[place] = self.at(q, x), self.reach_of(q)
        ti.loop_config(serialize=self.serial, block_dim=64)
        for e in range(self.elements):
            self.is_found[e] = 0
            low, high = self.box(e, x)
            j, reach = self.owner[e], ti.cast(0.0, float)
            for k in ti.static(range(8)):
                reach = ti.max(reach, self.margin[self.nodes[e][k]])
            reach += self.radius[j]
            if self.in_reach(low, high, j, reach, hulls, met, others):
                self._look(e, low - reach, high + reach, width, widest)
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
    def in_reach(self, low, high, j, reach, hulls: ti.template(), met: ti.template(), others: ti.template()):
        """Whether something of jello j in the box from `low` to `high`, that far around, may touch another one."""
        middle, half, inside = 0.5 * (low + high), 0.5 * (high - low), False
        for k in range(met[j], met[j + 1]):
            if not inside:
                within, b = True, others[k]
                for axis in ti.static(range(AXIS_COUNT)):
                    if within:
                        u = ti.Vector(ti.static([float(a) for a in AXES[axis]]))
                        at, far = u.dot(middle), abs(u).dot(half) + ti.static(float(LENGTHS[axis])) * reach
                        within = at + far >= hulls[b, axis] and at - far <= hulls[b, axis + AXIS_COUNT]
                inside = within
        return inside

    @ti.func
    def _look(self, e, low, high, width, widest):
        """Note the points in the bins of the cells that the box from `low` to `high` meets, grown by the widest reach
        of a point, and those that reach farther; or all points, if they are fewer than the rows of cells."""
        first, last = ti.floor((low - widest) / width, ti.i32), ti.floor((high + widest) / width, ti.i32)
        n = last - first + 1
        self.note_all(self.bins, self.bins + 1, e, low, high, ti.Vector([0, 0]), 0.0)
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
            if (x[i] - self.ref[i]).norm() + dt * v[i].norm() > SPARE * self.margin[i]:
                self.state[0] = 1
