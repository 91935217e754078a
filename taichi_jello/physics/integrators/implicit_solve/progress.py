"""The progress of a solve: which step comes next, and when the solve ends.

One thread of the team makes these decisions. They are kept in fields of one number each, which all threads read.
"""

import taichi as ti

from taichi_jello.physics.integrators.implicit_solve.rigid_modes import RigidModes
from taichi_jello.physics.state import Memory

DONE, LINEARISE, EVALUATE, CONJUGATE = range(4)  # modes: what the next turn does
# Phases: what the last turn has found. Between NEW_SYSTEM and ITERATING conjugate gradients need a direction.
STARTING, ACCEPTED, NEW_SYSTEM, ITERATING, TOO_FAR, CONVERGED = range(6)

MAX_ITERATIONS = 30  # Newton steps of a solve
MAX_PRODUCTS = 200  # with H in a Newton step
FORCING = 0.1  # factor by which conjugate gradients reduce the residual in a Newton step
MAX_BACKTRACKS = 6  # how often a Newton step may be shortened
OVERSHOOT = 0.5  # a step is too far where the slope along it is below -OVERSHOOT times the slope at its start
MAX_STAGNANT = 8  # Newton steps that gain more than half the least gain before; they count twice near the end:
NEAR_END = 1e-4  # if they gain this fraction of the largest gain, they are within 1 % of the distance to the solution


@ti.data_oriented
class Progress:
    def __init__(self, memory: Memory, rigid: RigidModes):
        def real(name: str) -> ti.Field:
            return memory.zeros("solve", name, (1,))

        def whole(name: str) -> ti.Field:
            return memory.zeros("solve", name, (1,), whole=True)

        self.rigid = rigid
        self.c, self.time, self.accuracy, self.roundoff = map(real, ("c", "time", "accuracy", "roundoff"))
        self.mode, self.phase, self.evaluations, self.products = map(
            whole, ("mode", "phase", "evaluations", "products")
        )
        # Newton steps: the fraction of p to go, d · r at the start, and when to end.
        self.fraction, self.slope, self.tolerance = map(real, ("fraction", "slope", "tolerance"))
        self.resolution, self.largest_gain, self.least_gain = map(real, ("resolution", "largest gain", "least gain"))
        self.iterations, self.last_iteration = map(whole, ("iterations", "last iteration"))
        self.backtracks, self.stagnant = map(whole, ("backtracks", "stagnant"))
        # Conjugate gradients: ρ = r · s, its target, and the coefficients.
        self.rho, self.target, self.alpha, self.beta = map(real, ("rho", "target", "alpha", "beta"))
        self.products_here = whole("products here")

    @ti.func
    def start(self, c, t, solves):
        self.c[0], self.time[0], self.fraction[0] = c, t, 1.0
        self.iterations[0], self.last_iteration[0] = 0, MAX_ITERATIONS
        self.backtracks[0] = MAX_BACKTRACKS  # the first step is never shortened
        self.phase[0] = STARTING
        self.mode[0] = LINEARISE if solves else DONE

    @ti.func
    def linearised(self):
        if self.phase[0] == STARTING:
            self.mode[0] = EVALUATE
        else:
            self.phase[0] = NEW_SYSTEM

    @ti.func
    def judge(self, slope, displacement):
        """Accept a Newton step, shorten it, or end the solve, by the slope d · r and the largest displacement [m] that
        the residual alone would cause at its end."""
        before = self.fraction[0] * self.slope[0]
        self.evaluations[0] += 1
        if slope < -OVERSHOOT * before and self.backtracks[0] < MAX_BACKTRACKS:
            self.phase[0] = TOO_FAR
            self.backtracks[0] += 1
            # To the zero of the slope if it were linear.
            self.fraction[0] *= ti.min(0.6, ti.max(0.1, before / (before - slope)))
        elif (
            displacement == 0.0
            or not displacement < 1e30
            or self.iterations[0] >= self.last_iteration[0]
            or (self.iterations[0] > 0 and displacement <= self.tolerance[0])
        ):
            self.phase[0] = CONVERGED
            self.mode[0] = DONE
        else:
            self.phase[0] = ACCEPTED
            self.iterations[0] += 1
            self.backtracks[0] = 0
            self.mode[0] = LINEARISE

    @ti.func
    def conjugate(self, curvature):
        """α = ρ/(p · H p)."""
        self.alpha[0] = self.rho[0] / curvature
        self.slope[0] += self.alpha[0] * self.rho[0]
        self.products[0] += 1
        self.phase[0] = ITERATING

    @ti.func
    def choose_direction(self, rho, displacement, distance):
        """Continue conjugate gradients with β = ρ/ρ₋, or take the Newton step."""
        if self.phase[0] == NEW_SYSTEM:
            self.beta[0], self.slope[0], self.fraction[0] = 0.0, 0.0, 1.0
            self.target[0] = FORCING * FORCING * rho
            self.products_here[0] = 0
            self.mode[0] = CONJUGATE if rho > 0.0 else DONE
        else:
            self.beta[0] = rho / self.rho[0]
            self.products_here[0] += 1
            if not (rho > self.target[0]) or self.products_here[0] == MAX_PRODUCTS:
                self.mode[0] = EVALUATE
                self.end_if_small(displacement, distance)
        self.rho[0] = rho

    @ti.func
    def end_if_small(self, displacement, distance):
        """Make a Newton step the last one if its displacement [m] is small or if steps no longer gain energy."""
        gain = self.slope[0]  # ½ d · r is the energy gained; in a stiff body a short step may gain much
        if self.iterations[0] == 1:
            self.resolution[0] = self.roundoff[0] * distance
            self.tolerance[0] = ti.max(self.resolution[0], self.accuracy[0] * displacement)
            self.largest_gain[0], self.least_gain[0], self.stagnant[0] = 0.0, 4.0 * gain, 0
        self.largest_gain[0] = ti.max(self.largest_gain[0], gain)
        gains_little = gain <= self.accuracy[0] ** 2 * self.largest_gain[0]
        is_short = displacement <= self.tolerance[0]
        ends = displacement <= self.resolution[0] or (is_short and gains_little) or self.stagnates(gain)
        if ends and self.iterations[0] > 1:  # the first is needed however short: a fall gains little in one step
            self.last_iteration[0] = self.iterations[0]
            for g in range(self.rigid.jellos):
                if not self.rigid.is_free(g, self.c[0]):
                    self.fraction[0] = 0.0  # in contact the last step would only add noise

    @ti.func
    def stagnates(self, gain):
        """Whether gains have stopped falling, as where rounding dominates or the force of a dashpot jumps."""
        if gain < 0.5 * self.least_gain[0]:
            self.least_gain[0], self.stagnant[0] = gain, 0
        else:
            self.stagnant[0] += 2 if gain <= NEAR_END * self.largest_gain[0] else 1
        return self.stagnant[0] >= MAX_STAGNANT
