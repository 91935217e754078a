"""The program's own solve of the steps that `jello study solvers` compares ways with, and the same solve with the plain
preconditioner in place of its own: the two differ in nothing else, so that their times can be compared."""

import time
from collections.abc import Iterator

from taichi_jello import runtime
from taichi_jello.physics.integrators.backward_euler import BackwardEuler
from taichi_jello.physics.solve.inner import Blocks
from taichi_jello.physics.solve.newton import MOST
from taichi_jello.physics.system import System
from taichi_jello.studies._solvers import STEP, Array, Landing

REPEATS = 3  # of each solve, of which the quickest counts


class PlainBackwardEuler(BackwardEuler):
    name = "backward-euler, plain"
    preconditioner = Blocks


METHODS = {"blocks": PlainBackwardEuler, "two levels added": BackwardEuler}


class Program:
    """One of METHODS, compiled for the jello of a landing, in float32 on one thread."""

    def __init__(self, problem: Landing, inner: str):
        if runtime.current().precision != "f32":
            runtime.start("cpu", "f32")
        self.system = System(problem.scene, problem.body, method=METHODS[inner], team=1)
        self.solver = self.system.integrator.solver
        self.solver.accuracy = 1e-6  # as many rounds as are asked for
        self.step(problem, 1)

    def step(self, problem: Landing, rounds: int) -> tuple[Array, int, float]:
        """Where that many Newton steps lead from the state that the landing is in, by how many passes over the springs
        and in how many seconds."""
        self.system.integrator.prepare(self.system, STEP)
        self.solver.registers[MOST] = rounds
        self.system.write(problem.x, problem.v)
        before, began = self.solver.passes, time.perf_counter()
        self.system.steps(0, 1, STEP)
        took = time.perf_counter() - began
        self.system.keep_if_finite()
        return self.system.read()[0], self.solver.passes - before, took

    def iterates(self, problem: Landing) -> Iterator[tuple[Array, int, float]]:
        """Every Newton step's end, passes and seconds until there; each is solved for from the beginning."""
        last = -1
        for rounds in range(1, self.solver.rounds + 1):
            made = [self.step(problem, rounds) for _ in range(REPEATS)]
            yield made[0][0], made[0][1], float(min(seconds for _, _, seconds in made))
            if made[0][1] == last:  # it has come to its end
                return
            last = made[0][1]

    @property
    def numbers(self) -> int:
        """That its preconditioner keeps."""
        fields = self.system.memory.fields
        return sum(size for _, name, size in fields if name.startswith(("coarse", "factors"))) // 4
