"""The method `auto`: explicit if that runs in real time or costs less, else adaptive implicit steps."""

from math import ceil

from taichi_jello.physics.forces._base import ParticleForce
from taichi_jello.physics.integrators import scheme
from taichi_jello.physics.integrators._base import Integrator
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene

AUTO = "auto"
ACCURATE, UNDAMPED, CHEAPEST, STIFF = "rk4", "verlet", "symplectic-euler", "adaptive"
# Spring forces per second on one thread and on two; 450 and 950 million were measured. Work is counted, not timed, so
# the choice is the same on every machine.
SPRING_RATES = {False: 400e6, True: 800e6}
THREADED_PARTICLES = 3000  # from here on two threads share the work
PARTICLE_COST = 2.0  # of a particle besides its springs, in springs
FRAME_SHARE = 0.6  # of a frame's time is for physics, the rest for drawing
SOLVED = 400.0  # evaluations in an adaptive frame of touching solids
THIN = 10.0  # times as many for sheets and ropes, whose springs do not resist bending across


def check(method: str) -> None:
    """Raises SceneError for an unknown method."""
    if method != AUTO:
        scheme(method)


class Choice:
    """The method that `auto` chooses for a scene, and the `reason`: the cost of a frame in evaluations of all forces.
    own_step: dt or substeps are given, so the step is explicit."""

    def __init__(self, scene: Scene, body: Body, own_step: bool):
        self.scene, self.body, self.own_step = scene, body, own_step
        self.method, self.reason = "", ""

    def scheme(self, forces: tuple[ParticleForce, ...], damped: bool) -> type[Integrator]:
        """The scheme for a system with these forces; `damped`: any of them reads velocities."""
        self.method, self.reason = self._choose(forces, damped)
        return scheme(self.method)

    def _choose(self, forces: tuple[ParticleForce, ...], damped: bool) -> tuple[str, str]:
        best = ACCURATE
        others = [force for force in forces if force.energy_kind is None and not force.couples and force.acts]
        if len(self.body.springs) and not self.body.damping.any() and not others:
            best = CHEAPEST if damped else UNDAMPED  # energy is conserved but for contact: symplectic methods
        if self.own_step:
            return best, "the step is given"
        costs = {name: self._cost(name, forces, damped) for name in dict.fromkeys((best, CHEAPEST))}
        body, frame = self.body, self.scene.solver.frame_dt
        work = len(body.springs) + PARTICLE_COST * len(body)
        affordable = FRAME_SHARE * frame / (work / SPRING_RATES[len(body) >= THREADED_PARTICLES])
        all_solid = set(body.jello.tolist()) == set(body.jello[body.cells[:, 0]].tolist())
        solved = SOLVED if all_solid else THIN * SOLVED
        reason = f"a frame takes {best} {costs[best]:.0f} evaluations of all forces; real time allows {affordable:.0f}"
        if costs[best] <= affordable:
            return best, reason
        cheapest = min(costs, key=lambda name: costs[name])
        if costs[cheapest] <= max(affordable, solved):
            return cheapest, reason + (f", {cheapest} takes {costs[cheapest]:.0f}" if cheapest != best else "")
        return STIFF, f"{reason}, {STIFF} steps take about {solved:.0f}"

    def _cost(self, name: str, forces: tuple[ParticleForce, ...], damped: bool) -> float:
        """Evaluations of all forces in a frame with an explicit method at its safe step."""
        method, frame = scheme(name), self.scene.solver.frame_dt
        dt = method.bound(forces, self.scene.drag).dt
        return method.evaluations(damped) * ceil(frame / min(dt, frame) * (1.0 - 1e-9)) if dt > 0.0 else float("inf")
