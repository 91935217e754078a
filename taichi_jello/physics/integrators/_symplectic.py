"""How long the steps of the symplectic methods may be.

Linear theory allows √Λ dt up to 2 without damping. But a spring that passes through zero length turns round within a
step, and each passage makes an error of either sign, about the spring's force times the distance moved in a step.
These errors heat the network by 2e-4 (√Λ dt)⁴ √Λ of its energy a second. The energy of undamped cubes of 4³ particles
that start stretched, twisted or tangled grows within a minute by a factor of 80 to 130 with √Λ dt = 0.8, 1.1 to 1.8
with 0.4, at most 1.07 with 0.2 and 1.01 with 0.14. Smooth oscillations keep 0.98 of their energy with 0.8.

So √Λ dt of an undamped step is CALM while no jello is wild (see energy_limits/heat.py), and WILD while one is: that
depends on the energy, so the step stays constant, as a symplectic method requires. Dashpots dissipate up to λ = c/k Λ
of the energy a second. Where that exceeds the heating, steps may be as long as linear theory allows.
"""

from dataclasses import replace
from math import sqrt
from typing import Any

from taichi_jello.physics.integrators._base import Integrator
from taichi_jello.physics.stable_step import Bound

CALM = 0.75  # √Λ dt of an undamped step: small oscillations keep 0.98 of their energy
WILD = 0.125  # the same while springs may pass through zero length: at most 2 % of the energy in a minute
# Dashpots exceed the heating if (√Λ dt)⁴ is this times c/k √Λ: the heating is then λ/200. Measured from wild starts
# with c from 1 to 1e-4 of a cube's 0.25 N·s/m: with 25 no frame ends with more energy than the start; with 100 a few
# do, by 2 %; with 400, by 4 % to a factor of 38.
DAMPED = 25.0


class Symplectic(Integrator):
    safety = 0.95

    @classmethod
    def bound(cls, forces: tuple[Any, ...], drag: float) -> Bound:
        found = super().bound(forces, drag)
        if found.squared_frequency == 0.0:
            return found
        root = sqrt(found.squared_frequency)
        damped = (DAMPED * found.damping_time * root) ** 0.25
        calm, wild = (min(found.dt, max(undamped, damped) / root) for undamped in (CALM, WILD))
        return replace(found, safety=found.safety * calm / found.dt, dt=calm, wild_dt=wild)
