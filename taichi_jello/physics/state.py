"""The particle fields: one vector per particle, stored axis by axis so that neighbours lie side by side."""

from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.support import runtime

LANES = 32  # particles in one block; a block's mask in the gather table is one 32-bit word
SERIAL_BELOW = 3000  # particles; then one thread is as quick as several, which wait for each other at every stage


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
        """Particles in one pass of a kernel's loop over blocks: a whole block on a CPU, where the inner loop over them
        becomes vector code; one on a GPU, where the threads of a warp are the block."""
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
        self._note(owner, name, 3 * prod(shape), self.number)
        made = ti.Vector.field(3, float, shape=shape, offset=offset, layout=ti.Layout.SOA)
        if values is not None:
            self.tables.append((made, values.astype(self.number)))
        return made

    def zeros(self, owner: str, name: str, shape: tuple[int, ...], *, whole: bool = False) -> ti.Field:
        """A field of zeros: (n,) numbers or (n, k) vectors; whole ones, or floats in this precision."""
        self._note(owner, name, prod(shape), np.int32 if whole else self.number)
        kind = int if whole else float
        return ti.Vector.field(shape[1], kind, shape[0]) if len(shape) == 2 else ti.field(kind, shape[0])

    def table(self, owner: str, name: str, values: np.ndarray) -> ti.Field:
        """A field for the values of a NumPy array: (n,) numbers or (n, k) vectors, floats in this precision."""
        whole = values.dtype.kind in "iu"
        made = self.zeros(owner, name, values.shape, whole=whole)
        self.tables.append((made, values.astype(np.int32 if whole else self.number)))
        return made

    def numbers(self, owner: str, name: str, shape: tuple[int, ...]) -> ti.Field:
        """A field of numbers, zero everywhere."""
        self._note(owner, name, prod(shape), self.number)
        return ti.field(float, shape)

    def _note(self, owner: str, name: str, count: int, number: type[np.generic]) -> None:
        self.fields.append((owner, name, int(count) * np.dtype(number).itemsize))

    def fill(self) -> None:
        """Write the first values of all fields."""
        self.targets = tuple(made for made, _ in self.tables)
        self.shapes = tuple(values.reshape(len(values), -1).shape for _, values in self.tables)
        self.whole = tuple(values.dtype == np.int32 for _, values in self.tables)
        packed: dict[bool, list[np.ndarray]] = {True: [np.zeros(1, np.int32)], False: [np.zeros(1, self.number)]}
        starts = []
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
                    values, width = ti.static(ints if self.whole[k] else floats, self.shapes[k][1])
                    for column in ti.static(range(width)):
                        value = values[self.starts[k] + i * width + column]
                        if ti.static(width == 1):
                            self.targets[k][i] = value
                        else:
                            self.targets[k][i][column] = value


@ti.data_oriented
@dataclass(frozen=True)
class State:
    """Position x [m] and velocity v [m/s] of every particle, as fields of (N,) 3-vectors."""

    x: ti.MatrixField
    v: ti.MatrixField

    @classmethod
    def made_in(cls, memory: Memory, owner: str, x: np.ndarray | None = None, v: np.ndarray | None = None) -> "State":
        return cls(memory.vectors(owner, "x", values=x), memory.vectors(owner, "v", values=v))
