"""Runs on disk: the NPZ that `jello run` writes, and states to start from."""

import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.physics.energies import ENERGIES
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.scene.body import Body

# What a state and a scene must have in common, and how nearly: their shapes, not what they are made of.
SAME = {"jello": 0.0, "springs": 0.0, "rest_length": 1e-6}
MEMORY = "memory_"  # begins the names of the arrays of a snapshot's memory


class Trajectory:
    """Moments of a run, kept in memory until `save`: time, x, v and energies of each `add`."""

    def __init__(self, simulation: Simulation):
        self.simulation = simulation
        self.moments: list[tuple[Snapshot, dict[str, float]]] = []
        self.books: list[dict[str, float]] = []  # of a simulation with a ledger

    def add(self) -> None:
        self.moments.append((self.simulation.snapshot(), self.simulation.energies()))
        if self.simulation.keeps_ledger:
            work = {f"work_{name.replace(' ', '_')}": joules for name, joules in self.simulation.work.items()}
            self.books.append(work | {"energy_residual": self.simulation.energy_residual})

    def arrays(self) -> dict[str, Any]:
        """F moments, N particles, S springs, T triangles: time (F,), x and v (F, N, 3), energy_* (F,), the body's
        arrays, dt and method; with a ledger also work_* (F,), done until then, and energy_residual (F,); and memory_*,
        what a run of springs that change needs to go on from the last moment."""
        body, simulation = self.simulation.body, self.simulation
        names = ("mass", "jello", "springs", "rest_length", "stiffness", "damping", "family", "surface")
        return (
            {
                "time": np.array([moment.time for moment, _ in self.moments]),
                "x": np.array([moment.x for moment, _ in self.moments]),
                "v": np.array([moment.v for moment, _ in self.moments]),
            }
            | {name: getattr(body, name) for name in names}
            | {f"energy_{kind}": np.array([energy[kind] for _, energy in self.moments]) for kind in ENERGIES}
            | {
                name: np.array([book.get(name, 0.0) for book in self.books])
                for book in self.books[-1:]
                for name in book
            }
            | {"dt": np.array(simulation.dt), "method": np.array(simulation.method)}
            | {f"{MEMORY}{name}": values for moment, _ in self.moments[-1:] for name, values in moment.memory.items()}
        )

    def save(self, path: Path) -> None:
        """Write all at once: a run that fails leaves no half file, and an old file stays until the new one is whole."""
        part = path.with_name(f".{path.name}.part")
        try:
            with part.open("wb") as file:
                np.savez(file, **self.arrays())
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)


def last_moment(path: Path, body: Body) -> Snapshot:
    """The last moment in an NPZ written by `jello run`, or its bare arrays x and v (N, 3), then at time 0.

    Raises ValueError saying what the file lacks or that it is of another body, OSError if it cannot be read.
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
