"""Springs and dashpots (workshop Eq. 3 and 4): each particle sums the forces of its own springs."""

from functools import cached_property
from typing import Any

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce, Rates, block, even_block
from taichi_jello.physics.forces.springs.packing import pack
from taichi_jello.physics.forces.springs.spring_state import SpringState, strongest
from taichi_jello.physics.particles import Particles
from taichi_jello.physics.stable_step import largest_eigenvalue
from taichi_jello.physics.state import LANES
from taichi_jello.scene.description import Scene

VECTORS = 16  # lanes of one inner loop: two vectors of 8, which LLVM unrolls and whose sums it keeps in registers
STIFFNESS, REST_LENGTH, DAMPING, DIRECTION = range(4)  # columns of the materials; the direction has three


@ti.func
def hooke(inverse_length, stiffness, rest_length):
    """The factor s of Hooke's force F = s d towards a neighbour at distance d: k(|d| - R)/|d| (workshop Eq. 3)."""
    return stiffness * (1.0 - rest_length * inverse_length)


@ti.func
def dashpot(inverse_length, d, w, damping):
    """The factor s of the dashpot's force F = s d for a neighbour that moves at w [m/s] relative to the particle:
    c (w · n)/|d| with n = d/|d| (workshop Eq. 4). It acts along the spring only."""
    return damping * w.dot(d) * inverse_length * inverse_length


@ti.func
def towards(m, i, j, x):
    """The vector from particle i to particle j; a spring of no length gets the direction that it has at rest."""
    return x[j] - x[i] + ti.Vector([m[DIRECTION], m[DIRECTION + 1], m[DIRECTION + 2]])


