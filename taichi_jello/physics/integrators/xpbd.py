"""Extended position-based dynamics in small steps (Macklin, Müller & Chentanez 2016; Macklin et al. 2019): one pass
over the springs a step.

A step moves every particle on by inertia and the forces from outside, x̂ = x + dt v, then corrects v spring by spring,
each by the impulse J along n at x̂ after which backward Euler holds for this spring alone:

    J = dt [k (L - R) + c n·w] / [1 + dt (dt k + c)(1/mᵢ + 1/mⱼ)],    w = vⱼ - vᵢ,

which is the paper's Δλ with the compliance α = 1/k, α/dt² and its damping, written so that k = 0 and k = ∞ are no
exceptions. J is equal and opposite: no momentum is made. Positions stay at the step's beginning and velocities are what
is corrected, so that no velocity is a difference of rounded positions.
"""

from math import sqrt

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import MutualForce
from taichi_jello.physics.forces.springs.hooke import dashpot, hooke
from taichi_jello.physics.integrators._base import Integrator, oscillator_matrix
from taichi_jello.physics.integrators.energy_limits.energy_budget import TRIES, Budget
from taichi_jello.physics.integrators.energy_limits.spin import Spin, solve_spd
from taichi_jello.physics.integrators.implicit_solve._implicit import solved
from taichi_jello.physics.integrators.symplectic_euler import SymplecticEuler
from taichi_jello.physics.stable_step import largest_dt

ROUNDS = 2  # of what holds single particles: the first finds the pressure, the second the friction that goes with it
MOST = 40  # steps a frame that dt = "auto" takes at most where only resolving the springs would ask for more
EXPLICIT_SAFETY = 0.7  # of the limit of what is taken where the step begins


def colored(springs: np.ndarray, particles: int) -> np.ndarray:
    """(S,) a color for each of the springs (S, 2), so that no two of a color share a particle: the lowest that neither
    end has yet. In a lattice, two for each kind of spring."""
    taken = [0] * particles  # bit c: the particle has a spring of color c
    colors = []
    for i, j in springs.tolist():
        free = ~(taken[i] | taken[j])
        lowest = free & -free
        taken[i] |= lowest
        taken[j] |= lowest
        colors.append(lowest.bit_length() - 1)
    return np.array(colors, int)


