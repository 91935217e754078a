"""Steps of stiff jellos: as long as they are accurate, shorter where they are not, explicit where something hits.

An interval of a frame is a half, a quarter, … of it. Each is tried as one implicit step and halved if that is not
accurate; where RK4 at its own safe step costs no more than that, RK4 takes it (as LSODA does, Petzold 1983). So an
impact is resolved, which lasts about as long as the lowest swing, 33 steps of RK4 in a cube of 8³ points however stiff.

What is accurate. A step is taken if no jello changes its speed as a whole by other than it did before, or by gravity
alone: an implicit step over an impact takes all of its energy. And, in jellos that touch something or are pinned, if no
particle is farther than POSITION from where its speed and its last acceleration would have brought it.

Jellos that touch nothing move as a whole as free bodies do, exactly: an implicit step would slow down their spin. The
implicit step is for how they deform, seen from where they are as a whole, under centrifugal and Coriolis forces.
"""

from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from taichi_jello.physics.adaptive.free_flight import FreeFlight
from taichi_jello.physics.adaptive.rigid_motion import Motion, RigidMotion, turned
from taichi_jello.physics.stepper import Stepper

STEP_COST = 120.0  # evaluations of all forces, about what an implicit step takes while something touches
SPEED = 0.01  # of a jello's own: by how much it may change in a step in an unforeseen way
SLOW = 0.01  # of √(g H): what is slower than that does not bounce any more
POSITION = 5e-5  # of a jello's size
EASY = 0.125  # of what is allowed: after such a step the next one is twice as long
DEEPEST = 20  # halvings of a frame


@dataclass(frozen=True)
class Moment:
    """Particles at x [m] with velocities v [m/s], (N, 3) float64 each, and how each jello moves as a whole."""

    x: np.ndarray
    v: np.ndarray
    whole: Motion


