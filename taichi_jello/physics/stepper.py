"""Stepper: the loop over a frame's substeps, in the form that suits the processor."""

import contextlib
import time
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.support import runtime


@ti.data_oriented
class Stepper:
    """Steps a system. One step is `one_step`. On a CPU one kernel does all substeps of a call, each member of a team
    with its share of the particles; on a GPU every stage of a substep is a parallel kernel.

    on_trial: steps may be taken back; call `accept` after those that are not.

    If a neighbour list becomes invalid before a step, the kernels leave this and the following substeps undone."""

    def __init__(self, system: Any, integrator: Any, *, on_trial: bool = False):
        self.on_trial = on_trial
        self.system, self.integrator, self.ledger = system, integrator, system.ledger
        self.mutual, self.team, self.count, self.books = system.mutual, system.team, system.count, system.books
        self.compiled = False
        if self.mutual:
            self.reached = system.memory.table("clock", "steps done", np.zeros(1, np.int32))

    def take(self, first: int, last: int, dt: float) -> None:
        """Substeps `first` to `last` of the current frame, dt [s] each."""
        self.system.get_ready(self.integrator, dt)
        origin, opens = first, True
        while first < last:
            self.system.refresh(first * dt, dt)
            if self.team:
                first = self._team_portions(origin, first, last, dt, opens)
            else:
                self._parallel_steps(origin, first, last, dt, opens)
                first = self._reached() if self.mutual else last
            opens = False  # the ledger has the beginning, even if no step could be taken
            if first < last:
                self.system.forget()

    def _team_portions(self, origin: int, first: int, last: int, dt: float, opens: bool) -> int:
        """Substeps `first` to `last` of those that began with `origin`, in portions whose times decide the team's size.
        opens: whether the ledger books their beginning. Returns the first that is not done."""
        size, solver, at = self.system.size, self.integrator.solver if self.integrator.solves else None, first
        while at < last:
            end, passes = last, 0
            if size:
                end = at + size.portion(last - at)
                runtime.settle(size.members == self.team)
                passes = solver.passes if solver else 0  # evaluations of all springs until now
            start = time.perf_counter()
            with runtime.compiling_in_half_the_time() if solver else contextlib.nullcontext():
                begins = at == first
                self._team_steps(origin, at, end, last, int(begins), int(begins and opens), self.system.members, dt)
            reached = self._reached() if self.mutual else end
            seconds = time.perf_counter() - start
            if size and self.compiled:
                size.took(reached - at, (solver.passes - passes if solver else 0) or reached - at, seconds)
            self.compiled, at = True, reached
            if reached < end:
                break
        return at

    @ti.func
    def one_step(self, first, last, origin, step, stop, dt):
        """Step number `step` of those from `origin` to `stop`, for the particles first … last - 1: find contacts; for
        each stage gather the forces (System.accelerations); then `_finish`."""
        self._find_contacts(first, last, dt)
        for s in range(self.integrator.stages):
            self.integrator.stage(self.system, first, last, s, step * dt, dt)
            if ti.static(self.integrator.solves):
                while self.integrator.solver.mode[0] != 0:
                    for kind in ti.static(self.integrator.solver.kinds):
                        if self.integrator.solver.mode[0] == kind:
                            self.integrator.solver.turn(kind, self.system, first, last)
                    self.integrator.solver.turn_ends(self.system, first, last)
        self._finish(first, last, origin, step, stop, dt)

    @ti.func
    def _finish(self, first, last, origin, step, stop, dt):
        """Advance and stop at solids, brake deep contacts, book the work."""
        self.integrator.finish(self.system, first, last, step * dt, dt)
        if ti.static(not self.on_trial):
            self.system.end_step(first, last, (step + 1) * dt)
        self.system.brake(first, last)
        if ti.static(self.books):
            self.ledger.book(self.system, first, last, step + 1 - origin, stop - origin, origin, dt)
        if ti.static(len(self.mutual) > 0):
            if first == 0 and last > 0:
                self.reached[0] = step + 1

    @ti.kernel
    def _team_steps(
        self, origin: int, start: int, end: int, stop: int, begins: int, opens: int, members: int, dt: float
    ):
        if ti.static(len(self.mutual) > 0):
            self.reached[0] = start
        self.system.gather(members)
        if ti.static(self.team == 1):
            ti.loop_config(serialize=True)
        else:
            ti.loop_config(block_dim=1)
        for member in range(members if ti.static(self.team > 1) else 1):
            first, last = self.system.part_of(member)
            if ti.static(self.books):
                if opens:
                    self.ledger.book(self.system, first, last, 0, stop - origin, origin, dt)
            if ti.static(self.integrator.has_begin):
                if begins:
                    self.integrator.begin(self.system, first, last, start * dt)
            for step in range(start, end):
                if ti.static(len(self.mutual) > 0):
                    self._watch(first, last, step * dt, dt)
                    self.system.wait_for_team()
                    if not self._stale():
                        self.one_step(first, last, origin, step, stop, dt)
                else:
                    self.one_step(first, last, origin, step, stop, dt)

    @ti.kernel
    def accept(self, t: float):
        """Steps on trial have reached the state at t."""
        self.system.gather(1)
        self.system.end_step(0, self.count, t)

    @ti.func
    def _find_contacts(self, first, last, dt):
        if ti.static(not self.integrator.solves):
            x, v = ti.static(self.system.state.x, self.system.state.v)
            self.system.find_contacts(first, last, x, v, self.integrator.search_at * dt)

    @ti.func
    def _watch(self, first, last, t, dt):
        for force in ti.static(self.mutual):
            force.watch(first, last, self.system.state.x, self.system.state.v, t, dt)

    @ti.func
    def _stale(self):
        """Whether a neighbour list may be invalid in the next step."""
        stale = 0
        for force in ti.static(self.mutual):
            stale = stale | force.stale()
        return stale

    @ti.func
    def _last(self):
        """One past the last particle of a parallel loop: none if the step has to wait."""
        return ti.select(self._stale(), 0, self.count) if ti.static(len(self.mutual) > 0) else self.count

    @ti.kernel
    def _is_stale(self) -> int:
        return self._stale()

    @ti.kernel
    def _reached(self) -> int:
        return self.reached[0]

    def _parallel_steps(self, origin: int, first: int, last: int, dt: float, opens: bool) -> None:
        """`one_step` as kernels for a GPU. Their loops do nothing if the step has to wait."""
        solves, stages = self.integrator.solves, self.integrator.stages
        if self.books and opens:
            self._parallel_book(origin, last, dt)
        if self.integrator.has_begin:
            self._parallel_begin(first * dt)
        for step in range(first, last):
            if self.mutual:
                self._parallel_watch(step, dt)
                if solves and self._is_stale():
                    return
            for s in range(stages):
                self._parallel_stage(s, origin, step, last, dt, not solves and s == stages - 1)
                while solves and (mode := self.integrator.solver.mode[0]):
                    self._parallel_turn(mode)
                    self._parallel_turn_ends()
            if solves:
                self._parallel_finish(origin, step, last, dt)

    @ti.kernel
    def _parallel_watch(self, step: int, dt: float):
        if not self._stale():
            self.reached[0] = step
        self._watch(0, self.count, step * dt, dt)
        self._find_contacts(0, self._last(), dt)

    @ti.kernel
    def _parallel_book(self, origin: int, stop: int, dt: float):
        self.ledger.book(self.system, 0, self.count, 0, stop - origin, origin, dt)

    @ti.kernel
    def _parallel_begin(self, t: float):
        self.integrator.begin(self.system, 0, self.count, t)

    @ti.kernel
    def _parallel_stage(self, s: int, origin: int, step: int, stop: int, dt: float, finishes: ti.template()):
        self.integrator.stage(self.system, 0, self._last(), s, step * dt, dt)
        if ti.static(finishes):
            self._finish(0, self._last(), origin, step, stop, dt)

    @ti.kernel
    def _parallel_turn(self, kind: ti.template()):
        self.integrator.solver.turn(kind, self.system, 0, self.count)

    @ti.kernel
    def _parallel_turn_ends(self):
        self.integrator.solver.turn_ends(self.system, 0, self.count)

    @ti.kernel
    def _parallel_finish(self, origin: int, step: int, stop: int, dt: float):
        self._finish(0, self._last(), origin, step, stop, dt)
