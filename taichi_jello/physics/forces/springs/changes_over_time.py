"""Springs and gravity that change with time, once a frame, at its beginning."""

from typing import Any

import numpy as np

from taichi_jello.physics.forces.springs.spring_state import SpringState, by_jello, lengths, springs_at
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.scene.keyframes import SLACK, factor, gravity


class SpringChange:
    """Keyframes of stiffness, damping and rest lengths, freezing, tearing, yield and creep, in this order.

    `memory`: what a run needs to go on from a moment, arrays that are replaced, never written to; `work` [J]: the
    energy put into the system until now, by cause."""

    def __init__(self, scene: Scene, body: Body, springs: Any, others: list[Any]):
        self.scene, self.body, self.springs, self.others = scene, body, springs, others
        self.creep = by_jello(scene, body, [jello.creep for jello in scene.jello])
        self.yield_strain = by_jello(scene, body, [jello.yield_strain for jello in scene.jello])
        self.tear_strain = by_jello(scene, body, [jello.tear_strain for jello in scene.jello])
        self.freezes = any(row.freeze for jello in scene.jello for row in jello.keyframe)
        used = {
            "keyframes": any(jello.keyframe for jello in scene.jello),
            "tearing": self.tear_strain.any(),
            "yield": self.yield_strain.any(),
            "creep": self.creep.any(),
        }
        self.work = {name: 0.0 for name in used if used[name]}
        self.memory = self.fresh()
        self.state = springs_at(scene, body, 0.0, self.memory)
        self.written = SpringState(body.stiffness, body.rest_length, body.damping)

    def fresh(self) -> dict[str, np.ndarray]:
        """The memory at the beginning of a run."""
        memory = {}
        if any(jello.takes_its_own_shape for jello in self.scene.jello):
            memory["rest_length"] = self.body.rest_length
        if self.freezes:
            memory["frozen"] = np.zeros(len(self.scene.jello), int)
        if self.tear_strain.any():
            memory["whole"] = np.ones(len(self.body.springs), bool)
        if self.freezes and self.tear_strain.any():
            memory["made"] = self.body.rest_length
        return memory

    def begin(self, time: float, passed: float, x: np.ndarray) -> None:
        """Change what changes at `time` [s], `passed` [s] after the last call, with the particles at x (N, 3) [m]."""
        self._update("keyframes", time, x)
        length = lengths(self.body, x)
        if self.freezes:
            self._freeze(time, x, length)
        if "tearing" in self.work:
            self._tear(time, x, length)
        if "yield" in self.work:
            rest = self.state.rest_length
            limit = np.where(self.yield_strain > 0.0, self.yield_strain, np.inf)
            longest = np.divide(length, 1.0 - limit, out=np.full_like(length, np.inf), where=limit < 1.0)
            self._lengthen(np.clip(rest, length / (1.0 + limit), longest) - rest, time)
            self._update("yield", time, x)
        if "creep" in self.work:  # a Maxwell fluid, dR/dt = creep (L - R)
            self._lengthen((length - self.state.rest_length) * -np.expm1(-self.creep * passed), time)
            self._update("creep", time, x)
        self._write()

    def recall(self, time: float) -> None:
        """Restore the springs at `time` [s] with the memory as it is."""
        self.state = springs_at(self.scene, self.body, time, self.memory)
        self._write()

    def _freeze(self, time: float, x: np.ndarray, length: np.ndarray) -> None:
        """At a keyframe that freezes, the springs of a jello take their length for their rest length."""
        passed = [sum(row.freeze and row.time <= time + SLACK for row in jello.keyframe) for jello in self.scene.jello]
        frozen = by_jello(self.scene, self.body, (np.array(passed) > self.memory["frozen"]).tolist()) > 0.0
        self.memory["frozen"] = np.array(passed)
        if frozen.any():
            for name in {"rest_length", "made"} & self.memory.keys():
                self.memory[name] = np.where(frozen, length / self._rest_factor(time), self.memory[name])
            self._update("keyframes", time, x)

    def _rest_factor(self, time: float) -> np.ndarray:
        """(S,) The keyframes' factor of the rest lengths, or 1 where it is zero."""
        scale = by_jello(self.scene, self.body, [factor(j.keyframe, "rest_length", time) for j in self.scene.jello])
        return np.where(scale > 0.0, scale, 1.0)

    def _tear(self, time: float, x: np.ndarray, length: np.ndarray) -> None:
        """Tear springs by their strain since they were made or frozen; yielding does not lessen it."""
        made = self.memory.get("made", self.body.rest_length) * self._rest_factor(time)
        too_long = (self.tear_strain > 0.0) & (length > (1.0 + self.tear_strain) * made)
        if (too_long & self.memory["whole"]).any():
            self.memory["whole"] = self.memory["whole"] & ~too_long
            self._update("tearing", time, x)

    def _lengthen(self, by: np.ndarray, time: float) -> None:
        """Lengthen the rest lengths by (S,) [m], as long as they are now; none falls below zero."""
        if by.any():
            self.memory["rest_length"] = np.maximum(self.memory["rest_length"] + by / self._rest_factor(time), 0.0)

    def _update(self, cause: str, time: float, x: np.ndarray) -> None:
        """Bring the state up to date with the memory. The work is the difference of the elastic energies."""
        before, self.state = self.state, springs_at(self.scene, self.body, time, self.memory)
        if not before.equals(self.state):
            change = self.state.energy(self.body, x) - before.energy(self.body, x)
            work = self.springs.scales["stiffness"] * float(change.sum())
            self.work = self.work | {cause: self.work.get(cause, 0.0) + work}

    def _write(self) -> None:
        if not self.written.equals(self.state):
            self.springs.set_state(self.state)
            for force in self.others:
                force.set_state(self.state)
            self.written = self.state


