"""What changes while time goes on: springs and gravity, looked at once a frame, at its beginning."""

from typing import Any

import numpy as np

from taichi_jello.physics.forces.springs.spring_state import Law, by_jello, law_at, lengths
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.scene.keyframes import SLACK, factor, gravity


class Change:
    """One thing that changes. `memory`: what it must remember to go on from a moment, arrays that are replaced, never
    written to; `work` [J]: put into the system until now, by what for."""

    memory: dict[str, np.ndarray]
    work: dict[str, float]

    def fresh(self) -> dict[str, np.ndarray]:
        """The memory of a beginning."""
        return {}

    def begin(self, time: float, passed: float, x: np.ndarray) -> None:
        """Make everything as it is from `time` [s] on, `passed` [s] after it was last done, with the particles at x
        (N, 3) [m]."""

    def recall(self, time: float) -> None:
        """Make everything as it was at `time`, with the memory as it is now."""


class SpringChange(Change):
    """Keyframes of stiffness, damping and rest lengths, freezing, tearing, yield and creep, in this order."""

    def __init__(self, scene: Scene, body: Body, springs: Any, touch: Any):
        self.scene, self.body, self.springs, self.touch = scene, body, springs, touch
        self.creep = by_jello(scene, body, [jello.creep for jello in scene.jello])
        self.yield_strain = by_jello(scene, body, [jello.yield_strain for jello in scene.jello])
        self.tear_strain = by_jello(scene, body, [jello.tear_strain for jello in scene.jello])
        self.freezes = any(row.freeze for jello in scene.jello for row in jello.keyframe)
        keyed = any(jello.keyframe for jello in scene.jello)
        kinds = {"keyframes": keyed, "tearing": self.tear_strain.any(), "yield": self.yield_strain.any()}
        self.work = dict.fromkeys([name for name, used in (kinds | {"creep": self.creep.any()}).items() if used], 0.0)
        self.memory = self.fresh()
        self.law = law_at(scene, body, 0.0, self.memory)
        self.obeyed: Law = Law(body.stiffness, body.rest_length, body.damping)

    @classmethod
    def made_for(cls, scene: Scene, body: Body, forces: dict[str, Any]) -> list["SpringChange"]:
        wanted = any(jello.changes for jello in scene.jello)
        return [cls(scene, body, forces["springs"], forces.get("touch"))] if wanted and "springs" in forces else []

    def fresh(self) -> dict[str, np.ndarray]:
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
        self._change("keyframes", time, x)
        if self.freezes:
            self._freeze(time, x)
        if "tearing" in self.work:
            self._tear(time, x)
        if "yield" in self.work or "creep" in self.work:
            self._flow(time, passed, x)
        self._tell()

    def recall(self, time: float) -> None:
        self.law = law_at(self.scene, self.body, time, self.memory)
        self._tell()

    def _freeze(self, time: float, x: np.ndarray) -> None:
        """Springs of a jello that passes a keyframe which freezes take their length for their rest length."""
        passed = [sum(row.freeze and row.time <= time + SLACK for row in jello.keyframe) for jello in self.scene.jello]
        frozen = by_jello(self.scene, self.body, (np.array(passed) > self.memory["frozen"]).tolist()) > 0.0
        self.memory["frozen"] = np.array(passed)
        if frozen.any():
            shape = lengths(self.body, x) / self._swollen(time)
            for name in {"rest_length", "made"} & self.memory.keys():
                self.memory[name] = np.where(frozen, shape, self.memory[name])
            self._change("keyframes", time, x)

    def _swollen(self, time: float) -> np.ndarray:
        """(S,) the factor of the rest lengths, 1 where it is zero: such springs have no shape to take on."""
        scale = by_jello(self.scene, self.body, [factor(j.keyframe, "rest_length", time) for j in self.scene.jello])
        return np.where(scale > 0.0, scale, 1.0)

    def _tear(self, time: float, x: np.ndarray) -> None:
        """Springs that are stretched too far are no more. What has yielded counts as stretched, what has frozen not."""
        made = self.memory.get("made", self.body.rest_length) * self._swollen(time)
        far = lengths(self.body, x) > (1.0 + self.tear_strain) * made
        torn = (self.tear_strain > 0.0) & far & self.memory["whole"]
        if torn.any():
            self.memory["whole"] = self.memory["whole"] & ~torn
            self._change("tearing", time, x)

    def _flow(self, time: float, passed: float, x: np.ndarray) -> None:
        """Rest lengths follow: all of the strain beyond the yield limit at once, the rest of it as dR/dt = creep
        (L - R), Maxwell's fluid."""
        if "yield" in self.work:
            now, rest = lengths(self.body, x), self.law.rest_length
            limit = np.where(self.yield_strain > 0.0, self.yield_strain, np.inf)
            least = now / (1.0 + limit)
            most = np.divide(now, 1.0 - limit, out=np.full_like(now, np.inf), where=limit < 1.0)
            self._shift(np.clip(rest, least, most) - rest, time)
            self._change("yield", time, x)
        if "creep" in self.work:
            left = lengths(self.body, x) - self.law.rest_length
            self._shift(left * -np.expm1(-self.creep * passed), time)
            self._change("creep", time, x)

    def _shift(self, by: np.ndarray, time: float) -> None:
        """Lengthen the rest lengths by (S,) [m], as long as they are now; none falls below zero."""
        if by.any():
            self.memory["rest_length"] = np.maximum(self.memory["rest_length"] + by / self._swollen(time), 0.0)

    def _change(self, name: str, time: float, x: np.ndarray) -> None:
        """Obey the memory from now on, and book what that does: changing springs under load puts energy in or takes it
        out, the difference of what they hold."""
        before, self.law = self.law, law_at(self.scene, self.body, time, self.memory)
        if not _same(before, self.law):
            scale = self.springs.scales["stiffness"]
            change = self.law.energy(self.body, x) - before.energy(self.body, x)
            self.work = self.work | {name: self.work.get(name, 0.0) + scale * float(change.sum())}

    def _tell(self) -> None:
        if not _same(self.obeyed, self.law):
            self.springs.obey(self.law)
            if self.touch:
                self.touch.obey(self.law)
            self.obeyed = self.law


