"""Extended position-based dynamics with small steps: one pass over the springs in each (Macklin, Müller & Chentanez
2016; Macklin et al. 2019).

Particles first move freely under inertia and external forces, x̂ = x + dt v. Then each spring in turn corrects v by the
impulse J along n at x̂ with which backward Euler holds for this spring alone:

    J = dt [k (L - R) + c n·w] / [1 + dt (dt k + c)(1/mᵢ + 1/mⱼ)],    w = vⱼ - vᵢ.

That is the paper's Δλ with the compliance α = 1/k, in a form that allows k = 0 and k = ∞. J is equal and opposite, so
momentum is conserved. Velocities are corrected, not positions, so that none is a difference of rounded positions.
"""

from math import sqrt
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import MutualForce, even_block
from taichi_jello.physics.forces.springs.hooke import Springs, dashpot, hooke
from taichi_jello.physics.integrators._base import Integrator, oscillator_matrix, serial
from taichi_jello.physics.integrators.energy_limits.energy_budget import ATTEMPTS, Budget
from taichi_jello.physics.integrators.energy_limits.spin import Spin
from taichi_jello.physics.integrators.implicit_solve import ldl
from taichi_jello.physics.integrators.implicit_solve._implicit import solve_linear
from taichi_jello.physics.integrators.symplectic_euler import SymplecticEuler
from taichi_jello.physics.stable_step import Bound, largest_dt

SETTLE_ROUNDS = 2  # the first finds the contact pressure, the second the friction that belongs to it
MAX_AUTOMATIC_STEPS = 40  # in a frame, if only resolving the springs would require more
EXPLICIT_SAFETY = 0.7  # for the forces taken at the start of the step

Forces = tuple[Any, ...]


def colored(springs: np.ndarray, particles: int) -> np.ndarray:
    """(S,) a color for each of the springs (S, 2) such that no two of a color share a particle: the lowest that is free
    at both ends. A lattice needs two for each kind of spring."""
    taken = [0] * particles  # bit c: the particle has a spring of color c
    colors = []
    for i, j in springs.tolist():
        free = ~(taken[i] | taken[j])
        lowest = free & -free
        taken[i] |= lowest
        taken[j] |= lowest
        colors.append(lowest.bit_length() - 1)
    return np.array(colors, int)


def holding_and_pushing(forces: Forces) -> tuple[Forces, Forces]:
    """The forces that hold single particles: contact with colliders, friction, drag, the hand; and all others but
    springs. Those between particles push: taken at the start of the step they are equal and opposite."""
    holding = tuple(f for f in forces if f.has_curvature and not f.internal and not isinstance(f, MutualForce))
    return holding, tuple(f for f in forces if not isinstance(f, Springs) and f not in holding)


