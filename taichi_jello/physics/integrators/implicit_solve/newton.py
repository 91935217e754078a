"""Newton's method for an implicit step, with preconditioned conjugate gradients for its linear systems.

The unknown is the velocity v at the end of the step: x = z + c v. The residual force on each particle is
r = m (w - v)/c + f(x, v). A displacement d = c Δv changes r by -H d, where H = M/c² + K + C/c, K = -∂f/∂x and
C = -∂f/∂v. Each force offers a symmetric positive semidefinite bound of its part of H (Springs.resist_on_pass,
ParticleForce.curvature): so conjugate gradients apply, and d is a descent direction. H is never stored.
"""

from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import even_block
from taichi_jello.physics.integrators._base import serial
from taichi_jello.physics.integrators.implicit_solve import progress
from taichi_jello.physics.integrators.implicit_solve.preconditioner import TwoLevel
from taichi_jello.physics.integrators.implicit_solve.rigid_modes import RigidModes, times
from taichi_jello.physics.state import Memory, State
from taichi_jello.scene.body import Body

NOTHING, RESIDUAL, STEP = range(3)  # what displaces particles in the sums


@ti.data_oriented
class Newton:
    """Fields and turns of one solve. `start` takes z, w and c; then `turn` is called until `mode` is DONE.

    accuracy: the solve ends when a step moves no particle farther than this fraction of the first step, or than the
    rounding of positions; to change it, call `prepare` afterwards.
    """

    kinds = (progress.LINEARISE, progress.EVALUATE, progress.CONJUGATE)

    def __init__(self, memory: Memory, body: Body):
        self.memory, self.accuracy = memory, 1e-3 if memory.owner.precision == "f32" else 1e-9
        self.at = State.made_in(memory, "solve")
        self.z, self.w, self.a, self.base = (memory.vectors("solve", name) for name in ("z", "w", "a", "v before"))
        self.r, self.d, self.p, self.q, self.s = (memory.vectors("solve", name) for name in "rdpqs")
        self.block = memory.vectors("solve", "block", 2)
        self.sums = memory.table("solve", "sums", np.zeros((memory.passes, 3)))
        self.preconditioner, self.rigid = TwoLevel(memory, body), RigidModes(memory, body)
        self.now = progress.Progress(memory, self.rigid)
        self.mode = self.now.mode

    def prepare(self, system: Any, c: float) -> None:
        """Call before the first step with this c [s], and again when a force has been tuned."""
        self.preconditioner.prepare(system, c)
        self.now.accuracy[0] = self.accuracy
        # Rounding x changes forces by Λ times that at most, and these displace the particle by c² times as much.
        self.now.roundoff[0] = 2.0 * system.owner.epsilon * min(1.0, c * c * system.bound.squared_frequency)

    @property
    def passes(self) -> int:
        """Evaluations of all springs until now: of their forces, or of a product with H."""
        return int(self.now.evaluations[0]) + int(self.now.products[0])

    # All threads of the team call every function below, each for its particles first … last - 1.

    @ti.func
    def start(self, system, first, last, c, t, solves=1):
        """Begin with a step from z by the motion at.v. Unless it `solves`, do nothing."""
        for i in range(first, last):
            if solves:
                self.p[i] = c * self.at.v[i]
                self.base[i] = ti.Vector([0.0, 0.0, 0.0])
                self.at.x[i] = self.z[i]
                self.set_block(i, even_block(system.particles.mass(i)))  # fits the rigid modes to p, weighted by mass
        system.wait_for_team()  # until every thread has seen the end of the last solve
        if serial(first, last):
            self.now.start(c, t, solves)
        system.wait_for_team()

    @ti.func
    def turn(self, kind: ti.template(), system, first, last):
        if ti.static(kind == progress.LINEARISE):
            self.linearise(system, first, last)
        elif ti.static(kind == progress.EVALUATE):
            self.evaluate(system, first, last)
        elif ti.static(kind == progress.CONJUGATE):
            self.conjugate(system, first, last)

    @ti.func
    def linearise(self, system, first, last):
        """Find the rigid modes for a new Newton step, or for the first."""
        self.rigid.begin(system, first, last, self.at.x, self.block)
        if serial(first, last):
            self.now.linearised()
        system.wait_for_team()

    @ti.func
    def evaluate(self, system, first, last):
        """Go this fraction of the step p, and find the residual there."""
        c, fraction = self.now.c[0], self.now.fraction[0]
        for i in range(first, last):
            self.at.x[i] = self.z[i] + c * self.base[i]
            self.q[i] = times(self.block, i, self.p[i])
        self.rigid.project(system, first, last, self.at.x, self.q)
        self.rigid.aim(system, first, last, fraction)
        for i in range(first, last):
            way, self.d[i] = self.rigid.way(i, self.at.x, self.p, fraction)
            self.at.v[i] = self.base[i] + way / c
            self.at.x[i] = self.z[i] + c * self.at.v[i]
        system.accelerations(first, last, self.at.x, self.at.v, self.now.time[0], self.a, True)
        for i in range(first, last):
            r = system.inertia(i) * ((self.w[i] - self.at.v[i]) / c + self.a[i])
            self.r[i] = r * (system.particles.inverse_mass(i) * system.particles.mass(i))  # zero if pinned
        self.add_up(system, first, last, self.d, self.r, RESIDUAL)
        if serial(first, last):
            slope, displacement, _ = self.total()
            self.now.judge(slope, displacement)
        system.wait_for_team()
        for i in range(first, last):
            if self.now.phase[0] == progress.ACCEPTED:
                self.base[i] = self.at.v[i]
                self.d[i] = ti.Vector([0.0, 0.0, 0.0])
                self.find_block(system, i)

    @ti.func
    def find_block(self, system, i):
        """The 3×3 block of H that couples particle i to no other: mass, contact, drag, the hand."""
        c = self.now.c[0]
        B = even_block(system.inertia(i) / (c * c))
        for force in ti.static(system.all_forces):
            if ti.static(force.has_curvature):
                B += force.curvature(i, self.at.x, self.at.v, self.now.time[0], c)
        self.set_block(i, B)
        if ti.static(self.preconditioner.by_blocks):
            for force in ti.static(system.all_forces):
                if ti.static(force.couples):
                    B += force.hold(i, self.at.x, c)
            self.preconditioner.set_block(i, B)

    @ti.func
    def set_block(self, i, B):
        self.block[0, i] = ti.Vector([B[0], B[1], B[2]])
        self.block[1, i] = ti.Vector([B[3], B[4], B[5]])

    @ti.func
    def conjugate(self, system, first, last):
        """One step of conjugate gradients for H d = r."""
        self.product(system, first, last, self.p, self.q)
        self.add_up(system, first, last, self.p, self.q, NOTHING)
        if serial(first, last):
            curvature, _, _ = self.total()
            self.now.conjugate(curvature)
        system.wait_for_team()
        alpha = self.now.alpha[0]
        for i in range(first, last):
            self.d[i] = self.d[i] + alpha * self.p[i]
            self.r[i] = self.r[i] - alpha * self.q[i]

    @ti.func
    def turn_ends(self, system, first, last):
        """Find the next direction p of conjugate gradients or the Newton step; or correct the momenta at the end."""
        iterates = self.now.phase[0] >= progress.NEW_SYSTEM and self.now.phase[0] <= progress.ITERATING
        converged = self.now.phase[0] == progress.CONVERGED
        end, end_correct = ti.select(iterates, last, first), ti.select(converged, last, first)  # or empty loops
        self.rigid.project(system, first, ti.max(end, end_correct), self.at.x, self.r)
        self.correct_momenta(system, first, end_correct)
        self.preconditioner.apply(system, first, end, self.r, self.s)
        for i in range(first, end):  # s = (Q + A⁻¹) r, see rigid_modes.py
            self.s[i] = self.s[i] + self.rigid.displacement(i, self.at.x)
        self.add_up(system, first, end, self.r, self.s, STEP)
        if serial(first, end):
            rho, displacement, distance = self.total()
            self.now.choose_direction(rho, displacement, distance)
        system.wait_for_team()
        beta, steps = self.now.beta[0], self.mode[0] == progress.EVALUATE
        for i in range(first, end):
            self.p[i] = self.d[i] if steps else self.s[i] + beta * self.p[i]

    @ti.func
    def correct_momenta(self, system, first, last):
        """Give each free jello the momentum and angular momentum that the residual implies. The rounding of spring
        forces hides it from the tolerance; neglected in every step it adds up to half a metre of a fall. Jellos in
        contact receive their momentum together if nothing else can touch them."""
        c = self.now.c[0]
        if ti.static(system.closed):
            if serial(first, last):
                self.rigid.join(c)
            system.wait_for_team()
        for i in range(first, last):
            if self.rigid.is_free(self.rigid.jello[i], c):
                self.at.v[i] = self.at.v[i] + self.rigid.displacement(i, self.at.x) / c
                self.at.x[i] = self.z[i] + c * self.at.v[i]
            elif ti.static(system.closed):
                self.at.v[i] = self.at.v[i] + self.rigid.joint_velocity[0]
                self.at.x[i] = self.z[i] + c * self.at.v[i]

    @ti.func
    def product(self, system, first, last, p, q):
        """q = H p."""
        system.wait_for_team()  # until p is complete
        c = self.now.c[0]
        for pass_ in range(first // system.lanes, (last + system.lanes - 1) // system.lanes):
            start = pass_ * system.lanes
            end = ti.min(start + system.lanes, last)
            for i in range(start, end):
                q[i] = times(self.block, i, p[i])
            for force in ti.static(system.all_forces):
                if ti.static(force.couples):
                    force.resist_on_pass(start, end, self.at.x, p, c, q)
            if ti.static(system.particles.pinned):
                for i in range(start, end):
                    q[i] = q[i] * system.particles.free[i]

    @ti.func
    def add_up(self, system, first, last, a, b, by: ti.template()):
        """For each pass of particles Σ a · b and the largest displacement, by the RESIDUAL alone or by the STEP d."""
        for pass_ in range(first // system.lanes, (last + system.lanes - 1) // system.lanes):
            dot, motion, distance = ti.cast(0.0, float), ti.cast(0.0, float), ti.cast(0.0, float)
            for i in range(pass_ * system.lanes, ti.min((pass_ + 1) * system.lanes, last)):
                dot += a[i].dot(b[i])
                if ti.static(by == RESIDUAL):
                    motion = ti.max(motion, self.r[i].norm() * self.now.c[0] ** 2 / system.particles.mass(i))
                elif ti.static(by == STEP):
                    motion = ti.max(motion, self.d[i].norm())
                    distance = ti.max(distance, self.at.x[i].norm())
            self.sums[pass_] = ti.Vector([dot, motion, distance])
        system.wait_for_team()

    @ti.func
    def total(self):
        """Σ a · b, the largest displacement, and the largest distance from the origin, over all passes."""
        dot, motion, distance = ti.cast(0.0, float), ti.cast(0.0, float), ti.cast(0.0, float)
        for pass_ in range(self.memory.passes):
            dot += self.sums[pass_][0]
            motion, distance = ti.max(motion, self.sums[pass_][1]), ti.max(distance, self.sums[pass_][2])
        return dot, motion, distance