@ti.data_oriented
class Springs(ParticleForce):
    """All springs of the scene. The functions named `…_of` give the term of one spring of material m from particle i to
    particle j; y are velocities or displacements, h is the length of an implicit step."""

    title = "springs"
    energy_kind = "elastic"
    in_passes = True
    couples = internal = True

    def __init__(self, scene: Scene, particles: Particles):
        self.scene, self.body, memory = scene, particles.body, particles.memory
        apart = self.body.jello[self.body.springs[:, 0]] if any(jello.keyframe for jello in scene.jello) else None
        packed = pack(self.body, apart, single=any(jello.takes_its_own_shape for jello in scene.jello))
        # Added to d, a vector too short to change any other d gives a spring of no length a direction.
        packed.materials[:, DIRECTION:] *= 1e-15 if memory.owner.precision == "f32" else 1e-100
        self.number, self.scales = memory.number, {"stiffness": 1.0, "damping": 1.0}
        self.written, self.example, self.single = packed.materials, packed.example, packed.single
        self.of_spring = packed.of_spring
        self.bounds = [self.body.stiffness, self.body.damping]
        self.damped = self.reads_velocity = bool(self.body.damping.any())
        self.works = ("dashpots",) if self.damped else ()
        self.lanes, self.Lanes = memory.lanes, memory.lane_vector
        self.start = memory.table(self.title, "start", packed.start)
        self.entries = memory.table(self.title, "entries", packed.entries)
        self.materials = memory.table(self.title, "materials", packed.materials)

    @classmethod
    def made_for(cls, scene: Scene, particles: Particles) -> list["Springs"]:
        return [cls(scene, particles)] if len(particles.body.springs) else []

    @ti.func
    def place(self, material, i):
        """The row of `materials` for particle i of an entry."""
        at = material
        if ti.static(self.single):
            at += i & (LANES - 1)
        return at

    @ti.func
    def sum_over_springs(self, i, term: ti.template(), x, y, h, zero):
        """The sum of a term over particle i's springs."""
        total = zero
        for e in range(self.start[i // LANES], self.start[i // LANES + 1]):
            entry = self.entries[e]
            if (entry[1] >> (i % LANES)) & 1:
                total += term(self.materials[self.place(entry[2], i)], i, i + entry[0], x, y, h)
        return total

    @ti.func
    def sum_over_pass(self, first, last, force: ti.template(), x, y, h, f, subtract: ti.template()):
        """Set f to the spring forces on the particles first … last - 1 of one pass, or subtract them from it. The loop
        over lanes has no branch and stores to local arrays only, so LLVM vectorises it; a particle without the spring
        adds zero."""
        fx, fy, fz = self.Lanes(0.0), self.Lanes(0.0), self.Lanes(0.0)
        for e in range(self.start[first // LANES], self.start[first // LANES + 1]):
            shift, mask, material = self.entries[e][0], self.entries[e][1], self.entries[e][2]
            for start in ti.static(range(0, self.lanes, VECTORS)):
                for lane in range(start, ti.static(min(start + VECTORS, self.lanes))):
                    i = first + lane
                    pull = force(self.materials[self.place(material, i)], i, i + shift, x, y, h)
                    has = (mask >> ((first & (LANES - 1)) + lane)) & 1
                    fx[lane] += ti.select(has, pull[0], 0.0)
                    fy[lane] += ti.select(has, pull[1], 0.0)
                    fz[lane] += ti.select(has, pull[2], 0.0)
        for i in range(first, last):
            total = ti.Vector([fx[i - first], fy[i - first], fz[i - first]])
            f[i] = f[i] - total if ti.static(subtract) else total

    @ti.func
    def force_of(self, m, i, j, x, v, h):
        """The force [N] of one spring on particle i."""
        d = towards(m, i, j, x)
        inverse_length = 1.0 / ti.sqrt(d.dot(d))
        s = hooke(inverse_length, m[STIFFNESS], m[REST_LENGTH])
        if ti.static(self.damped):
            s += dashpot(inverse_length, d, v[j] - v[i], m[DAMPING])
        return s * d

    @ti.func
    def on(self, i, x, v, t):
        return self.sum_over_springs(i, self.force_of, x, v, 0.0, ti.Vector([0.0, 0.0, 0.0]))

    @ti.func
    def on_pass(self, first, last, x, v, t, f):
        self.sum_over_pass(first, last, self.force_of, x, v, 0.0, f, False)

    @ti.func
    def across_and_along(self, m, inverse_length, h):
        """The two stiffnesses of one spring's H = across (I - nnᵀ) + along nnᵀ: k(1 - R/L), zero for a compressed
        spring, for which it would be negative, and k + damping/h."""
        across, along = ti.max(0.0, hooke(inverse_length, m[STIFFNESS], m[REST_LENGTH])), m[STIFFNESS]
        if ti.static(self.damped):
            along += m[DAMPING] / h
        return across, along

    @ti.func
    def resistance_of(self, m, i, j, x, p, h):
        """-H p of one spring on particle i."""
        d, u = towards(m, i, j, x), p[j] - p[i]
        inverse_length = 1.0 / ti.sqrt(d.dot(d))
        across, along = self.across_and_along(m, inverse_length, h)
        return across * u + (along - across) * u.dot(d) * inverse_length * inverse_length * d

    @ti.func
    def resist_on_pass(self, first, last, x, p, h, q):
        self.sum_over_pass(first, last, self.resistance_of, x, p, h, q, True)

    @ti.func
    def block_of(self, m, i, j, x, y, h):
        d = towards(m, i, j, x)
        inverse_length = 1.0 / ti.sqrt(d.dot(d))
        across, along = self.across_and_along(m, inverse_length, h)
        return block(across, along, inverse_length * d)

    @ti.func
    def hold(self, i, x, h):
        return self.sum_over_springs(i, self.block_of, x, x, h, even_block(ti.cast(0.0, float)))

    def pairs(self, h: float) -> tuple[np.ndarray, np.ndarray]:
        """The ends (2, S) of the springs and k + damping/h [N/m] of each, which bounds H in every configuration."""
        stiffness, damping = self.bounds
        return self.body.springs.T, self.scales["stiffness"] * stiffness + self.scales["damping"] / h * damping

    @ti.func
    def energy_of(self, m, i, j, x, y, h):
        """Half of ½ k (|d| - R)²; the other end has the other half."""
        stretch = (x[j] - x[i]).norm() - m[REST_LENGTH]
        return 0.25 * m[STIFFNESS] * stretch * stretch

    @ti.func
    def energy(self, i, x, t):
        return self.sum_over_springs(i, self.energy_of, x, x, 0.0, ti.cast(0.0, float))

    @ti.func
    def crushed_energy_of(self, m, i, j, x, y, h):
        return 0.25 * m[STIFFNESS] * m[REST_LENGTH] * m[REST_LENGTH]

    @ti.func
    def crushed(self, i):
        """Particle i's half of the energy [J] that its springs would store at zero length."""
        return self.sum_over_springs(i, self.crushed_energy_of, 0.0, 0.0, 0.0, ti.cast(0.0, float))

    @ti.func
    def power_of(self, m, i, j, x, v, h):
        """Half of -c (w · n)²; the other end has the other half."""
        d = towards(m, i, j, x)
        along = (v[j] - v[i]).dot(d)
        return -0.5 * m[DAMPING] * along * along / d.dot(d)

    @ti.func
    def powers(self, i, x, v, t):
        return ti.Vector([self.sum_over_springs(i, self.power_of, x, v, 0.0, ti.cast(0.0, float))])

    def tuning(self) -> dict[str, Any]:
        return dict(self.scales) if self.damped else {"stiffness": self.scales["stiffness"]}

    def tune(self, name: str, value: Any) -> None:
        """Scale all stiffnesses, or all dampings, of the scene by `value`."""
        self.scales[name] = float(value)
        self._write()

    def set_state(self, state: SpringState) -> None:
        """Give all springs the numbers of `state`, times the scales of `tune`."""
        used = self.example >= 0
        for column, values in enumerate((state.stiffness, state.rest_length, state.damping)):
            self.written[used, column] = values[self.example[used]]
        self._write()
        # Bounds that change seldom where the springs change all the time: the scene's own number, or a power of two.
        bounds = []
        for now, own in ((state.stiffness, self.body.stiffness), (state.damping, self.body.damping)):
            above = np.exp2(np.ceil(np.log2(np.maximum(now, 1e-300))))
            bounds.append(np.where(now == own, own, np.where(now > 0.0, above, 0.0)))
        if not np.array_equal(bounds, self.bounds):
            self.bounds, self.generation = bounds, self.generation + 1

    def _write(self) -> None:
        scaled = self.written.copy()
        scaled[:, STIFFNESS] *= self.scales["stiffness"]
        scaled[:, DAMPING] *= self.scales["damping"]
        self.materials.from_numpy(scaled.astype(self.number))

    def rates(self) -> Rates:
        stiffness, damping, own = self.scales["stiffness"], self.scales["damping"], self.unscaled_rates
        time = own.damping_time * damping / stiffness if stiffness > 0.0 else np.inf
        return Rates(own.squared_frequency * stiffness, own.damping * damping, time)

    @cached_property
    def unscaled_rates(self) -> Rates:
        """In every configuration a spring's stiffness matrix is at most k I and its damping matrix at most c I, so the
        weighted graph Laplacians of the network bound both, with the largest k and c that keyframes give."""
        body = self.body
        stiffness, damping, ratio = strongest(self.scene, body)
        inverse_mass = np.where(body.pinned, 0.0, 1.0 / body.mass)
        squared_frequency, rate = (
            largest_eigenvalue(body.springs[weight > 0.0], weight[weight > 0.0], inverse_mass)
            for weight in (stiffness, damping)
        )
        return Rates(squared_frequency, rate, ratio)