def _same(a: Law, b: Law) -> bool:
    pairs = ((a.stiffness, b.stiffness), (a.rest_length, b.rest_length), (a.damping, b.damping))
    return all(p is q or np.array_equal(p, q) for p, q in pairs)


class GravityChange(Change):
    """Keyframes of gravity: what it is in the middle of a frame it is in all of it, so that a fall is as exact as a
    midpoint rule is. Its energy -m g·x changes with g: that much work is put in."""

    def __init__(self, scene: Scene, body: Body, force: Any):
        self.scene, self.body, self.force = scene, body, force
        self.memory, self.work = {}, {"keyframes": 0.0}

    @classmethod
    def made_for(cls, scene: Scene, body: Body, forces: dict[str, Any]) -> list["GravityChange"]:
        return [cls(scene, body, forces["gravity"])] if scene.keyframe else []

    def begin(self, time: float, passed: float, x: np.ndarray) -> None:
        before = np.array(self.force.acceleration)
        self.recall(time)
        change = np.array(self.force.acceleration) - before
        self.work = {"keyframes": self.work["keyframes"] - float(change @ (self.body.mass @ x.astype(float)))}

    def recall(self, time: float) -> None:
        now = tuple(gravity(self.scene.keyframe, time + 0.5 * self.scene.solver.frame_dt))
        if now != self.force.acceleration:
            self.force.set(now)


KINDS = (SpringChange, GravityChange)


def options(scene: Scene) -> dict[str, bool]:
    """What there is that changes with time, and whether the scene has it."""
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
    """All changes of a scene, made once for each frame that begins: what one frame has been told, a run that goes on
    within that frame is not told again."""

    def __init__(self, scene: Scene, body: Body, forces: list[Any]):
        named = {force.title: force for force in forces}
        self.present = [title for title, used in options(scene).items() if used]
        self.absent = [title for title, used in options(scene).items() if not used]
        self.all = [change for kind in KINDS for change in kind.made_for(scene, body, named)]
        self.begun: float | None = None

    def begin(self, time: float, x: np.ndarray) -> None:
        if not self.all or (self.begun is not None and abs(time - self.begun) <= SLACK):
            return
        passed = 0.0 if self.begun is None else max(time - self.begun, 0.0)
        if self.begun is None:
            self._recall(time)
        for change in self.all:
            change.begin(time, passed, x)
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
