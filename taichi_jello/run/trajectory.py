"""The NPZ files that `jello run` writes, and states to start from."""

import contextlib
import os
import zipfile
from collections.abc import Iterator, Sequence
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.body import Body
from taichi_jello.scene.validation import cut

# The arrays that a state must share with a scene, and the tolerance: its shape, not its material.
SAME = {"jello": 0.0, "springs": 0.0, "rest_length": 1e-6}
BODY = ("mass", "jello", "springs", "rest_length", "stiffness", "damping", "family", "surface")
MEMORY = "memory_"  # prefix of the arrays of a snapshot's memory
ANOTHER = "expected a state of this scene, it is of another one"
ANY = -1  # number of moments in a shape
SOME, MAX_ROWS = -2, 10**7  # points that friction holds; no more than that
HELD = " held "  # in the names of what friction keeps
MAX_TIME = 1e9  # [s] beyond, float64 resolves a frame no longer well


class Trajectory:
    """Time, x, v and energies at each `add` of a run, kept in memory until `save`."""

    def __init__(self, simulation: Simulation):
        self.simulation = simulation
        self.moments: list[Snapshot] = []
        self.books: list[dict[str, float]] = []  # energies, work and residual

    def add(self) -> None:
        simulation = self.simulation
        self.moments.append(simulation.snapshot())
        book = {f"energy_{kind}": joules for kind, joules in simulation.energies().items()}
        if simulation.keeps_ledger:
            book |= {f"work_{name.replace(' ', '_')}": joules for name, joules in simulation.work.items()}
            book |= {"energy_residual": simulation.energy_residual}
        self.books.append(book)

    def arrays(self) -> dict[str, Any]:
        """F moments, N particles, S springs, T triangles: time (F,), x and v (F, N, 3), energy_* (F,), the body's
        arrays, dt and method; with a ledger also work_* until then and energy_residual (F,); and memory_*, needed to
        continue from the last moment."""
        arrays = {name: np.array([getattr(moment, name) for moment in self.moments]) for name in ("time", "x", "v")}
        arrays |= {name: getattr(self.simulation.body, name) for name in BODY}
        for name in self.books[-1]:
            arrays[name] = np.array([book.get(name, 0.0) for book in self.books])
        arrays |= {"dt": np.array(self.simulation.dt), "method": np.array(self.simulation.method)}
        return arrays | {f"{MEMORY}{name}": values for name, values in self.moments[-1].memory.items()}

    def save(self, path: Path) -> None:
        """Write the file as a whole: a failure leaves an old file as it was."""
        part = path.with_name(f".{path.name}.part")
        try:
            with part.open("wb") as file:
                np.savez(file, **self.arrays())
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)


class StateError(ValueError):
    """A file without a state of the scene: the array and what was expected."""


def last_moment(path: Path, body: Body) -> Snapshot:
    """The last moment in an NPZ written by `jello run`, or bare arrays x and v (N, 3) at time 0.

    Raises StateError for a file of another kind or another body, OSError if it cannot be read.
    """
    if path.exists() and not path.is_file():
        raise StateError("expected a regular file")
    count, jellos = len(body.x), int(body.jello.max()) + 1
    with path.open("rb") as file:
        with damage_named("expected an NPZ file, it is of another kind or damaged"):
            archive = zipfile.ZipFile(file)
        names = {name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")}
        missing = [name for name in ("x", "v") if name not in names]
        if missing:
            raise StateError(f"expected arrays x and v, {' and '.join(missing)} missing")
        for name, close in SAME.items():
            own = getattr(body, name)
            if name in names and not np.allclose(last_row(archive, name, [own.shape]), own, close):
                raise StateError(f"{name}: {ANOTHER}")
        x, v = (last_row(archive, name, [(count, 3), (ANY, count, 3)]) for name in ("x", "v"))
        shapes = ((), (len(body.springs),), (jellos,), (jellos, 6), body.x.shape)
        kept = sorted(name for name in names if name.startswith(MEMORY))
        memory = {
            name.removeprefix(MEMORY): last_row(archive, name, ((SOME,), (SOME, 3)) if HELD in name else shapes)
            for name in kept
        }
        time = float(last_row(archive, "time", [(), (ANY,)])) if "time" in names else 0.0
    if not 0.0 <= time <= MAX_TIME:
        raise StateError(f"time: expected 0 to {MAX_TIME:g} s, got {time:g}")
    bad = [name for name, values in memory.items() if not np.isfinite(values).all()]
    if bad:
        raise StateError(f"{MEMORY}{cut(bad[0])}: expected finite numbers")
    return Snapshot(time, x, v, memory)


@contextlib.contextmanager
def damage_named(problem: str) -> Iterator[None]:
    """Turn whatever a reader raises into a StateError."""
    try:
        yield
    except StateError:
        raise
    except Exception:  # of zlib, lzma, zipfile, NumPy and its parser of headers
        raise StateError(problem) from None


def last_row(archive: zipfile.ZipFile, name: str, shapes: Sequence[tuple[int, ...]]) -> np.ndarray:
    """An array of one of these shapes; only the last row of one whose shape begins with ANY. SOME: up to MAX_ROWS.

    What its header says is checked before memory is allocated. Raises StateError naming the array."""
    label = cut(name)
    with damage_named(f"{label}: expected an array as numpy.savez writes it, it is damaged or encrypted"):
        entry = archive.getinfo(f"{name}.npy")
        with archive.open(entry) as file:
            version = np.lib.format.read_magic(file)
            headers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
            shape, by_columns, kind = headers[version](file)
            fits = [own for own in shapes if shape == own or (own[:1] == (ANY,) != shape[:1] and shape[1:] == own[1:])]
            if (SOME, *shape[1:]) in shapes and shape[:1] <= (MAX_ROWS,):
                fits.append(shape)
            size = prod(shape) * kind.itemsize
            if kind.kind not in "biuf":
                raise StateError(f"{label}: expected numbers, got {cut(str(kind))}")
            if not fits or not size:
                raise StateError(f"{label}: {ANOTHER}, its shape is {cut(str(shape))}")
            if size != entry.file_size - file.tell():
                raise StateError(f"{label}: expected {size} bytes as its header says, got {entry.file_size}")
            many = fits[0][:1] == (ANY,)
            if many and by_columns and len(shape) > 1:
                raise StateError(f"{label}: expected an array in C order, got one in Fortran order")
            row = size // shape[0] if many else size
            file.seek(size - row, os.SEEK_CUR)
            values = np.frombuffer(file.read(row), kind)
            return values.reshape(shape[1:] if many else shape, order="F" if by_columns else "C").copy()