@ti.data_oriented
class XPBD(Integrator):
    """A step is: push; sweep over the springs color by color; correct the spin; limit the energy; settle; move.

    dt = "auto" resolves the springs, dt = 1/√Λ, if MAX_AUTOMATIC_STEPS a frame can. Where they cannot, springs stiffer
    than about m/dt² act as if they were no stiffer.
    """

    name, order = "xpbd", 1
    safety, passes, long_steps, adds_mass = 1.0, 1, True, False
    automatic = f"1/√Λ, but no more than {MAX_AUTOMATIC_STEPS} steps a frame"

    def allocate(self) -> None:
        self.parity = self.memory.table(self.name, "steps done, odd or even", np.zeros(1, np.int32))

    def use_forces(self, forces: Forces) -> None:
        memory = self.memory
        self.holding, self.pushing = holding_and_pushing(forces)
        self.springs: Any = next((f for f in forces if isinstance(f, Springs)), None)
        self.colors, parts = 0, [(self.push, 1)]  # and the number of stages of each
        if self.springs or self.holding:
            self.before = memory.vectors(self.name, "v before")
        if self.springs:
            self._list_springs(self.springs)
            spin = Spin(memory, self.body, self.state, self.before)
            self.budget = Budget(memory, self.body, self.springs, spin)
            parts += [(self.sweep, self.colors), (spin.correct, int(spin.wanted)), (self.budget.limit, ATTEMPTS)]
        if self.holding:
            parts.append((self.settle, SETTLE_ROUNDS))
            self.ahead, self.change = (memory.vectors(self.name, name) for name in ("x ahead", "change of v"))
        ends = np.cumsum([count for _, count in parts]).tolist()
        self.parts = tuple((part, end - n, end) for (part, n), end in zip(parts, ends, strict=True) if n)
        self.stages = ends[-1]

    def _list_springs(self, springs: Any) -> None:
        """Make a table of springs sorted by color, with both ends and the place of the material."""
        color = colored(self.body.springs, len(self.body))
        order = np.lexsort([self.body.springs[:, 0], color])
        rows = np.column_stack([self.body.springs, springs.of_spring])[order]
        self.list = self.memory.table(self.name, "springs by color", rows.astype(np.int32))
        starts = np.searchsorted(color[order], np.arange(color.max() + 2))
        self.start = self.memory.table(self.name, "starts of colors", starts.astype(np.int32))
        self.colors = len(starts) - 1

    def remembered(self) -> dict[str, np.ndarray]:
        return {"xpbd.turns": np.array(1)} if self.parity[0] else {}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        self.parity[0] = int("xpbd.turns" in memory)

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        for part, begin, end in ti.static(self.parts):
            if ti.static(system.team > 0):
                if begin <= s < end:
                    part(system, first, last, s - begin, t, dt)
            else:  # loops become parallel tasks only outside of any `if`: make them empty
                active = begin <= s < end
                part(system, first, ti.select(active, last, first), ti.select(active, s - begin, 0), t, dt)

    @ti.func
    def push(self, system, first, last, n, t, dt):
        """v += dt f/m with the forces at the start of the step."""
        system.wait_for_team()  # until x and v are complete
        if ti.static(self.colors > 0):
            self.budget.begin(system, first, last)
        self.prepare_for(self.pushing, system, first, last, self.state.x, t)
        for i in range(first, last):
            total = ti.Vector([0.0, 0.0, 0.0])
            for force in ti.static(self.pushing):
                total += force.on(i, self.state.x, self.state.v, t)
            self.state.v[i] = self.state.v[i] + dt * system.particles.inverse_mass(i) * total
            if ti.static(self.colors > 0):
                self.before[i] = self.state.v[i]

    @ti.func
    def sweep(self, system, first, last, n, t, dt):
        """The springs of color n, in every other step counted from the end: a fixed order would turn bodies."""
        system.wait_for_team()  # until the last color is complete
        color = ti.select(self.parity[0] == 0, n, self.colors - 1 - n)
        start = self.start[color]
        count = self.start[color + 1] - start
        for e in range(start + system.share_of(first, count), start + system.share_of(last, count)):
            self.project(system, self.list[e], dt)

    @ti.func
    def project(self, system, spring, dt):
        """Add the impulse J of one spring."""
        i, j, m = spring[0], spring[1], self.springs.materials[spring[2]]
        stiffness, rest_length, damping = m[0], m[1], m[2]
        w = self.state.v[j] - self.state.v[i]
        d = self.state.x[j] - self.state.x[i] + dt * w + ti.Vector([m[3], m[4], m[5]])
        inverse_length = 1.0 / ti.sqrt(d.dot(d))
        s, rate = hooke(inverse_length, stiffness, rest_length), dt * stiffness
        if ti.static(self.springs.damped):
            s += dashpot(inverse_length, d, w, damping)
            rate += damping
        self.budget.doubt(i, inverse_length * rest_length)
        a, b = system.particles.inverse_mass(i), system.particles.inverse_mass(j)
        impulse = dt * s / (1.0 + dt * rate * (a + b)) * d
        self.state.v[i] = self.state.v[i] + a * impulse
        self.state.v[j] = self.state.v[j] - b * impulse

    @ti.func
    def settle(self, system, first, last, n, t, dt):
        """A Newton step of m (v - v before)/dt = f(x + dt v, v) for each particle by itself."""
        system.wait_for_team()  # until v is complete
        for i in range(first, last):
            if n == 0:
                self.before[i] = self.state.v[i]
            self.ahead[i] = self.state.x[i] + dt * self.state.v[i]
        system.wait_for_team()
        self.prepare_for(self.holding, system, first, last, self.ahead, t + dt)
        for i in range(first, last):
            m = system.particles.mass(i)
            r = m / dt * (self.before[i] - self.state.v[i])
            B = even_block(m / (dt * dt))
            for force in ti.static(self.holding):
                r += force.on(i, self.ahead, self.state.v, t + dt)
                if ti.static(force.adds_mass):
                    r += force.on_held(i, self.ahead, self.state.v, t + dt)
                B += force.curvature(i, self.ahead, self.state.v, t + dt, dt)
            change = ldl.solve(B, r, self.memory.owner.epsilon)
            self.change[i] = system.particles.inverse_mass(i) * m / dt * change
        system.wait_for_team()  # until no thread needs the old v
        for i in range(first, last):
            self.state.v[i] = self.state.v[i] + self.change[i]

    @ti.func
    def prepare_for(self, forces: ti.template(), system, first, last, x, t):
        for force in ti.static(forces):
            if ti.static(force.prepares):
                begin, end = system.share_of(first, force.points), system.share_of(last, force.points)
                force.prepare(begin, end, x, self.state.v, t)
                system.wait_for_team()

    @ti.func
    def finish(self, system, first, last, t, dt):
        system.wait_for_team()  # until every thread has read the parity
        for i in range(first, last):
            self.state.x[i] = self.state.x[i] + dt * self.state.v[i]
        system.stop_at_solids(first, last, self.state.x, self.state.x, self.state.v, t, dt, True)
        if serial(first, last):
            self.parity[0] = 1 - self.parity[0]

    @classmethod
    def bound(cls, forces: Forces, drag: float) -> Bound:
        """Only the forces taken at the start of the step limit it."""
        found = super().bound(forces, drag)
        rates = [force.rates() for force in holding_and_pushing(forces)[1]]
        limit = largest_dt(SymplecticEuler.amplification, EXPLICIT_SAFETY, rates, 0.0).dt
        return Bound(found.squared_frequency, found.damping, cls.safety, limit)

    def automatic_dt(self, bound: Bound, frame_dt: float) -> float:
        resolved = 1.0 / sqrt(bound.squared_frequency) if bound.squared_frequency else np.inf
        return min(bound.dt, max(resolved, frame_dt / MAX_AUTOMATIC_STEPS))

    @classmethod
    def amplification(cls, a: np.ndarray, zeta: np.ndarray) -> np.ndarray:
        """For a single spring, where the method is backward Euler."""
        return oscillator_matrix(solve_linear, a, zeta)
