"""The particle fields: one vector per particle, stored axis by axis so that neighbours lie side by side."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello import runtime

LANES = 32  # particles in one block; a block's mask in the gather table is one 32-bit word


@dataclass
class Memory:
    """Makes every Taichi field of a simulation and remembers whose it is and how many bytes it takes.

    particles: N; guard: places before the first and after the last particle that a block may read, never use.
    """

    particles: int
    guard: int
    owner: runtime.Runtime = field(default_factory=runtime.current)
    fields: list[tuple[str, str, int]] = field(default_factory=list)

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

    def vectors(self, owner: str, name: str, rows: int = 0) -> ti.MatrixField:
        """One 3-vector per particle, zero everywhere; with `rows` that many for each, indexed [row, particle]."""
        places = self.padded + 2 * self.guard
        shape, offset = ((rows, places), (0, -self.guard)) if rows else ((places,), (-self.guard,))
        self.fields.append((owner, name, 3 * max(rows, 1) * places * np.dtype(self.number).itemsize))
        return ti.Vector.field(3, float, shape=shape, offset=offset, layout=ti.Layout.SOA)

    def table(self, owner: str, name: str, values: np.ndarray) -> ti.Field:
        """A field with the values of a NumPy array: (n,) numbers or (n, k) vectors, floats in this precision."""
        kind = int if values.dtype.kind in "iu" else float
        values = values.astype(np.int32 if kind is int else self.number)
        self.fields.append((owner, name, values.nbytes))
        if values.ndim == 1:
            made = ti.field(kind, shape=len(values))
        else:
            made = ti.Vector.field(values.shape[1], kind, shape=len(values))
        made.from_numpy(values)
        return made

    def write(self, target: ti.MatrixField, values: np.ndarray) -> None:
        """Put (N, 3) values into a field made by `vectors`."""
        places = np.zeros((self.padded + 2 * self.guard, 3), self.number)
        places[self.guard : self.guard + self.particles] = values
        target.from_numpy(places)

    def read(self, source: ti.MatrixField) -> np.ndarray:
        """(N, 3) values of a field made by `vectors`."""
        return source.to_numpy()[self.guard : self.guard + self.particles]


@ti.data_oriented
@dataclass(frozen=True)
class State:
    """Position x [m] and velocity v [m/s] of every particle, as fields of (N,) 3-vectors."""

    x: ti.MatrixField
    v: ti.MatrixField

    @classmethod
    def made_in(cls, memory: Memory, owner: str) -> "State":
        return cls(memory.vectors(owner, "x"), memory.vectors(owner, "v"))