@ti.data_oriented
class XPBD(Integrator):
    """Its stages: `push` by forces that are taken where the step begins; a pass over the springs, color by color, from
    the first to the last in one step and from the last to the first in the next, since a fixed order turns bodies;
    ROUNDS of `settle`, implicit for each particle alone, by the forces that hold single particles: contact with
    colliders, friction, drag, the hand.

    dt = "auto" resolves the springs, dt = 1/√Λ, if MOST steps a frame can. Where they cannot, springs stiffer than
    about m/dt² move as if they were no stiffer.
    """

    name, order = "xpbd", 1
    safety, passes, long_steps, loads = 1.0, 1, True, False
    automatic = f"1/√Λ, but no more than {MOST} steps a frame"

    def __init__(self, memory, state, damped, body):
        self.memory, self.state, self.body = memory, state, body
        self.turns = memory.table(self.name, "steps done, odd or even", np.zeros(1, np.int32))

    def meet(self, forces):
        # A force between particles is taken where the step begins, equal and opposite, to keep the momentum.
        self.holding = tuple(f for f in forces if f.has_curvature and not isinstance(f, MutualForce))
        self.pushing = tuple(f for f in forces if not f.couples and f not in self.holding)
        self.springs = next((f for f in forces if f.couples), None)
        self.colors = self._list_springs() if self.springs else 0
        self.spin = Spin(self.memory, self.body) if self.springs else None
        self.turns_by_mistake = self.spin is not None and self.spin.wanted
        self.budget = Budget(self.memory, self.body, self.springs, self.spin) if self.springs else None
        self.limits = 1 + self.colors + self.turns_by_mistake  # the first stage of limiting
        self.settles = self.limits + (TRIES if self.springs else 0)  # the first stage of settling
        self.stages = self.settles + (ROUNDS if self.holding else 0)
        if self.springs or self.holding:
            self.before = self.memory.vectors(self.name, "v before")
        if self.holding:
            self.ahead, self.change = (self.memory.vectors(self.name, name) for name in ("x ahead", "change of v"))

    def _list_springs(self):
        """Make the table of springs, sorted by color: both ends and where the force has the material."""
        color = colored(self.body.springs, len(self.body))
        order = np.lexsort([self.body.springs[:, 0], color])
        rows = np.column_stack([self.body.springs, self.springs.of_spring])[order]
        self.list = self.memory.table(self.name, "springs by color", rows.astype(np.int32))
        starts = np.searchsorted(color[order], np.arange(color.max() + 2))
        self.start = self.memory.table(self.name, "starts of colors", starts.astype(np.int32))
        return int(color.max()) + 1

    def remembered(self):
        return {"xpbd.turns": np.array(1)} if self.turns[0] else {}

    def recall(self, memory):
        self.turns[0] = int("xpbd.turns" in memory)

    @ti.func
    def stage(self, system, first, last, s, t, dt):
        if ti.static(system.team > 0):
            if s == 0:
                self.push(system, first, last, t, dt)
            if ti.static(self.colors > 0):
                if 0 < s <= self.colors:
                    self.sweep(system, first, last, s - 1, dt)
            if ti.static(self.turns_by_mistake):
                if s == self.colors + 1:
                    self.spin.correct(system, first, last, self.state.x, self.state.v, self.before)
            if ti.static(self.colors > 0):
                if self.limits <= s < self.settles:
                    self.limit(system, first, last, s - self.limits, dt)
            if ti.static(len(self.holding) > 0):
                if s >= self.settles:
                    self.settle(system, first, last, s == self.settles, t + dt, dt)
        else:  # loops become parallel tasks only where no `if` is around them
            self.push(system, first, ti.select(s == 0, last, first), t, dt)
            if ti.static(self.colors > 0):
                swept = 0 < s <= self.colors
                self.sweep(system, first, ti.select(swept, last, first), ti.select(swept, s - 1, 0), dt)
            if ti.static(self.turns_by_mistake):
                corrected = ti.select(s == self.colors + 1, last, first)
                self.spin.correct(system, first, corrected, self.state.x, self.state.v, self.before)
            if ti.static(self.colors > 0):
                limited = ti.select(self.limits <= s < self.settles, last, first)
                self.limit(system, first, limited, s - self.limits, dt)
            if ti.static(len(self.holding) > 0):
                settled = ti.select(s >= self.settles, last, first)
                self.settle(system, first, settled, s == self.settles, t + dt, dt)

    @ti.func
    def push(self, system, first, last, t, dt):
        """v += dt f/m of the forces at the step's beginning."""
        system.wait_for_team()  # until x and v of all particles are there
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
    def sweep(self, system, first, last, c, dt):
        """The springs of color c, or in every other step of the c-th color from the end."""
        system.wait_for_team()  # until the colors before are done
        color = ti.select(self.turns[0] == 0, c, self.colors - 1 - c)
        start = self.start[color]
        count = self.start[color + 1] - start
        share = ti.cast(count, ti.i64)
        from_ = start + ti.cast(first * share // system.count, ti.i32)
        to = start + ti.cast(last * share // system.count, ti.i32)
        for e in range(from_, to):
            self.project(system, self.list[e], dt)

    @ti.func
    def project(self, system, spring, dt):
        """The impulse of one spring."""
        i, j, m = spring[0], spring[1], self.springs.materials[spring[2]]
        w = self.state.v[j] - self.state.v[i]
        d = self.state.x[j] - self.state.x[i] + dt * w + ti.Vector([m[3], m[4], m[5]])
        inverse_length = 1.0 / ti.sqrt(d.dot(d))
        s, rate = hooke(inverse_length, m[0], m[1]), dt * m[0]
        if ti.static(self.springs.damped):
            s += dashpot(inverse_length, d, w, m[2])
            rate += m[2]
        self.budget.doubt(i, inverse_length * m[1])
        a, b = system.particles.inverse_mass(i), system.particles.inverse_mass(j)
        impulse = dt * s / (1.0 + dt * rate * (a + b)) * d
        self.state.v[i] = self.state.v[i] + a * impulse
        self.state.v[j] = self.state.v[j] - b * impulse

    @ti.func
    def limit(self, system, first, last, n, dt):
        """Try n of keeping within the budget of energy."""
        self.budget.limit(system, first, last, self.state.x, self.state.v, self.before, dt, n)

    @ti.func
    def settle(self, system, first, last, anew, t, dt):
        """A Newton step of m (v - v before)/dt = f(x + dt v, v) for every particle by itself."""
        system.wait_for_team()  # until v of all particles is there
        for i in range(first, last):
            if anew:
                self.before[i] = self.state.v[i]
            self.ahead[i] = self.state.x[i] + dt * self.state.v[i]
        system.wait_for_team()
        self.prepare_for(self.holding, system, first, last, self.ahead, t)
        for i in range(first, last):
            m = system.particles.mass(i)
            r = m / dt * (self.before[i] - self.state.v[i])
            b = ti.Vector([m, m, m, 0.0, 0.0, 0.0]) / (dt * dt)
            for force in ti.static(self.holding):
                r += force.on(i, self.ahead, self.state.v, t)
                if ti.static(force.adds_mass):
                    r += force.on_held(i, self.ahead, self.state.v, t)
                b += force.curvature(i, self.ahead, self.state.v, t, dt)
            self.change[i] = system.particles.inverse_mass(i) * m / dt * solve_spd(b, r)
        system.wait_for_team()  # until nobody needs v any more
        for i in range(first, last):
            self.state.v[i] = self.state.v[i] + self.change[i]

    @ti.func
    def prepare_for(self, forces: ti.template(), system, first, last, x, t):
        for force in ti.static(forces):
            if ti.static(force.prepares):
                from_, to = system.share_of(first, force.points), system.share_of(last, force.points)
                force.prepare(from_, to, x, self.state.v, t)
                system.wait_for_team()

    @ti.func
    def finish(self, system, first, last, t, dt):
        system.wait_for_team()  # until nobody needs to know which way the pass goes
        for i in range(first, last):
            self.state.x[i] = self.state.x[i] + dt * self.state.v[i]
        system.stop_at_solids(first, last, self.state.x, self.state.x, self.state.v, t, dt, True)
        for _ in range(1):
            if first == 0 and last > 0:
                self.turns[0] = 1 - self.turns[0]

    def bound(self, forces, drag):
        """The springs and what holds single particles bound nothing; what is taken explicitly does."""
        found = super().bound(forces, drag)
        rates = [force.rates() for force in self.pushing]
        limit = largest_dt(SymplecticEuler.amplification, EXPLICIT_SAFETY, rates, 0.0).dt
        return type(found)(found.squared_frequency, found.damping, self.safety, limit)

    def automatic_dt(self, bound, frame_dt):
        resolved = 1.0 / sqrt(bound.squared_frequency) if bound.squared_frequency else np.inf
        return min(bound.dt, max(resolved, frame_dt / MOST))

    @classmethod
    def amplification(cls, a, zeta):
        """Of one spring; then it is backward Euler."""
        return oscillator_matrix(solved, a, zeta)
