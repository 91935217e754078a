"""Newton's method for an implicit step, each linear system by preconditioned conjugate gradients without a matrix.

The unknown is the velocity v at the end of the step: x = z + c v, and the residual force of every particle is
r = m (w - v)/c + f(x, v). A displacement d = c Δv changes r by -H d with H = M/c² + K + C/c, where K = -∂f/∂x and
C = -∂f/∂v. Every force offers a symmetric, never negative bound of its share of H (Springs.resist_on_pass, and
ParticleForce.curvature for the rest), so that conjugate gradients apply and d always leads downhill.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import even_block
from taichi_jello.physics.integrators.implicit_solve.preconditioner import TwoLevel
from taichi_jello.physics.integrators.implicit_solve.rigid_modes import Rigid, times
from taichi_jello.physics.state import State

DONE, PREPARE, EVALUATE, CONJUGATE = range(4)
OFF, THERE, BEGIN, GO_ON, BACK, AT_REST = range(6)  # phases: what a turn has found out, in an order that is asked for
# What the registers hold; every member of a team reads them, the first one writes.
C, TIME, RHO, SLOPE, PART, ALPHA, BETA, TOLERANCE, STOP_AT, NOISE, STILL, GAIN, LEAST, ACCURACY, MOST = range(15)
NOTHING, RESIDUAL, STEP = range(3)  # what is looked for beside a sum
ROUNDS, INNER, TRIES, PHASE, VAIN, EVALUATIONS, PRODUCTS = range(7)

TRIED = 6  # times that a step may be shortened
VAINLY = 8  # rounds, none with half the gain of all before, after which it ends; half as many where the answer is near:
CLOSE = 1e-4  # of the most that a round has gained, so within 1 % of the way there
OVERSHOOT = 0.5  # of the slope at the start, by which it may have turned around where a step ends


@ti.data_oriented
class Newton:
    """Fields and turns of one solve. `start` is given z, w and c; then `turn` is repeated until `mode` is DONE.

    accuracy: it ends when a step moves no particle farther than this part of the first step, or than positions are
    rounded; it may be changed before `prepare`. forcing: by how much conjugate gradients reduce the residual before
    Newton goes on. rounds and inner: the most Newton steps, and products with H for each.
    """

    kinds = (PREPARE, EVALUATE, CONJUGATE)

    def __init__(self, memory, body, accuracy, forcing=0.1, rounds=30, inner=200):
        self.memory, self.accuracy, self.forcing = memory, accuracy, forcing
        self.rounds, self.inner = rounds, inner
        self.at = State.made_in(memory, "solve")
        self.z, self.w, self.a = (memory.vectors("solve", name) for name in "zwa")
        self.r, self.d, self.p, self.q, self.s, self.base = (
            memory.vectors("solve", name) for name in ("r", "d", "p", "q", "s", "v before")
        )
        self.block = memory.vectors("solve", "block", 2)
        self.sums = memory.table("solve", "sums", np.zeros((memory.passes, 3)))
        self.mode = memory.table("solve", "mode", np.zeros(1, np.int32))
        self.counts = memory.table("solve", "counts", np.zeros(7, np.int32))
        self.registers = memory.table("solve", "registers", np.zeros(15))
        self.inner_solver = TwoLevel(memory, body)
        self.rigid = Rigid(memory, body)

    def prepare(self, system, c):
        """Before the first step with this c [s], and again when a force has been tuned."""
        self.inner_solver.prepare(system, c)
        # A rounding of x changes forces by Λ of it at most, and these move the particle by c² of that, or back.
        stiffness = system.bound.squared_frequency
        self.registers[ACCURACY] = self.accuracy
        self.registers[NOISE] = 2.0 * system.owner.epsilon * min(1.0, c * c * stiffness)

    @property
    def passes(self) -> int:
        """How often it has gone through all springs until now: for their forces, or for a product with H."""
        return int(self.counts[EVALUATIONS]) + int(self.counts[PRODUCTS])

    # Every function below is called by all members of a team, each for its particles first … last - 1.

    @ti.func
    def start(self, system, first, last, c, t, wanted=1):
        """Begin with a step from z by the motion at.v; z and w are set. Not `wanted`: there is nothing to solve."""
        for i in range(first, last):
            if wanted:
                self.p[i] = c * self.at.v[i]
                self.base[i] = ti.Vector([0.0, 0.0, 0.0])
                self.at.x[i] = self.z[i]
                self.set_block(i, even_block(system.particles.mass(i)))  # its modes fit p best, by mass
        system.wait_for_team()  # until everybody has seen that the solve before is done
        for _ in range(1):
            if first == 0 and last > 0:
                self.registers[C], self.registers[TIME] = c, t
                self.registers[PART], self.registers[MOST] = 1.0, self.rounds
                self.counts[ROUNDS], self.counts[PHASE] = 0, OFF
                self.counts[TRIES] = TRIED  # however this step turns out, it is the start
                self.mode[0] = PREPARE if wanted else DONE
        system.wait_for_team()

    @ti.func
    def turn(self, kind: ti.template(), system, first, last):
        if ti.static(kind == PREPARE):
            self.prepare_modes(system, first, last)
        elif ti.static(kind == EVALUATE):
            self.evaluate(system, first, last)
        elif ti.static(kind == CONJUGATE):
            self.conjugate(system, first, last)

    @ti.func
    def prepare_modes(self, system, first, last):
        """For a new Newton step, or for the step that it all starts with."""
        self.rigid.begin(system, first, last, self.at.x, self.block)
        for _ in range(1):
            if first == 0 and last > 0:
                if self.counts[PHASE] == OFF:
                    self.mode[0] = EVALUATE
                else:
                    self.counts[PHASE] = BEGIN
        system.wait_for_team()

    @ti.func
    def evaluate(self, system, first, last):
        """Go PART of the step p. Was that too far, it is a smaller part next; else on with conjugate gradients."""
        c = self.registers[C]
        for i in range(first, last):
            self.at.x[i] = self.z[i] + c * self.base[i]
            self.q[i] = times(self.block, i, self.p[i])
        self.rigid.project(system, first, last, self.at.x, self.q)
        self.rigid.aim(system, first, last, self.registers[PART])
        for i in range(first, last):
            way, self.d[i] = self.rigid.way(i, self.at.x, self.p, self.registers[PART])
            self.at.v[i] = self.base[i] + way / c
            self.at.x[i] = self.z[i] + c * self.at.v[i]
        system.accelerations(first, last, self.at.x, self.at.v, self.registers[TIME], self.a, True)
        for i in range(first, last):
            r = system.inertia(i) * ((self.w[i] - self.at.v[i]) / c + self.a[i])
            self.r[i] = r * (system.particles.inverse_mass(i) * system.particles.mass(i))  # none on a pinned one
        self.add_up(system, first, last, self.d, self.r, RESIDUAL)
        for _ in range(1):
            if first == 0 and last > 0:
                self.judge(system)
        system.wait_for_team()
        for i in range(first, last):
            if self.counts[PHASE] == THERE:
                self.base[i] = self.at.v[i]
                self.d[i] = ti.Vector([0.0, 0.0, 0.0])
                self.own_curvature(system, i)

    @ti.func
    def judge(self, system):
        """It is THERE for a new Newton step, goes BACK to a PART of the last, or is AT_REST: this is the answer."""
        here, before = self.total(0), self.registers[PART] * self.registers[SLOPE]
        farthest = self.largest(1)
        self.counts[EVALUATIONS] += 1
        self.counts[PHASE] = THERE
        if here < -OVERSHOOT * before and self.counts[TRIES] < TRIED:
            self.counts[PHASE] = BACK
            self.counts[TRIES] += 1
            # To where the slope would be zero, were it linear.
            self.registers[PART] *= ti.min(0.6, ti.max(0.1, before / (before - here)))
        elif (
            farthest == 0.0
            or not farthest < 1e30
            or self.counts[ROUNDS] >= self.registers[MOST]
            or (self.counts[ROUNDS] > 0 and farthest <= self.registers[TOLERANCE])
        ):
            self.counts[PHASE] = AT_REST
            self.mode[0] = DONE
        else:
            self.counts[ROUNDS] += 1
            self.counts[TRIES] = 0
            self.mode[0] = PREPARE

    @ti.func
    def own_curvature(self, system, i):
        """The 3×3 block of H that ties particle i to nothing else: its mass, contact, drag, the hand."""
        c = self.registers[C]
        B = even_block(system.inertia(i) / (c * c))
        for force in ti.static(system.all_forces):
            if ti.static(force.has_curvature):
                B += force.curvature(i, self.at.x, self.at.v, self.registers[TIME], c)
        self.set_block(i, B)
        if ti.static(self.inner_solver.by_blocks):
            for force in ti.static(system.in_passes):
                if ti.static(force.couples):
                    B += force.hold(i, self.at.x, c)
            self.inner_solver.factor(system, i, B)

    @ti.func
    def set_block(self, i, B):
        self.block[0, i] = ti.Vector([B[0], B[1], B[2]])
        self.block[1, i] = ti.Vector([B[3], B[4], B[5]])

    @ti.func
    def conjugate(self, system, first, last):
        """One step of conjugate gradients for H d = r."""
        self.product(system, first, last, self.p, self.q)
        self.add_up(system, first, last, self.p, self.q, NOTHING)
        for _ in range(1):
            if first == 0 and last > 0:
                alpha = self.registers[RHO] / self.total(0)
                self.registers[ALPHA] = alpha
                self.registers[SLOPE] += alpha * self.registers[RHO]  # d · r at the start of the step
                self.counts[PRODUCTS] += 1
                self.counts[PHASE] = GO_ON
        system.wait_for_team()
        alpha = self.registers[ALPHA]
        for i in range(first, last):
            self.d[i] = self.d[i] + alpha * self.p[i]
            self.r[i] = self.r[i] - alpha * self.q[i]

    @ti.func
    def turn_ends(self, system, first, last):
        """What turns end with: the next direction p of conjugate gradients, the step to go, or at rest what is left to
        move as a whole."""
        directs = self.counts[PHASE] >= BEGIN and self.counts[PHASE] <= GO_ON
        rests = self.counts[PHASE] == AT_REST
        upto, settled = ti.select(directs, last, first), ti.select(rests, last, first)  # a loop to `first` does nothing
        self.rigid.project(system, first, ti.max(upto, settled), self.at.x, self.r)
        self.settle(system, first, settled)
        self.inner_solver.apply(system, first, upto, self.r, self.s)
        for i in range(first, upto):  # s = (Q + A⁻¹) r, see rigid_modes.py
            self.s[i] = self.s[i] + self.rigid.displacement(i, self.at.x)
        self.add_up(system, first, upto, self.r, self.s, STEP)
        for _ in range(1):
            if first == 0 and upto > 0:
                self.choose_direction(system)
        system.wait_for_team()
        beta, steps = self.registers[BETA], self.mode[0] == EVALUATE
        for i in range(first, upto):
            self.p[i] = self.d[i] if steps else self.s[i] + beta * self.p[i]

    @ti.func
    def settle(self, system, first, last):
        """Give each jello the momentum and angular momentum that the residual still asks for: rounded springs hide it
        from the tolerances, and left out of every step it adds up to half a metre of a fall. Those that touch each
        other, where nothing else can be touched, are given their momentum together."""
        c = self.registers[C]
        if ti.static(system.closed):
            for _ in range(1):
                if first == 0 and last > 0:
                    self.rigid.join(c)
            system.wait_for_team()
        for i in range(first, last):
            if self.rigid.is_free(self.rigid.group[i], c):
                self.at.v[i] = self.at.v[i] + self.rigid.displacement(i, self.at.x) / c
                self.at.x[i] = self.z[i] + c * self.at.v[i]
            elif ti.static(system.closed):
                self.at.v[i] = self.at.v[i] + self.rigid.together[0]
                self.at.x[i] = self.z[i] + c * self.at.v[i]

    @ti.func
    def choose_direction(self, system):
        rho = self.total(0)
        if self.counts[PHASE] == BEGIN:
            self.registers[BETA], self.registers[SLOPE], self.registers[PART] = 0.0, 0.0, 1.0
            self.registers[STOP_AT] = self.forcing * self.forcing * rho
            self.counts[INNER] = 0
            self.mode[0] = CONJUGATE if rho > 0.0 else DONE
        else:
            self.registers[BETA] = rho / self.registers[RHO]
            self.counts[INNER] += 1
            if not (rho > self.registers[STOP_AT]) or self.counts[INNER] == self.inner:
                moved = self.largest(1)
                if self.counts[ROUNDS] == 1:
                    noise = self.registers[NOISE] * self.largest(2)
                    self.registers[TOLERANCE] = ti.max(noise, self.registers[ACCURACY] * moved)
                    self.registers[STILL], self.registers[GAIN] = noise, 0.0
                    self.registers[LEAST], self.counts[VAIN] = 4.0 * self.registers[SLOPE], 0
                # What the step gains is ½ d · r; a stiff body stores much in a short way.
                self.registers[GAIN] = ti.max(self.registers[GAIN], self.registers[SLOPE])
                little = self.registers[SLOPE] <= self.registers[ACCURACY] ** 2 * self.registers[GAIN]
                near = moved <= self.registers[TOLERANCE]
                ends = moved <= self.registers[STILL] or (near and little) or self.in_vain()
                # The first step is gone however short: a fall gains little in a short one, and must gain it.
                self.mode[0] = EVALUATE
                if ends and self.counts[ROUNDS] > 1:
                    self.end()
        self.registers[RHO] = rho

    @ti.func
    def end(self):
        """The step to go is the last one; where jellos touch nothing of it is gone, it would be noise."""
        self.registers[MOST] = self.counts[ROUNDS]
        for g in range(self.rigid.jellos):
            if not self.rigid.is_free(g, self.registers[C]):
                self.registers[PART] = 0.0

    @ti.func
    def in_vain(self):
        """Whether rounds no longer gain less and less, as where rounding stops them, or a dashpot that begins to press
        with a jump of its force."""
        if self.registers[SLOPE] < 0.5 * self.registers[LEAST]:
            self.registers[LEAST], self.counts[VAIN] = self.registers[SLOPE], 0
        else:
            self.counts[VAIN] += 2 if self.registers[SLOPE] <= CLOSE * self.registers[GAIN] else 1
        return self.counts[VAIN] >= VAINLY

    @ti.func
    def product(self, system, first, last, p, q):
        """q = H p."""
        system.wait_for_team()  # until p is there
        c = self.registers[C]
        for pass_ in range(first // system.lanes, (last + system.lanes - 1) // system.lanes):
            start = pass_ * system.lanes
            end = ti.min(start + system.lanes, last)
            for i in range(start, end):
                q[i] = times(self.block, i, p[i])
            for force in ti.static(system.in_passes):
                if ti.static(force.couples):
                    force.resist_on_pass(start, end, self.at.x, p, c, q)
            if ti.static(system.particles.pinned):
                for i in range(start, end):
                    q[i] = q[i] * system.particles.free[i]

    @ti.func
    def add_up(self, system, first, last, a, b, beside: ti.template()):
        """For every pass of particles Σ a · b; beside it NOTHING, how far the RESIDUAL alone would move one at most, or
        how far the STEP d moves one at most and how far from the origin one is."""
        for pass_ in range(first // system.lanes, (last + system.lanes - 1) // system.lanes):
            dot, most, away = ti.cast(0.0, float), ti.cast(0.0, float), ti.cast(0.0, float)
            for i in range(pass_ * system.lanes, ti.min((pass_ + 1) * system.lanes, last)):
                dot += a[i].dot(b[i])
                if ti.static(beside == RESIDUAL):
                    most = ti.max(most, self.r[i].norm() * self.registers[C] ** 2 / system.particles.mass(i))
                elif ti.static(beside == STEP):
                    most = ti.max(most, self.d[i].norm())
                    away = ti.max(away, self.at.x[i].norm())
            self.sums[pass_] = ti.Vector([dot, most, away])
        system.wait_for_team()

    @ti.func
    def total(self, column):
        total = ti.cast(0.0, float)
        for pass_ in range(self.memory.passes):
            total += self.sums[pass_][column]
        return total

    @ti.func
    def largest(self, column):
        most = ti.cast(0.0, float)
        for pass_ in range(self.memory.passes):
            most = ti.max(most, self.sums[pass_][column])
        return most
