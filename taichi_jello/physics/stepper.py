"""Stepper: the loop over a frame's substeps, in the form that the processor likes."""

import contextlib
import time
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.support import runtime


@ti.data_oriented
class Stepper:
    """Steps a system: in one kernel, whose members each step their share of the particles, or, for a GPU, with
    parallel kernels for every stage of every substep.

    Where a force keeps by itself for many steps what it found (`watches`), it looks before every step whether that
    still holds; if not, the rest of the substeps is left to the next call."""

    def __init__(self, system: Any, integrator: Any):
        self.system, self.integrator, self.ledger = system, integrator, system.ledger
        self.mutual, self.team, self.count, self.books = system.mutual, system.team, system.count, system.books
        self.compiled = False
        if self.mutual:
            self.reached = system.memory.table("clock", "steps done", np.zeros(1, np.int32))

    def take(self, first: int, last: int, dt: float) -> None:
        """Substeps `first` to `last` of the current frame, dt [s] each."""
        self.system.get_ready(self.integrator, dt)
        origin = first
        while first < last:
            self.system.refresh(first * dt, dt)
            first = self.go(origin, first, last, dt)
            if first < last:
                self.system.forget()

    def go(self, origin: int, first: int, last: int, dt: float) -> int:
        """Substeps `first` to `last`, dt [s] each, of those that began with `origin`. Returns the first that is not
        done."""
        if not self.team:
            self._parallel_steps(origin, first, last, dt)
            return self._reached() if self.mutual else last
        if self.system.size is None:
            return self._launch(origin, first, last, last, 1, dt)
        return self._watched_steps(origin, first, last, dt)

    def _watched_steps(self, origin: int, first: int, last: int, dt: float) -> int:
        """The same in portions, of each of which the team's size is told how long it took."""
        size, at = self.system.size, first
        while at < last:
            end = at + size.portion(last - at)
            runtime.settle(size.members == self.team)
            before, start = self._solved(), time.perf_counter()
            reached = self._launch(origin, at, end, last, int(at == first), dt)
            seconds = time.perf_counter() - start
            if self.compiled:
                size.took(reached - at, self._solved() - before or reached - at, seconds)
            self.compiled = True
            at = reached
            if at < end:
                break
        return at

    def _solved(self) -> int:
        """How often a solver has gone through all springs until now."""
        return self.integrator.solver.passes if self.integrator.solves else 0

    def _launch(self, origin: int, first: int, end: int, last: int, begins: int, dt: float) -> int:
        """Substeps `first` to `end` of those to `last`; not `begins`: right after those before. Returns the first that
        is not done."""
        compiling = runtime.compiling_in_half_the_time() if self.integrator.solves else contextlib.nullcontext()
        with compiling:
            self._team_steps(origin, first, end, last, begins, self.system.members, dt)
        return self._reached() if self.mutual else end

    @ti.kernel
    def _team_steps(self, origin: int, start: int, end: int, stop: int, begins: int, members: int, dt: float):
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
                if start == origin:
                    self.ledger.book(self.system, first, last, 0, stop - origin, origin, dt)
            if ti.static(self.integrator.has_begin):
                if begins:
                    self.integrator.begin(self.system, first, last, start * dt)
            for step in range(start, end):
                if ti.static(len(self.mutual) > 0):
                    self._watch(first, last, step * dt, dt)
                    self.system.wait_for_team()
                    if not self._stale():
                        self._one_step(first, last, origin, step, stop, dt)
                else:
                    self._one_step(first, last, origin, step, stop, dt)

    @ti.func
    def _one_step(self, first, last, origin, step, stop, dt):
        self._look_ahead(first, last, dt)
        for s in range(self.integrator.stages):
            self.integrator.stage(self.system, first, last, s, step * dt, dt)
            if ti.static(self.integrator.solves):
                while self.integrator.solver.mode[0] != 0:
                    for kind in ti.static(self.integrator.solver.kinds):
                        if self.integrator.solver.mode[0] == kind:
                            self.integrator.solver.turn(kind, self.system, first, last)
                    self.integrator.solver.turn_ends(self.system, first, last)
        self.integrator.finish(self.system, first, last, step * dt, dt)
        self.system.brake(first, last)
        if ti.static(self.books):
            self.ledger.book(self.system, first, last, step + 1 - origin, stop - origin, origin, dt)
        if ti.static(len(self.mutual) > 0):
            if first == 0:
                self.reached[0] = step + 1

    @ti.func
    def _look_ahead(self, first, last, dt):
        """At the beginning of a step."""
        if ti.static(not self.integrator.solves):
            self.system.look(first, last, self.system.state.x, self.system.state.v, self.integrator.looks_at * dt)

    @ti.func
    def _watch(self, first, last, t, dt):
        for force in ti.static(self.mutual):
            force.watch(first, last, self.system.state.x, self.system.state.v, t, dt)

    @ti.func
    def _stale(self):
        """Whether what a force keeps by itself for many steps may be wrong in the next one."""
        stale = 0
        for force in ti.static(self.mutual):
            stale = stale | force.stale()
        return stale

    @ti.kernel
    def _is_stale(self) -> int:
        return self._stale()

    @ti.kernel
    def _reached(self) -> int:
        return self.reached[0]

    def _parallel_steps(self, origin: int, first: int, last: int, dt: float) -> None:
        if self.books and first == origin:
            self._parallel_book(origin, origin, last, dt)
        if self.integrator.has_begin:
            self._parallel_begin(first * dt)
        for step in range(first, last):
            if self.mutual:
                self._parallel_watch(step, dt)
            if self.integrator.solves:
                self._parallel_solves(step, dt)
            else:
                for s in range(self.integrator.stages - 1):
                    self._parallel_stage(s, step, dt)
                self._parallel_last_stage(self.integrator.stages - 1, step, dt)
            if self.system.brakes and not self._is_stale():
                self._parallel_brake()
            if self.books and not (self.mutual and self._is_stale()):
                self._parallel_book(origin, step + 1, last, dt)

    def _parallel_solves(self, step: int, dt: float) -> None:
        """One step of a scheme that solves: every turn of the solver is a kernel of its own, and so is its end."""
        if self.mutual and self._is_stale():
            return
        for s in range(self.integrator.stages):
            self._parallel_stage(s, step, dt)
            while mode := self.integrator.solver.mode[0]:
                self._parallel_turn(mode)
                self._parallel_turn_ends()
        self._parallel_finish(step * dt, dt)
        if self.mutual:
            self.reached[0] = step + 1

    @ti.kernel
    def _parallel_watch(self, step: int, dt: float):
        if not self._stale():
            self.reached[0] = step
        self._watch(0, self.count, step * dt, dt)
        self._look_ahead(0, ti.select(self._stale(), 0, self.count), dt)

    @ti.kernel
    def _parallel_book(self, origin: int, step: int, stop: int, dt: float):
        self.ledger.book(self.system, 0, self.count, step - origin, stop - origin, origin, dt)

    @ti.kernel
    def _parallel_begin(self, t: float):
        self.integrator.begin(self.system, 0, self.count, t)

    @ti.kernel
    def _parallel_stage(self, s: int, step: int, dt: float):
        if ti.static(len(self.mutual) > 0):
            last = ti.select(self._stale(), 0, self.count)  # then these loops do nothing
            self.integrator.stage(self.system, 0, last, s, step * dt, dt)
        else:
            self.integrator.stage(self.system, 0, self.count, s, step * dt, dt)

    @ti.kernel
    def _parallel_turn(self, kind: ti.template()):
        self.integrator.solver.turn(kind, self.system, 0, self.count)

    @ti.kernel
    def _parallel_turn_ends(self):
        self.integrator.solver.turn_ends(self.system, 0, self.count)

    @ti.kernel
    def _parallel_finish(self, t: float, dt: float):
        self.integrator.finish(self.system, 0, self.count, t, dt)

    @ti.kernel
    def _parallel_brake(self):
        self.system.brake(0, self.count)

    @ti.kernel
    def _parallel_last_stage(self, s: int, step: int, dt: float):
        if ti.static(len(self.mutual) > 0):
            last = ti.select(self._stale(), 0, self.count)
            self.integrator.stage(self.system, 0, last, s, step * dt, dt)
            self.integrator.finish(self.system, 0, last, step * dt, dt)
            if last > 0:
                self.reached[0] = step + 1
        else:
            self.integrator.stage(self.system, 0, self.count, s, step * dt, dt)
            self.integrator.finish(self.system, 0, self.count, step * dt, dt)