class AdaptiveStepper:
    """Takes steps of `integrator`, an Adaptive. Between steps it goes on from integrator.past: `level`, how often the
    frame was halved last; `gain` (J, 6) [m/s², rad/s²], how jellos changed their motion as wholes in the last step;
    `smooth`, how many implicit steps there were since anything hit; and where it began with no swing left, with the
    velocities `before` (N, 3) [m/s], how long the last one `lasted` [s]."""

    def __init__(self, system: Any, integrator: Any):
        self.system, self.integrator, self.body = system, integrator, integrator.body
        self.implicit, self.explicit = Stepper(system, integrator), Stepper(system, integrator.explicit)
        self._pushed = False
        self.whole = RigidMotion.of_body(self.body)
        self.flight = FreeFlight(system, self.body, self.whole)
        rest, first = self.body.rest, self.whole.first
        self.size = np.maximum(np.ptp([f.reduceat(rest, first) for f in (np.minimum, np.maximum)], axis=0).max(1), 1e-6)

    def take(self, first: int, last: int, dt: float) -> None:
        """Substeps `first` to `last` of the current frame, dt [s] each."""
        for step in range(first, last):
            self._cover(step, dt)

    def _cover(self, step: int, dt: float) -> None:
        """One substep, by intervals of dt/2^level; at the deepest level they are RK4's."""
        limit = self.integrator.limit
        deepest = self._deepest(dt, limit)
        level, done, parts = min(int(self.integrator.past.get("level", 0)), deepest), 0, 1 << deepest
        now = self._read()
        while done < parts:
            while done % (parts >> level):  # an interval of this length does not begin here
                level += 1
            length, index = dt / (1 << level), step * (1 << level) + done // (parts >> level)
            if level == deepest:
                taken, easy = self._explicitly(now, index, length, limit)
            else:
                taken, easy = self._implicitly(now, index, length)
            if taken is None:
                self._write(now.x, now.v)
                level += 1
                continue
            now, done = taken, done + (parts >> level)
            level -= int(easy and level > 0)
        self.integrator.past["level"] = np.array(level)

    def _deepest(self, dt: float, limit: float) -> int:
        """The level from which on RK4 costs less than an implicit step."""
        if not limit > 0.0:
            return DEEPEST
        return min(DEEPEST, max(0, ceil(np.log2(max(self.integrator.explicit.passes * dt / limit / STEP_COST, 1.0)))))

    def _read(self) -> Moment:
        values = np.empty((self.system.count, 6), self.system.memory.number)
        self.system.good.read(values)
        x, v = values[:, :3].astype(float), values[:, 3:].astype(float)
        return Moment(x, v, self.whole.of(x, v))

    def _written(self, x: np.ndarray, v: np.ndarray) -> Moment:
        """What is now, written to the fields, in their precision."""
        self._write(x, v)
        number = self.system.memory.number
        x, v = x.astype(number).astype(float), v.astype(number).astype(float)
        return Moment(x, v, self.whole.of(x, v))

    def _write(self, x: np.ndarray, v: np.ndarray) -> None:
        self.system.good.write(np.hstack([x, v]).astype(self.system.memory.number))
        self.system.forget()

    def _explicitly(self, now: Moment, index: int, length: float, limit: float) -> tuple[Moment | None, bool]:
        """Go on by RK4. Also tells whether all jellos move as wholes as they did."""
        steps = max(1, ceil(length / limit * (1.0 - 1e-9)))
        self.explicit.take(index * steps, (index + 1) * steps, length / steps)
        after = self._read()
        calm = not self._jolts(now, after, length).any()
        self._accept(now, after, length)
        return after, calm

    def _implicitly(self, now: Moment, index: int, length: float) -> tuple[Moment | None, bool]:
        """Go on by an implicit step, None if it is not accurate. Also tells whether one twice as long may be."""
        t, flight, owner = index * length, self.flight, self.body.jello
        flies = flight.may_fly(now, t, length)
        if flies.any():
            met = flight.meets(self._write, now, flies, t, length)
            if (met & (self.whole.speed(now.whole) > self._slow())).any():
                return None, False
            flies &= ~met.any()
        v, push = flight.at_rest(now.x, now.v, now.whole, flies)
        found = after = self._step(now.x, v, push, index, length)
        turns = turned(now.whole, length)
        if flies.any():
            after = self._written(*flight.moved_on(found, now, turns, flies, length))
            if (flight.presses(t + length) & flies).any():
                self._drop()
                return None, False
        if not flies.all():
            after = self._written(after.x, flight.kept(now, after, flies, t + length, length))
        error = self._error(now.x, v, found.x, length, flies)
        if not np.isfinite(after.v).all() or (self._jolts(now, after, length) & ~flies).any() or error > 1.0:
            self._drop()
            return None, False
        v = np.where(flies[owner, None], np.einsum("nij,nj->ni", turns[owner], v), v)
        self._accept(now, after, length, flies, v)
        return after, error < EASY

    def _step(self, x: np.ndarray, v: np.ndarray, push: np.ndarray, index: int, length: float) -> Moment:
        """An implicit step from x and v, with a push (N, 3) [m/s²] besides what forces do."""
        self._write(x, v)
        if self._pushed or push.any():
            self.integrator.set_push(push.astype(self.system.memory.number))
            self._pushed = bool(push.any())
        self.implicit.take(index, index + 1, length)
        return self._read()

    def _jolts(self, now: Moment, after: Moment, length: float) -> np.ndarray:
        """(J,) whether a jello that is free has changed its speed otherwise than in the step before, and than a free
        fall does."""
        changed = self._changed(now, after)
        fall = np.hstack([self.flight.gravity(), np.zeros(3)])
        off = np.full(len(self.size), np.inf)
        for gain in (self.integrator.past.get("gain", fall), fall):
            rest = changed - length * gain
            turning = np.einsum("ji,jik,jk->j", rest[:, 3:], now.whole.inertia, rest[:, 3:]) / self.whole.mass[:, 0]
            off = np.minimum(off, np.sqrt((rest[:, :3] ** 2).sum(1) + turning))
        speed = np.maximum(self.whole.speed(now.whole), self.whole.speed(after.whole))
        return self.flight.free & (off > np.maximum(SPEED * speed, self._slow()))

    @staticmethod
    def _changed(now: Moment, after: Moment) -> np.ndarray:
        """(J, 6) [m/s, rad/s] by what each jello has changed its motion as a whole."""
        return np.hstack([after.whole.velocity - now.whole.velocity, after.whole.spin - now.whole.spin])

    def _slow(self) -> np.ndarray:
        """(J,) [m/s] what a jello does not bounce any more with."""
        return SLOW * np.sqrt(np.linalg.norm(self.flight.gravity()) * self.size)

    def _error(self, x0: np.ndarray, v0: np.ndarray, x: np.ndarray, length: float, flies: np.ndarray) -> float:
        """The largest error of position of a step from x0 and v0 to x, of what is allowed: how far it is from where
        v0 and the acceleration in the step before lead. 1 where that is not known."""
        past = self.integrator.past
        if "before" not in past or not np.array_equal(past["flies"], flies):
            return 1.0
        bend = (v0 - past["before"]) / float(past["lasted"]) + flies[self.body.jello, None] * self.flight.gravity()
        away = x - x0 - length * (v0 + 0.5 * length * bend)
        mean = np.sqrt(self.whole.mean((away**2).sum(1, keepdims=True))[:, 0]) / self.size
        return float(mean.max()) / POSITION

    def _accept(self, now: Moment, after: Moment, length: float, flies: Any = None, v: Any = None) -> None:
        """Remember a step that is taken, and, of an implicit one, which jellos flew and the velocities v (N, 3) that it
        began with, unless a swing may have been left then, as after an impact."""
        past = self.integrator.past
        changed = self._changed(now, after)
        smooth = 0 if flies is None else int(past.get("smooth", 0)) + 1
        flew = np.zeros(len(self.size), bool) if flies is None else flies.copy()
        past |= {"gain": changed / length, "smooth": np.array(smooth), "flies": flew}
        past.pop("before", None)
        if smooth > 1:
            past |= {"before": v, "lasted": np.array(length)}
        if self.system.ledger:
            self.system.ledger.keep()

    def _drop(self) -> None:
        if self.system.ledger:
            self.system.ledger.drop()
