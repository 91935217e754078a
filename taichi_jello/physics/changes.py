"""What changes while time goes on: springs and gravity, looked at once a frame, at its beginning."""

from typing import Any

import numpy as np

from taichi_jello.body import Body
from taichi_jello.keyframes import factor, gravity
from taichi_jello.law import Law, law_at, lengths
from taichi_jello.scene import Scene

SLACK = 1e-9  # s by which a frame may begin before a keyframe and still be meant by it: rounding of the clock


class Change:
    """One thing that changes. `title` is what a scene that has none leaves out; `memory` what it must remember to go
    on from a moment, arrays that are replaced and never written to; `work` [J], put into the system until now, by
    what for."""

    title: str
    memory: dict[str, np.ndarray]
    work: dict[str, float]

    def begin(self, time: float, x: np.ndarray) -> None:
        """Make everything as it is from `time` [s] on, with the particles at x (N, 3) [m]."""

    def recall(self, time: float) -> None:
        """Make everything as it was at `time`, with the memory as it is now."""


class SpringChange(Change):
    """Keyframes of stiffness, damping and rest lengths; freezing."""

    title = "keyframes of jellos"

    def __init__(self, scene: Scene, body: Body, springs: Any):
        self.scene, self.body, self.springs = scene, body, springs
        self.work = {"keyframes": 0.0}
        self.memory = self.fresh()
        self.law = law_at(scene, body, 0.0, self.memory)
        self.obeyed: Law = Law(body.stiffness, body.rest_length, body.damping)

    @classmethod
    def made_for(cls, scene: Scene, body: Body, forces: dict[str, Any]) -> list["SpringChange"]:
        wanted = any(jello.changes for jello in scene.jello)
        return [cls(scene, body, forces["springs"])] if wanted and "springs" in forces else []

    def fresh(self) -> dict[str, np.ndarray]:
        """The memory of a beginning."""
        memory = {}
        if any(jello.takes_its_own_shape for jello in self.scene.jello):
            memory["rest_length"] = self.body.rest_length
        if any(row.freeze for jello in self.scene.jello for row in jello.keyframe):
            memory["frozen"] = np.zeros(len(self.scene.jello), int)
        return memory

    def begin(self, time: float, x: np.ndarray) -> None:
        before = self.law
        self.law = law_at(self.scene, self.body, time, self.memory)
        self._book("keyframes", before, x)
        if "frozen" in self.memory:
            self._freeze(time, x)
        self._tell()

    def recall(self, time: float) -> None:
        self.law = law_at(self.scene, self.body, time, self.memory)
        self._tell()

    def _freeze(self, time: float, x: np.ndarray) -> None:
        """Springs of a jello that passes a keyframe which freezes take their length for their rest length."""
        passed = [sum(row.freeze and row.time <= time + SLACK for row in jello.keyframe) for jello in self.scene.jello]
        for jello in np.flatnonzero(passed > self.memory["frozen"]).tolist():
            own = self.body.jello[self.body.springs[:, 0]] == jello
            scale = factor(self.scene.jello[jello].keyframe, "rest_length", time)
            shape = lengths(self.body, x) / (scale if scale > 0.0 else 1.0)
            self.memory["rest_length"] = np.where(own, shape, self.memory["rest_length"])
        self.memory["frozen"] = np.array(passed)
        self._change("keyframes", time, x)

    def _change(self, name: str, time: float, x: np.ndarray) -> None:
        before, self.law = self.law, law_at(self.scene, self.body, time, self.memory)
        self._book(name, before, x)

    def _book(self, name: str, before: Law, x: np.ndarray) -> None:
        """Changing the springs under load puts energy in or takes it out: the difference of what they hold."""
        if not _same(before, self.law):
            scale = self.springs.scales["stiffness"]
            change = self.law.energy(self.body, x) - before.energy(self.body, x)
            self.work = self.work | {name: self.work[name] + scale * float(change.sum())}

    def _tell(self) -> None:
        if not _same(self.obeyed, self.law):
            self.springs.obey(self.law)
            self.obeyed = self.law


def _same(a: Law, b: Law) -> bool:
    pairs = ((a.stiffness, b.stiffness), (a.rest_length, b.rest_length), (a.damping, b.damping))
    return all(p is q or np.array_equal(p, q) for p, q in pairs)


class GravityChange(Change):
    """Keyframes of gravity. Its energy -m g·x changes with g: that much work is put in."""

    title = "keyframes of gravity"

    def __init__(self, scene: Scene, body: Body, force: Any):
        self.scene, self.body, self.force = scene, body, force
        self.memory, self.work = {}, {"keyframes": 0.0}

    @classmethod
    def made_for(cls, scene: Scene, body: Body, forces: dict[str, Any]) -> list["GravityChange"]:
        return [cls(scene, body, forces["gravity"])] if scene.keyframe else []

    def fresh(self) -> dict[str, np.ndarray]:
        return {}

    def begin(self, time: float, x: np.ndarray) -> None:
        before = np.array(self.force.acceleration)
        self.recall(time)
        change = np.array(self.force.acceleration) - before
        self.work = {"keyframes": self.work["keyframes"] - float(change @ (self.body.mass @ x.astype(float)))}

    def recall(self, time: float) -> None:
        now = tuple(gravity(self.scene.keyframe, time))
        if now != self.force.acceleration:
            self.force.set(now)


KINDS = (SpringChange, GravityChange)


class Changes:
    """All changes of a scene, made once for each frame that begins: what one frame has been told, a run that goes on
    within that frame is not told again."""

    def __init__(self, scene: Scene, body: Body, forces: list[Any]):
        named = {force.title: force for force in forces}
        made = {kind.title: kind.made_for(scene, body, named) for kind in KINDS}
        self.absent = [title for title, found in made.items() if not found]
        self.all = [change for found in made.values() for change in found]
        self.begun: float | None = None

    def begin(self, time: float, x: np.ndarray) -> None:
        if not self.all or (self.begun is not None and abs(time - self.begun) <= SLACK):
            return
        if self.begun is None:
            self._recall(time)
        for change in self.all:
            change.begin(time, x)
        self.begun = time

    @property
    def work(self) -> dict[str, float]:
        """Energy [J] put into the system until now by changes, by what for; negative: taken out."""
        total: dict[str, float] = {}
        for change in self.all:
            for name, value in change.work.items():
                total[name] = total.get(name, 0.0) + value
        return total

    def memory(self) -> dict[str, np.ndarray]:
        """What a run needs besides x and v to go on to the same bits; empty before the first frame."""
        if self.begun is None:
            return {}
        packed = {"begun": np.array(self.begun)}
        for index, change in enumerate(self.all):
            packed |= change.memory | {f"work.{index}.{name}": np.array(value) for name, value in change.work.items()}
        return packed

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """Be as when `memory` was asked for; with an empty one, as at the beginning."""
        if not self.all:
            return
        self.begun = float(memory["begun"]) if "begun" in memory else None
        for index, change in enumerate(self.all):
            change.memory = {name: memory.get(name, fresh) for name, fresh in change.fresh().items()}
            change.work = {name: float(memory.get(f"work.{index}.{name}", 0.0)) for name in change.work}
        self._recall(0.0 if self.begun is None else self.begun)

    def _recall(self, time: float) -> None:
        for change in self.all:
            change.recall(time)
