"""How long the steps of the symplectic methods may be.

Linear theory allows √Λ dt up to 2 without damping. The network is not linear: a spring that passes zero length turns
round within a step, and each such passage errs by a little of either sign, about the spring's force times the way of a
step. The sum of the errors heats the network, by 2e-4 (√Λ dt)⁴ √Λ of its energy a second: the passages that a step
does not see are as rare as its way is short, squared, and so is what each adds. Measured on undamped cubes of 4³ that
are stretched, twisted or tangled, over a minute (√Λ = 1800 /s): 80 to 130 times the energy with √Λ dt = 0.8, 1.1 to
1.8 times with 0.4, up to 1.07 with 0.2 and 1.01 with 0.14. Smooth swings need less: stretched by 2 % and let go, the
energy stays above 0.98 with 0.8 and above 0.995 with 0.4.

So an undamped step is CALM while no jello is wild (see heat.py), and WILD while one is. That is decided by the
energy, which stays: so the step stays too, as it must for a symplectic method to feed no smooth swing. Dashpots take up
to λ = c/k Λ of the energy a second, and where that outruns the heating steps may be longer, as long as linear theory
allows.
"""

from dataclasses import replace
from math import sqrt

from taichi_jello.physics.integrators._base import Integrator

CALM = 0.75  # √Λ dt of an undamped step: 0.98 of the energy of a small swing
WILD = 0.125  # the same while springs may pass zero length: no more than 2 % of the energy in a minute
# Dashpots outrun the heating above if (√Λ dt)⁴ is this times c/k √Λ: its rate is then 1/200 of λ. Measured with c from
# 1 to 1e-4 of a cube's 0.25 N·s/m, from wild starts: with 25 no frame ends with more energy than the start, but by what
# symplectic Euler's energies swing; with 100 a few do, by 2 %; with 400, by 4 % to 38 times.
OUTRUN = 25.0


class Symplectic(Integrator):
    """A method whose automatic step is bounded by this."""

    safety = 0.95

    @classmethod
    def bound(cls, forces, drag):
        found = super().bound(forces, drag)
        if found.squared_frequency == 0.0:
            return found
        root = sqrt(found.squared_frequency)
        outrun = (OUTRUN * found.damping_time * root) ** 0.25
        calm, wild = (min(found.dt, max(least, outrun) / root) for least in (CALM, WILD))
        return replace(found, safety=found.safety * calm / found.dt, dt=calm, wild_dt=wild)