class GravityChange:
    """Keyframes of gravity. A frame takes the value at its middle: the midpoint rule. The energy -m g·x changes with
    g: that much work is put in."""

    def __init__(self, scene: Scene, body: Body, force: Any):
        self.scene, self.body, self.force = scene, body, force
        self.memory: dict[str, np.ndarray] = {}
        self.work = {"keyframes": 0.0}

    def fresh(self) -> dict[str, np.ndarray]:
        return {}

    def begin(self, time: float, passed: float, x: np.ndarray) -> None:
        before = np.array(self.force.acceleration)
        self.recall(time)
        change = np.array(self.force.acceleration) - before
        self.work = {"keyframes": self.work["keyframes"] - float(change @ (self.body.mass @ x.astype(float)))}

    def recall(self, time: float) -> None:
        now = tuple(gravity(self.scene.keyframe, time + 0.5 * self.scene.solver.frame_dt))
        if now != self.force.acceleration:
            self.force.set(now)


def options(scene: Scene) -> dict[str, bool]:
    """What can change with time, and whether it does in the scene."""
    jellos = scene.jello
    return {
        "keyframes of jellos": any(jello.keyframe for jello in jellos),
        "keyframes of gravity": bool(scene.keyframe),
        "handles": any(pin.keyframe for jello in jellos for pin in jello.pin),
        "tearing": any(jello.tear_strain for jello in jellos),
        "yield": any(jello.yield_strain for jello in jellos),
        "creep": any(jello.creep for jello in jellos),
    }


class Changes:
    """All changes of a scene, made once for each frame: a run that goes on within a frame does not repeat them."""

    def __init__(self, scene: Scene, body: Body, forces: list[Any]):
        named = {force.title: force for force in forces}
        self.present = [title for title, used in options(scene).items() if used]
        self.absent = [title for title, used in options(scene).items() if not used]
        self.all: list[SpringChange | GravityChange] = []
        if "springs" in named and any(jello.changes for jello in scene.jello):
            self.all.append(
                SpringChange(scene, body, named["springs"], [force for force in forces if force.title != "springs"])
            )
        if scene.keyframe:
            self.all.append(GravityChange(scene, body, named["gravity"]))
        self.begun: float | None = None

    def begin(self, time: float, x: np.ndarray) -> None:
        if not self.all or (self.begun is not None and abs(time - self.begun) <= SLACK):
            return
        passed = 0.0 if self.begun is None else max(time - self.begun, 0.0)
        for change in self.all:
            if self.begun is None:
                change.recall(time)
            change.begin(time, passed, x)
        self.begun = time

    @property
    def work(self) -> dict[str, float]:
        """Energy [J] put into the system by changes until now (negative: taken out), by cause."""
        names = {name: None for change in self.all for name in change.work}
        return {name: sum(change.work.get(name, 0.0) for change in self.all) for name in names}

    def memory(self) -> dict[str, np.ndarray]:
        """What a run needs besides x and v to go on to the same bits; empty before the first frame."""
        if self.begun is None:
            return {}
        packed = {"begun": np.array(self.begun)}
        for index, change in enumerate(self.all):
            packed |= change.memory | {f"work.{index}.{name}": np.array(value) for name, value in change.work.items()}
        return packed

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Restore the moment of `memory`; an empty one is the beginning."""
        if not self.all:
            return
        self.begun = float(memory["begun"]) if "begun" in memory else None
        for index, change in enumerate(self.all):
            change.memory = {name: memory.get(name, fresh) for name, fresh in change.fresh().items()}
            change.work = {name: float(memory.get(f"work.{index}.{name}", 0.0)) for name in change.work}
            change.recall(0.0 if self.begun is None else self.begun)
