"""AdaptiveStepper: implicit steps as long as they are accurate, explicit ones in impacts.

An interval of a frame is tried as one implicit step and halved if that is inaccurate. Where RK4 at its own safe step
costs no more, RK4 takes it (as in LSODA, Petzold 1983). So impacts are resolved: they last about as long as the lowest
oscillation, in a cube of 8³ particles 33 steps of RK4 at any stiffness.

A step is accurate if no free jello changes its rigid motion otherwise than in the step before or under gravity alone:
an implicit step across an impact would take all of its energy. And in jellos that touch something or are pinned, no
particle may be farther than POSITION from where its velocity and its last acceleration lead. The rigid motion of jellos
that touch nothing is exact (see free_flight.py).
"""

from math import ceil
from typing import Any

import numpy as np

from taichi_jello.physics.adaptive.free_flight import FreeFlight
from taichi_jello.physics.adaptive.rigid_motion import Instant, RigidMotion, turned
from taichi_jello.physics.stable_step import largest_dt
from taichi_jello.physics.stepper import Stepper

STEP_COST = 120.0  # evaluations of all forces that an implicit step costs in contact
SPEED = 0.01  # of a jello's speed: the unexpected change that a step may make
SLOW = 0.01  # of √(g H): slower jellos no longer bounce
POSITION = 5e-5  # of a jello's size: the error that a step may make
EASY = 0.125  # of the allowed error: below it the next step is twice as long
MAX_LEVEL = 20  # halvings of a frame


