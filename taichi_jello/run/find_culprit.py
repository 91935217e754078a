"""Find what diverged: repeat the failed substeps one by one and see which spring, contact or other force grew first."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import taichi as ti

from taichi_jello.physics.forces.collider_contact.collider_penalty import PenaltyContact
from taichi_jello.physics.forces.springs.hooke import Springs
from taichi_jello.physics.forces.springs.spring_state import springs_at
from taichi_jello.scene.body import FAMILY_NAMES

if TYPE_CHECKING:
    from taichi_jello.run.simulation import Simulation

GROWTH = 100.0  # times the largest force of its kind in the last good state
MAX_STATE = 1e12  # m or m/s: beyond it a force that is not finite is a consequence, not the cause


@dataclass(frozen=True)
class Culprit:
    """What grew: a "spring", a "contact" or a "force", with its force's title; the particles it acted on, their jello,
    its magnitude [N] in the last good state and after it had grown, and `words`, all of it in a sentence."""

    what: str
    force: str
    particles: tuple[int, ...]
    jello: int
    before: float
    newtons: float
    words: str


@dataclass(frozen=True)
class Moment:
    """x, v (N, 3), the time `t` [s] since the frame began, and the magnitudes of K forces on every particle (K, N)
    [N]."""

    x: np.ndarray
    v: np.ndarray
    t: float
    forces: np.ndarray

    def largest(self, k: int) -> float:
        """[N] of force k."""
        return float(np.nan_to_num(self.forces[k], nan=0.0, posinf=np.finfo(float).max).max())


def norm(vectors: np.ndarray) -> np.ndarray:
    """Norms of (…, 3) vectors, scaled first, as their squares may overflow."""
    with np.errstate(all="ignore"):
        largest = np.maximum(np.abs(vectors).max(-1, keepdims=True), 1e-300)
        return largest[..., 0] * np.sqrt(((vectors / largest) ** 2).sum(-1))


def growth(before: float, newtons: float) -> str:
    return f"went from {before:.3g} N to {newtons:.3g} N" if newtons > 1.01 * before else f"grew to {newtons:.3g} N"


@ti.data_oriented
class Blame:
    """Compiled only after numbers went bad."""

    def __init__(self, simulation: "Simulation"):
        self.simulation, self.system, self.body = simulation, simulation.system, simulation.body
        self.forces = tuple(force for force in self.system.all_forces if hasattr(force, "on"))

    @ti.kernel
    def _fill(self, t: float, out: ti.types.ndarray()):
        for i in range(self.system.count):
            for k in ti.static(range(len(self.forces))):
                force = self.forces[k].on(i, self.system.state.x, self.system.state.v, t)
                for axis in ti.static(range(3)):
                    out[k, i, axis] = force[axis]

    def _moment(self, t: float) -> Moment:
        system = self.system
        values = np.empty((system.count, 6), system.memory.number)
        system.good.read(values)
        out = np.zeros((len(self.forces), system.count, 3), system.memory.number)
        system.probe.make_ready(t)
        self._fill(t, out)
        x, v = np.split(values.astype(float), 2, axis=1)
        return Moment(x, v, t, norm(out.astype(float)))

    def find(self, first: int, last: int) -> Culprit | None:
        """The culprit in the substeps `first` to `last` of the current frame, which begin at the last good state. The
        system is left in a later state."""
        if not self.forces:
            return None
        dt, kinds = self.simulation.dt, range(len(self.forces))
        start = last_good = self._moment(first * dt)
        grown: dict[int, Moment] = {}  # by force, the first moment when it had grown
        peak: dict[int, Moment] = {}  # and the moment when it was largest
        for step in range(first, last):
            self.system.steps(step, step + 1, dt)
            now = self._moment((step + 1) * dt)
            if not (np.isfinite(now.x).all() and np.isfinite(now.v).all()):
                break
            last_good = now
            for k in kinds:
                if now.largest(k) > GROWTH * max(start.largest(k), 1e-12):
                    grown.setdefault(k, now)
                if k not in peak or now.largest(k) > peak[k].largest(k):
                    peak[k] = now
        k = max(kinds, key=lambda k: peak.get(k, start).largest(k))
        return self._not_finite(last_good) or self._grown(k, start, grown.get(k, peak.get(k, start)))

    def _not_finite(self, last: Moment) -> Culprit | None:
        """A force that is not finite though the state is."""
        if max(np.abs(last.x).max(), np.abs(last.v).max()) > MAX_STATE:
            return None
        self.system.good.write(np.hstack([last.x, last.v]).astype(self.system.memory.number))
        for part in (0.0, 0.5, 1.0):  # of a substep
            forces = self._moment(last.t + part * self.simulation.dt).forces
            for k, force in enumerate(self.forces):
                if not np.isfinite(forces[k]).all():
                    i = int(np.flatnonzero(~np.isfinite(forces[k]))[0])
                    text = f"the {force.title} on particle {i} of jello {self.body.jello[i]} is no number"
                    return Culprit("force", force.title, (i,), int(self.body.jello[i]), np.nan, np.nan, text)
        return None

    def _grown(self, k: int, start: Moment, then: Moment) -> Culprit:
        if isinstance(self.forces[k], Springs):
            return self._spring(start, then)
        i = int(np.nan_to_num(then.forces[k], nan=0.0).argmax())
        before, newtons = float(start.forces[k, i]), float(then.forces[k, i])
        jello, title = int(self.body.jello[i]), self.forces[k].title
        what = "contact" if isinstance(self.forces[k], PenaltyContact) else "force"
        text = f"the {title} on particle {i} of jello {jello} {growth(before, newtons)}"
        return Culprit(what, title, (i,), jello, before, newtons, text)

    def _spring(self, start: Moment, then: Moment) -> Culprit:
        """The spring with the largest force."""
        simulation, (i, j) = self.simulation, self.body.springs.T
        tuning = simulation.tuning
        law = springs_at(simulation.scene, self.body, simulation.time, simulation.system.changes.memory())

        def force(moment: Moment) -> np.ndarray:
            d, w = moment.x[j] - moment.x[i], moment.v[j] - moment.v[i]
            length = np.maximum(norm(d), 1e-300)
            elastic = tuning.get("stiffness", 1.0) * law.stiffness * (length - law.rest_length)
            return np.abs(elastic + tuning.get("damping", 1.0) * law.damping * (d / length[:, None] * w).sum(1))

        with np.errstate(all="ignore"):
            before, after = force(start), np.nan_to_num(force(then), nan=0.0)
        s = int(after.argmax())
        jello, family = int(self.body.jello[i[s]]), FAMILY_NAMES[self.body.family[s]]
        text = (
            f"the {family} spring between particles {i[s]} and {j[s]} of jello {jello}, "
            f"k = {tuning.get('stiffness', 1.0) * law.stiffness[s]:.3g} N/m, {growth(before[s], after[s])}"
        )
        return Culprit("spring", "springs", (int(i[s]), int(j[s])), jello, float(before[s]), float(after[s]), text)
