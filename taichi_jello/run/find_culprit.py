"""After numbers went bad: the frame once more, step by step, to see which spring, contact or other force grew first."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.collider_contact.collider_penalty import PenaltyContact
from taichi_jello.physics.forces.springs.hooke import Springs
from taichi_jello.physics.forces.springs.spring_state import springs_at
from taichi_jello.scene.body import FAMILY_NAMES

GROWN = 100.0  # times the greatest force of its kind in the last good state: then something is growing
FAR = 1e12  # m or m/s: beyond it a force that is no number is only what comes of a state like that


@dataclass(frozen=True)
class Culprit:
    """What grew: a "spring", a "contact" or a "force", with its force's title; the particles at its ends or the one it
    acted on, their jello, and its force [N] in the last good state and when it had grown. `told` says it in words."""

    what: str
    force: str
    particles: tuple[int, ...]
    jello: int
    before: float
    newtons: float
    told: str


@dataclass(frozen=True)
class Moment:
    """x, v (N, 3), the time `t` [s] since the frame began, and the norm of each force on every particle (K, N) [N]."""

    x: np.ndarray
    v: np.ndarray
    t: float
    forces: np.ndarray


def norm(vectors: np.ndarray) -> np.ndarray:
    """Of (…, 3) vectors, however large: their squares may be too large for a number."""
    with np.errstate(all="ignore"):
        largest = np.maximum(np.abs(vectors).max(-1, keepdims=True), 1e-300)
        return largest[..., 0] * np.sqrt(((vectors / largest) ** 2).sum(-1))


def went(before: float, newtons: float) -> str:
    return (
        f"went from {before:.3g} N to {newtons:.3g} N" if newtons > 1.01 * before else f"had grown to {newtons:.3g} N"
    )


def greatest(forces: np.ndarray) -> float:
    return float(np.nan_to_num(forces, nan=0.0, posinf=np.finfo(float).max).max())


@ti.data_oriented
class Blame:
    """Compiled only when numbers have gone bad."""

    def __init__(self, simulation: Any):
        self.simulation, self.system, self.body = simulation, simulation.system, simulation.body
        self.forces = tuple(force for force in self.system.all_forces if hasattr(force, "on"))

    @ti.kernel
    def _fill(self, t: float, out: ti.types.ndarray()):
        for i in range(self.system.count):
            for k in ti.static(range(len(self.forces))):
                force = self.forces[k].on(i, self.system.state.x, self.system.state.v, t)
                for axis in ti.static(range(3)):
                    out[k, i, axis] = force[axis]

    def _look(self, t: float) -> Moment:
        system = self.system
        values = np.empty((system.count, 6), system.memory.number)
        system.good.read(values)
        out = np.zeros((len(self.forces), system.count, 3), system.memory.number)
        system.probe.make_ready(t)
        self._fill(t, out)
        x, v = values[:, :3].astype(float), values[:, 3:].astype(float)
        return Moment(x, v, t, norm(out.astype(float)))

    def find(self, first: int, last: int) -> Culprit | None:
        """The culprit in the substeps `first` to `last` of the current frame, which begin at the last good state.
        Leaves the system anywhere."""
        if not self.forces:
            return None
        dt = self.simulation.dt
        start = last_good = self._look(first * dt)
        grown: dict[int, Moment] = {}  # of each force, the first moment when it had grown
        most: dict[int, tuple[float, Moment]] = {}  # and the one when it was greatest
        for step in range(first, last):
            self.system.steps(step, step + 1, dt)
            now = self._look((step + 1) * dt)
            if not (np.isfinite(now.x).all() and np.isfinite(now.v).all()):
                break
            last_good = now
            for k in range(len(self.forces)):
                size = greatest(now.forces[k])
                if size > GROWN * max(greatest(start.forces[k]), 1e-12):
                    grown.setdefault(k, now)
                if k not in most or size > most[k][0]:
                    most[k] = size, now
        if not most:
            most = {k: (greatest(start.forces[k]), start) for k in range(len(self.forces))}
        k = max(most, key=lambda k: most[k][0])
        return self._no_number(last_good) or self._grown(k, start, grown.get(k, most[k][1]))

    def _no_number(self, last: Moment) -> Culprit | None:
        """A force that was no number though the state was."""
        if max(np.abs(last.x).max(), np.abs(last.v).max()) > FAR:
            return None
        self.system.good.write(np.hstack([last.x, last.v]).astype(self.system.memory.number))
        for late in (0.0, 0.5, 1.0):
            forces = self._look(last.t + late * self.simulation.dt).forces
            for k, force in enumerate(self.forces):
                if not np.isfinite(forces[k]).all():
                    i = int(np.flatnonzero(~np.isfinite(forces[k]))[0])
                    told = f"the {force.title} on particle {i} of jello {self.body.jello[i]} is no number"
                    return Culprit("force", force.title, (i,), int(self.body.jello[i]), np.nan, np.nan, told)
        return None

    def _grown(self, k: int, start: Moment, then: Moment) -> Culprit:
        if isinstance(self.forces[k], Springs):
            return self._spring(start, then)
        i = int(np.nan_to_num(then.forces[k], nan=0.0).argmax())
        before, newtons = start.forces[k, i], then.forces[k, i]
        jello, title = int(self.body.jello[i]), self.forces[k].title
        what = "contact" if isinstance(self.forces[k], PenaltyContact) else "force"
        told = f"the {title} on particle {i} of jello {jello} {went(before, newtons)}"
        return Culprit(what, title, (i,), jello, float(before), float(newtons), told)

    def _spring(self, start: Moment, then: Moment) -> Culprit:
        """The spring that pulls or pushes hardest."""
        simulation, (i, j) = self.simulation, self.body.springs.T
        tuning = simulation.tuning
        law = springs_at(simulation.scene, self.body, simulation.time, simulation.system.changes.memory())

        def load(moment: Moment) -> np.ndarray:
            d, w = moment.x[j] - moment.x[i], moment.v[j] - moment.v[i]
            length = np.maximum(norm(d), 1e-300)
            elastic = tuning.get("stiffness", 1.0) * law.stiffness * (length - law.rest_length)
            return np.abs(elastic + tuning.get("damping", 1.0) * law.damping * (d / length[:, None] * w).sum(1))

        with np.errstate(all="ignore"):
            before, after = load(start), np.nan_to_num(load(then), nan=0.0)
        s = int(after.argmax())
        jello, family = int(self.body.jello[i[s]]), FAMILY_NAMES[self.body.family[s]]
        stiffness = tuning.get("stiffness", 1.0) * law.stiffness[s]
        told = (
            f"the {family} spring between particles {i[s]} and {j[s]} of jello {jello}, k = {stiffness:.3g} N/m, "
            f"{went(before[s], after[s])}"
        )
        return Culprit("spring", "springs", (int(i[s]), int(j[s])), jello, float(before[s]), float(after[s]), told)
