"""The particle fields: one vector per particle, stored axis by axis so that neighbours lie side by side."""

from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.support import runtime

LANES = 32  # particles in one block; a block's mask in the gather table is one 32-bit word
# Below this many particles one thread that never waits is as quick as several that wait for each other at every stage.
ALONE = 3000


@ti.data_oriented
@dataclass(eq=False)
class Memory:
    """Makes every Taichi field of a simulation and remembers whose it is and how many bytes it takes.

    particles: N; guard: places before the first and after the last particle that a block may read, never use.
    Fields get their first values together in `fill`: one kernel to compile instead of one for each.
    """

    particles: int
    guard: int
    owner: runtime.Runtime = field(default_factory=runtime.current)
    fields: list[tuple[str, str, int]] = field(default_factory=list)
    tables: list[tuple[Any, np.ndarray]] = field(default_factory=list)

    @property
    def padded(self) -> int:
        """Particles rounded up to whole blocks."""
        return -(-self.particles // LANES) * LANES

    @property
    def lanes(self) -> int:
        """Particles that one pass of a kernel's loop over blocks takes: a whole block on a CPU, where the inner loop
        over them becomes vector code; one on a GPU, where the threads of a warp are the block."""
        return LANES if self.owner.on_cpu else 1

    @property
    def passes(self) -> int:
        """How many passes of `lanes` particles cover all."""
        return -(-self.particles // self.lanes)

    @property
    def lane_vector(self) -> Any:
        """A kernel's local array with one number per lane; local, so that storing to it cannot disturb a field and
        LLVM vectorises the loop around it."""
        return ti.types.vector(self.lanes, ti.f32 if self.owner.precision == "f32" else ti.f64)

    @property
    def number(self) -> type[np.floating]:
        return np.float32 if self.owner.precision == "f32" else np.float64

    def vectors(self, owner: str, name: str, rows: int = 0, values: np.ndarray | None = None) -> ti.MatrixField:
        """One 3-vector per particle, zero everywhere or the (N, 3) values after `fill`; with `rows` that many for
        each, indexed [row, particle]."""
        places = self.padded + 2 * self.guard
        shape, offset = ((rows, places), (0, -self.guard)) if rows else ((places,), (-self.guard,))
        self.fields.append((owner, name, 3 * max(rows, 1) * places * np.dtype(self.number).itemsize))
        made = ti.Vector.field(3, float, shape=shape, offset=offset, layout=ti.Layout.SOA)
        if values is not None:
            self.tables.append((made, values.astype(self.number)))
        return made

    def zeros(self, owner: str, name: str, shape: tuple[int, ...], *, whole: bool = False) -> ti.Field:
        """A field of zeros: (n,) numbers or (n, k) vectors; whole ones, or floats in this precision."""
        self.fields.append((owner, name, prod(shape) * (np.int32 if whole else self.number)().itemsize))
        kind = int if whole else float
        return ti.Vector.field(shape[1], kind, shape[0]) if len(shape) == 2 else ti.field(kind, shape[0])

    def table(self, owner: str, name: str, values: np.ndarray) -> ti.Field:
        """A field for the values of a NumPy array: (n,) numbers or (n, k) vectors, floats in this precision."""
        number = np.int32 if values.dtype.kind in "iu" else self.number
        values = values.astype(number)
        made = self.zeros(owner, name, values.shape, whole=number is np.int32)
        self.tables.append((made, values))
        return made

    def numbers(self, owner: str, name: str, shape: tuple[int, ...]) -> ti.Field:
        """A field of numbers, zero everywhere."""
        self.fields.append((owner, name, int(np.prod(shape)) * np.dtype(self.number).itemsize))
        return ti.field(float, shape)

    def fill(self) -> None:
        """Write all values that fields were asked for with."""
        self.targets = tuple(made for made, _ in self.tables)
        self.shapes = tuple(values.reshape(len(values), -1).shape for _, values in self.tables)
        self.whole = tuple(values.dtype == np.int32 for _, values in self.tables)
        packed, starts = {True: [np.zeros(1, np.int32)], False: [np.zeros(1, self.number)]}, []
        for (_, values), whole in zip(self.tables, self.whole, strict=True):
            starts.append(sum(map(len, packed[whole])))
            packed[whole].append(values.ravel())
        self.starts = tuple(starts)
        longest = max((rows for rows, _ in self.shapes), default=0)
        self._fill(np.concatenate(packed[True]), np.concatenate(packed[False]), longest)
        self.tables.clear()

    @ti.kernel
    def _fill(self, ints: ti.types.ndarray(), floats: ti.types.ndarray(), longest: int):
        for i in range(longest):
            for k in ti.static(range(len(self.targets))):
                if i < self.shapes[k][0]:
                    width = ti.static(self.shapes[k][1])
                    for column in ti.static(range(width)):
                        place = self.starts[k] + i * width + column
                        if ti.static(width == 1 and self.whole[k]):
                            self.targets[k][i] = ints[place]
                        elif ti.static(width == 1):
                            self.targets[k][i] = floats[place]
                        elif ti.static(self.whole[k]):
                            self.targets[k][i][column] = ints[place]
                        else:
                            self.targets[k][i][column] = floats[place]


@ti.data_oriented
@dataclass(frozen=True)
class State:
    """Position x [m] and velocity v [m/s] of every particle, as fields of (N,) 3-vectors."""

    x: ti.MatrixField
    v: ti.MatrixField

    @classmethod
    def made_in(cls, memory: Memory, owner: str, x: np.ndarray | None = None, v: np.ndarray | None = None) -> "State":
        return cls(memory.vectors(owner, "x", values=x), memory.vectors(owner, "v", values=v))
