"""The NPZ files that `jello run` writes, and states to start from."""

import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.body import Body

# The arrays that a state must share with a scene, and the tolerance: its shape, not its material.
SAME = {"jello": 0.0, "springs": 0.0, "rest_length": 1e-6}
BODY = ("mass", "jello", "springs", "rest_length", "stiffness", "damping", "family", "surface")
MEMORY = "memory_"  # prefix of the arrays of a snapshot's memory


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


def last_moment(path: Path, body: Body) -> Snapshot:
    """The last moment in an NPZ written by `jello run`, or bare arrays x and v (N, 3) at time 0.

    Raises ValueError for a file of another kind or another body, OSError if it cannot be read.
    """
    with path.open("rb") as file:
        if not zipfile.is_zipfile(file):
            raise ValueError("expected an NPZ file")
    try:
        with np.load(path, allow_pickle=False) as arrays:
            missing = [name for name in ("x", "v") if name not in arrays]
            if missing:
                raise ValueError(f"expected arrays x and v, {' and '.join(missing)} missing")
            x, v = arrays["x"], arrays["v"]
            for name, close in SAME.items():
                own = getattr(body, name)
                if name in arrays and (arrays[name].shape != own.shape or not np.allclose(arrays[name], own, close)):
                    raise ValueError(f"{name}: expected a state of this scene, it is of another one")
            memory = {name.removeprefix(MEMORY): arrays[name] for name in arrays if name.startswith(MEMORY)}
            jellos = int(body.jello.max()) + 1
            shapes = ((), (len(body.springs),), (jellos,), (jellos, 6), body.x.shape)
            if any(values.shape not in shapes for values in memory.values()):
                raise ValueError("memory: expected a state of this scene, it is of another one")
            time = float(arrays["time"].ravel()[-1]) if "time" in arrays and arrays["time"].size else 0.0
    except (zipfile.BadZipFile, EOFError):
        raise ValueError("expected a whole NPZ file, this one is damaged") from None
    if x.ndim == 3 and v.ndim == 3 and len(x) and len(v):
        x, v = x[-1], v[-1]
    return Snapshot(time, x, v, memory)