class AdaptiveStepper:
    """Takes steps of `integrator`, an Adaptive. It remembers in integrator.past: `level`, how often the last frame was
    halved; of the last step `gain` (J, 6) [m/s², rad/s²], the change of each rigid motion, `flies` (J,), which jellos
    flew, and, if it began without oscillations, the velocities `before` it (N, 3) [m/s] and how long it `lasted` [s];
    and `smooth`, the number of implicit steps since the last explicit one."""

    def __init__(self, system: Any, integrator: Any):
        self.system, self.integrator, self.body = system, integrator, integrator.body
        self.implicit, self.explicit = Stepper(system, integrator, on_trial=True), Stepper(system, integrator.explicit)
        self._pushed, self._explicit_dt = False, 0.0
        self._rates: list[Any] = []
        self.whole = RigidMotion(self.body.jello, self.body.mass[:, None])
        self.flight = FreeFlight(system, self.body, self.whole)
        rest, first = self.body.rest, self.whole.first
        self.size = np.maximum(np.ptp([f.reduceat(rest, first) for f in (np.minimum, np.maximum)], axis=0).max(1), 1e-6)

    @property
    def explicit_dt(self) -> float:
        """The safe step [s] of RK4."""
        if self._rates is not self.system.rates:  # the first time, or forces have been tuned
            self._rates, rk4 = self.system.rates, self.integrator.explicit
            self._explicit_dt = largest_dt(rk4.amplification, rk4.safety, self._rates, self.system.drag).dt
        return self._explicit_dt

    def take(self, first: int, last: int, dt: float) -> None:
        """Substeps `first` to `last` of the current frame, dt [s] each."""
        for step in range(first, last):
            self._cover(step, dt)

    def _cover(self, step: int, dt: float) -> None:
        """One substep, in intervals of dt/2^level; those of the deepest level are RK4's."""
        deepest = self._deepest(dt)
        level, done, parts = min(int(self.integrator.past.get("level", 0)), deepest), 0, 1 << deepest
        now = self._read()
        while done < parts:
            while done % (parts >> level):  # no interval of this length begins here
                level += 1
            length, index = dt / (1 << level), step * (1 << level) + done // (parts >> level)
            take = self._explicit_steps if level == deepest else self._implicit_step
            after, easy = take(now, index, length)
            if after is None:
                self._write(now.x, now.v)
                level += 1
                continue
            now, done = after, done + (parts >> level)
            level -= int(easy and level > 0)
        self.integrator.past["level"] = np.array(level)

    def _deepest(self, dt: float) -> int:
        """The level from which on RK4 costs less than an implicit step."""
        if not self.explicit_dt > 0.0:
            return MAX_LEVEL
        cost = self.integrator.explicit.passes * dt / self.explicit_dt
        return min(MAX_LEVEL, max(0, ceil(np.log2(max(cost / STEP_COST, 1.0)))))

    def _read(self) -> Instant:
        values = np.empty((self.system.count, 6), self.system.memory.number)
        self.system.good.read(values)
        x, v = values[:, :3].astype(float), values[:, 3:].astype(float)
        return Instant(x, v, self.whole.of(x, v))

    def _write(self, x: np.ndarray, v: np.ndarray) -> None:
        self.system.good.write(np.hstack([x, v]).astype(self.system.memory.number))
        self.system.forget()

    def _written(self, x: np.ndarray, v: np.ndarray) -> Instant:
        """Write this state, and return it as rounded by the fields."""
        self._write(x, v)
        return self._read()

    def _explicit_steps(self, now: Instant, index: int, length: float) -> tuple[Instant, bool]:
        """Take an interval by RK4; also whether no jello has jolted."""
        steps = max(1, ceil(length / self.explicit_dt * (1.0 - 1e-9)))
        self.explicit.take(index * steps, (index + 1) * steps, length / steps)
        self.integrator.explicit_passes += steps * self.integrator.explicit.passes
        after = self._read()
        calm = not self._jolts(now, after, length).any()
        self._accept(now, after, length, np.zeros(len(self.size), bool), None)
        return after, calm

    def _implicit_step(self, now: Instant, index: int, length: float) -> tuple[Instant | None, bool]:
        """Take an interval by an implicit step, None if inaccurate; also whether the next may be twice as long."""
        t, flight, owner = index * length, self.flight, self.body.jello
        flies = flight.may_fly(now, t, length)
        if flies.any():
            met = flight.meets(self._write, now, flies, t, length)
            if (met & (self.whole.speed(now.whole) > self._slow())).any():
                return None, False
            flies &= ~met.any()
        v, push = flight.at_rest(now, flies)
        found = after = self._solve(now.x, v, push, index, length)
        turns, hits = turned(now.whole, length), False
        if flies.any():
            after = self._written(*flight.moved_on(found, now, turns, flies, length))
            hits = (flight.presses(t + length) & flies).any()
        if not flies.all() and not hits:
            after = self._written(after.x, flight.kept(now, after, flies, t + length, length))
        error = self._error(now.x, v, found.x, length, flies)
        jolts = (self._jolts(now, after, length) & ~flies).any()
        if hits or jolts or error > 1.0 or not np.isfinite(after.v).all():
            if self.system.ledger:
                self.system.ledger.drop()
            return None, False
        v = np.where(flies[owner, None], np.einsum("nij,nj->ni", turns[owner], v), v)
        if self.system.ending_steps:
            self.implicit.accept(t + length)
        self._accept(now, after, length, flies, v)
        return after, error < EASY

    def _solve(self, x: np.ndarray, v: np.ndarray, push: np.ndarray, index: int, length: float) -> Instant:
        """An implicit step from x and v, with accelerations (N, 3) [m/s²] besides those by forces."""
        self._write(x, v)
        if self._pushed or push.any():
            self.integrator.set_push(push.astype(self.system.memory.number))
            self._pushed = bool(push.any())
        self.implicit.take(index, index + 1, length)
        return self._read()

    def _jolts(self, now: Instant, after: Instant, length: float) -> np.ndarray:
        """(J,) whether a free jello has changed its rigid motion unlike in the last step and unlike in a fall."""
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
    def _changed(now: Instant, after: Instant) -> np.ndarray:
        """(J, 6) [m/s, rad/s] the change of each jello's velocity and spin."""
        return np.hstack([after.whole.velocity - now.whole.velocity, after.whole.spin - now.whole.spin])

    def _slow(self) -> np.ndarray:
        """(J,) [m/s] the speed below which a jello no longer bounces."""
        return SLOW * np.sqrt(np.linalg.norm(self.flight.gravity()) * self.size)

    def _error(self, x0: np.ndarray, v0: np.ndarray, x: np.ndarray, length: float, flies: np.ndarray) -> float:
        """The largest position error of a step from x0 and v0 to x, over the allowed one: the distance from where v0
        and the last acceleration lead. 1 if that is unknown."""
        past = self.integrator.past
        if "before" not in past or not np.array_equal(past["flies"], flies):
            return 1.0
        acceleration = (v0 - past["before"]) / float(past["lasted"])
        acceleration += flies[self.body.jello, None] * self.flight.gravity()
        away = x - x0 - length * (v0 + 0.5 * length * acceleration)
        mean = np.sqrt(self.whole.mean((away**2).sum(1, keepdims=True))[:, 0]) / self.size
        return float(mean.max()) / POSITION

    def _accept(self, now: Instant, after: Instant, length: float, flies: np.ndarray, v: np.ndarray | None) -> None:
        """Remember a step; of an implicit one also the velocities v (N, 3) at its start, except right after an explicit
        one, which may leave oscillations."""
        past = self.integrator.past
        smooth = 0 if v is None else int(past.get("smooth", 0)) + 1
        past |= {"gain": self._changed(now, after) / length, "smooth": np.array(smooth), "flies": flies}
        past.pop("before", None)
        if smooth > 1:
            past |= {"before": v, "lasted": np.array(length)}
        if self.system.ledger:
            self.system.ledger.keep()
