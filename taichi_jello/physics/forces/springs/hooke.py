"""Hooke's force with a dashpot along the spring (workshop Eq. 3 and 4), gathered by each particle."""

from functools import cached_property

import numpy as np
import taichi as ti

from taichi_jello.physics.forces._base import ParticleForce, Rates, block, even_block
from taichi_jello.physics.forces.springs.packing import pack
from taichi_jello.physics.forces.springs.spring_state import strongest
from taichi_jello.physics.stable_step import largest_eigenvalue
from taichi_jello.physics.state import LANES

VECTORS = 16  # lanes of one inner loop: two vectors of 8, which LLVM unrolls and whose sums it keeps in registers


@ti.func
def hooke(inverse_length, stiffness, rest_length):
    """The factor s of Hooke's force F = s d towards a neighbour at distance d: k(|d| - R)/|d| (workshop Eq. 3)."""
    return stiffness * (1.0 - rest_length * inverse_length)


@ti.func
def dashpot(inverse_length, d, w, damping):
    """The factor s of the dashpot's force F = s d for a neighbour that moves at w [m/s] relative to the particle:
    c (w · n)/|d| with n = d/|d| (workshop Eq. 4). It acts along the spring only."""
    return damping * w.dot(d) * inverse_length * inverse_length


@ti.data_oriented
class Springs(ParticleForce):
    title = "springs"
    energy_kind = "elastic"
    in_passes = True
    couples = True

    def __init__(self, scene, particles):
        self.scene, self.body, memory = scene, particles.body, particles.memory
        apart = self.body.jello[self.body.springs[:, 0]] if any(jello.keyframe for jello in scene.jello) else None
        packed = pack(self.body, apart, single=any(jello.takes_its_own_shape for jello in scene.jello))
        # A distance too small to show beside any other makes a spring of no length push along its rest direction.
        tiny = 1e-15 if memory.owner.precision == "f32" else 1e-100
        packed.materials[:, 3:] *= tiny
        self.number, self.scales = memory.number, {"stiffness": 1.0, "damping": 1.0}
        self.written, self.example, self.single = packed.materials, packed.example, packed.single
        self.of_spring = packed.of_spring
        self.lasting = [self.body.stiffness, self.body.damping]
        self.damped = self.reads_velocity = bool(self.body.damping.any())
        self.works = ("dashpots",) if self.damped else ()
        self.lanes, self.Lanes = memory.lanes, memory.lane_vector
        for name in ("start", "entries", "materials"):
            setattr(self, name, memory.table(self.title, name, getattr(packed, name)))

    @classmethod
    def made_for(cls, scene, particles):
        return [cls(scene, particles)] if len(particles.body.springs) else []

    @ti.func
    def place(self, material, i):
        """Where the table `materials` has the material of particle i in an entry."""
        at = material
        if ti.static(self.single):
            at += i & (LANES - 1)
        return at

    @ti.func
    def along(self, material, i, j, x, v):
        """The force on particle i of its spring to j."""
        m = self.materials[self.place(material, i)]
        d = x[j] - x[i] + ti.Vector([m[3], m[4], m[5]])
        inverse_length = 1.0 / ti.sqrt(d.dot(d))
        s = hooke(inverse_length, m[0], m[1])
        if ti.static(self.damped):
            s += dashpot(inverse_length, d, v[j] - v[i], m[2])
        return s * d

    @ti.func
    def on(self, i, x, v, t):
        """The force on one particle."""
        total = ti.Vector([0.0, 0.0, 0.0])
        for e in range(self.start[i // LANES], self.start[i // LANES + 1]):
            entry = self.entries[e]
            if (entry[1] >> (i % LANES)) & 1:
                total += self.along(entry[2], i, i + entry[0], x, v)
        return total

    @ti.func
    def on_pass(self, first, last, x, v, t, f):
        """Set f to the spring forces on the particles first … last - 1. The loop over lanes has no branch and stores
        to local arrays only, so LLVM vectorises it; a particle without the spring adds zero."""
        fx, fy, fz = self.Lanes(0.0), self.Lanes(0.0), self.Lanes(0.0)
        for e in range(self.start[first // LANES], self.start[first // LANES + 1]):
            shift, mask, material = self.entries[e][0], self.entries[e][1], self.entries[e][2]
            for start in ti.static(range(0, self.lanes, VECTORS)):
                for lane in range(start, ti.static(min(start + VECTORS, self.lanes))):
                    i = first + lane
                    force = self.along(material, i, i + shift, x, v)
                    has = (mask >> ((first & (LANES - 1)) + lane)) & 1
                    fx[lane] += ti.select(has, force[0], 0.0)
                    fy[lane] += ti.select(has, force[1], 0.0)
                    fz[lane] += ti.select(has, force[2], 0.0)
        for i in range(first, last):
            f[i] = ti.Vector([fx[i - first], fy[i - first], fz[i - first]])

    @ti.func
    def across_and_along(self, m, inverse_length, c):
        """The two stiffnesses of one spring's H = across (I - nnᵀ) + along nnᵀ: k(1 - R/L) only where it is stretched,
        for across a compressed one it would be negative, and k + damping/c."""
        across, along = ti.max(0.0, hooke(inverse_length, m[0], m[1])), m[0]
        if ti.static(self.damped):
            along += m[2] / c
        return across, along

    @ti.func
    def resistance(self, material, i, j, x, p, c):
        """-H p of one spring on particle i."""
        m = self.materials[self.place(material, i)]
        d = x[j] - x[i] + ti.Vector([m[3], m[4], m[5]])
        u = p[j] - p[i]
        inverse_length = 1.0 / ti.sqrt(d.dot(d))
        across, along = self.across_and_along(m, inverse_length, c)
        return across * u + (along - across) * u.dot(d) * inverse_length * inverse_length * d

    @ti.func
    def hold(self, i, x, c):
        """The 3×3 block of H that particle i's springs put on itself, as `block` gives it."""
        total = even_block(ti.cast(0.0, float))
        for e in range(self.start[i // LANES], self.start[i // LANES + 1]):
            entry = self.entries[e]
            if (entry[1] >> (i % LANES)) & 1:
                m = self.materials[self.place(entry[2], i)]
                d = x[i + entry[0]] - x[i] + ti.Vector([m[3], m[4], m[5]])
                inverse_length = 1.0 / ti.sqrt(d.dot(d))
                across, along = self.across_and_along(m, inverse_length, c)
                total += block(across, along, inverse_length * d)
        return total

    @ti.func
    def resist_on_pass(self, first, last, x, p, c, q):
        """q += H p for the particles first … last - 1, vectorised as `on_pass` is."""
        fx, fy, fz = self.Lanes(0.0), self.Lanes(0.0), self.Lanes(0.0)
        for e in range(self.start[first // LANES], self.start[first // LANES + 1]):
            shift, mask, material = self.entries[e][0], self.entries[e][1], self.entries[e][2]
            for start in ti.static(range(0, self.lanes, VECTORS)):
                for lane in range(start, ti.static(min(start + VECTORS, self.lanes))):
                    i = first + lane
                    pull = self.resistance(material, i, i + shift, x, p, c)
                    has = (mask >> ((first & (LANES - 1)) + lane)) & 1
                    fx[lane] += ti.select(has, pull[0], 0.0)
                    fy[lane] += ti.select(has, pull[1], 0.0)
                    fz[lane] += ti.select(has, pull[2], 0.0)
        for i in range(first, last):
            q[i] = q[i] - ti.Vector([fx[i - first], fy[i - first], fz[i - first]])

    def pairs(self, c):
        """The ends (2, S) of the springs and k + damping/c [N/m] of each: in every configuration its H is no more."""
        stiffness, damping = self.lasting
        return self.body.springs.T, self.scales["stiffness"] * stiffness + self.scales["damping"] / c * damping

    def _lasting(self, law):
        """Stiffness and damping (S,) for `pairs`: the body's own, and where they are not, what they are or up to twice
        that, so that it changes seldom where they change all the time."""
        made = []
        for now, own in ((law.stiffness, self.body.stiffness), (law.damping, self.body.damping)):
            above = np.exp2(np.ceil(np.log2(np.maximum(now, 1e-300))))
            made.append(np.where(now == own, own, np.where(now > 0.0, above, 0.0)))
        return made

    @ti.func
    def energy(self, i, x, t):
        """Half of ½ k (|d| - R)² for each spring of particle i; its other end books the other half."""
        total = ti.cast(0.0, float)
        for e in range(self.start[i // LANES], self.start[i // LANES + 1]):
            entry = self.entries[e]
            if (entry[1] >> (i % LANES)) & 1:
                m = self.materials[self.place(entry[2], i)]
                stretch = (x[i + entry[0]] - x[i]).norm() - m[1]
                total += 0.25 * m[0] * stretch * stretch
        return total

    @ti.func
    def crushed(self, i):
        """The energy that its springs would have if they had no length."""
        total = ti.cast(0.0, float)
        for e in range(self.start[i // LANES], self.start[i // LANES + 1]):
            entry = self.entries[e]
            if (entry[1] >> (i % LANES)) & 1:
                m = self.materials[self.place(entry[2], i)]
                total += 0.25 * m[0] * m[1] * m[1]
        return total

    @ti.func
    def powers(self, i, x, v, t):
        """Half of -c (w · n)² for each spring of particle i; its other end books the other half."""
        total = ti.cast(0.0, float)
        for e in range(self.start[i // LANES], self.start[i // LANES + 1]):
            entry = self.entries[e]
            if (entry[1] >> (i % LANES)) & 1:
                m, j = self.materials[self.place(entry[2], i)], i + entry[0]
                d = x[j] - x[i] + ti.Vector([m[3], m[4], m[5]])
                along = (v[j] - v[i]).dot(d)
                total -= 0.5 * m[2] * along * along / d.dot(d)
        return ti.Vector([total])

    def tuning(self):
        return dict(self.scales) if self.damped else {"stiffness": self.scales["stiffness"]}

    def tune(self, name, value):
        """Scale all stiffnesses, or all dampings, of the scene by `value`."""
        self.scales[name] = float(value)
        self._write()

    def obey(self, law):
        """Let all springs be as `law` says (see spring_state.py), scaled as these are."""
        used = self.example >= 0
        which = self.example[used]
        for column, values in enumerate((law.stiffness, law.rest_length, law.damping)):
            self.written[used, column] = values[which]
        self._write()
        lasting = self._lasting(law)
        if not np.array_equal(lasting, self.lasting):
            self.lasting, self.generation = lasting, self.generation + 1

    def _write(self):
        scaled = self.written.copy()
        scaled[:, 0] *= self.scales["stiffness"]
        scaled[:, 2] *= self.scales["damping"]
        self.materials.from_numpy(scaled.astype(self.number))

    def rates(self):
        """The rates of the scene's own springs, scaled as these are."""
        stiffness, damping = self.scales["stiffness"], self.scales["damping"]
        own = self.own_rates
        time = own.damping_time * damping / stiffness if stiffness > 0.0 else np.inf
        return Rates(own.squared_frequency * stiffness, own.damping * damping, time)

    @cached_property
    def own_rates(self):
        """For every configuration a spring's stiffness matrix is at most k I and its damping matrix at most c I, so
        the weighted graph Laplacians of the network bound both, with the largest k and c that keyframes give."""
        body = self.body
        stiffness, damping, ratio = strongest(self.scene, body)
        stiff, damped = stiffness > 0.0, damping > 0.0
        inverse_mass = np.where(body.pinned, 0.0, 1.0 / body.mass)
        return Rates(
            squared_frequency=largest_eigenvalue(body.springs[stiff], stiffness[stiff], inverse_mass),
            damping=largest_eigenvalue(body.springs[damped], damping[damped], inverse_mass),
            damping_time=ratio,
        )
