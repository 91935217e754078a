"""The method `auto`: explicit where a frame's evaluations fit into real time or cost less, else steps that adapt."""

from math import ceil
from typing import Any

from taichi_jello.physics.integrators import scheme
from taichi_jello.physics.integrators._base import Integrator
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene

AUTO = "auto"
ACCURATE, UNDAMPED, CHEAPEST, STIFF = "rk4", "verlet", "symplectic-euler", "adaptive"
# Forces of a spring that one thread and two evaluate in a second; 450 and 950 million were measured. Work is counted
# and not timed, so that the choice is the same on every machine.
SPRINGS = {False: 400e6, True: 800e6}
MANY = 3000  # particles from which on two threads share the work
PARTICLE = 2.0  # springs that a particle costs besides its own
SHARE = 0.6  # of a frame that the motion may take: the rest is for drawing it
SOLVED = 400.0  # evaluations that an adaptive frame takes where something touches, of solids
THIN = 10.0  # times as many of sheets and ropes, whose springs do not hold them across


def check(method: str) -> None:
    """Raises SceneError for a method that there is not."""
    if method != AUTO:
        scheme(method)


class Choice:
    """What `auto` takes for a scene: `method`, and the `reason`: what a frame costs, in evaluations of all forces.
    own_step: whether dt or substeps are given; then the step is explicit and as given."""

    def __init__(self, scene: Scene, body: Body, own_step: bool):
        self.scene, self.body, self.own_step = scene, body, own_step
        self.method, self.reason = "", ""

    def scheme(self, forces: tuple[Any, ...], damped: bool) -> type[Integrator]:
        """The scheme for a system with these forces; `damped`: any of them reads velocities."""
        self.method, self.reason = self._choose(forces, damped)
        return scheme(self.method)

    def _choose(self, forces: tuple[Any, ...], damped: bool) -> tuple[str, str]:
        best = ACCURATE
        if self._keeps_its_energy(forces):
            best = CHEAPEST if damped else UNDAMPED  # symplectic ones, with one evaluation a step
        if self.own_step:
            return best, "the step is given"
        costs = {name: self._cost(name, forces, damped) for name in dict.fromkeys((best, CHEAPEST))}
        most, solved = self._affordable(), SOLVED if self._solid() else THIN * SOLVED
        told = f"a frame takes {best} {costs[best]:.0f} evaluations of all forces; real time allows {most:.0f}"
        if costs[best] <= most:
            return best, told
        cheapest = min(costs, key=lambda name: costs[name])
        if costs[cheapest] <= max(most, solved):
            return cheapest, told + (f", {cheapest} takes {costs[cheapest]:.0f}" if cheapest != best else "")
        return STIFF, f"{told}, {STIFF} steps take about {solved:.0f}"

    def _keeps_its_energy(self, forces: tuple[Any, ...]) -> bool:
        """Whether there are springs, and nothing but contact takes energy or brings any."""
        others = [f for f in forces if f.energy_kind is None and not f.couples]
        return len(self.body.springs) > 0 and not self.body.damping.any() and not any(f.acts for f in others)

    def _cost(self, name: str, forces: tuple[Any, ...], damped: bool) -> float:
        """Evaluations of all forces in a frame with an explicit method at its safe step."""
        method, frame = scheme(name), self.scene.solver.frame_dt
        dt = method.bound(forces, self.scene.drag).dt
        return method.evaluations(damped) * ceil(frame / min(dt, frame) * (1.0 - 1e-9)) if dt > 0.0 else float("inf")

    def _affordable(self) -> float:
        """How often all forces can be evaluated in a frame in real time."""
        each = (len(self.body.springs) + PARTICLE * len(self.body)) / SPRINGS[len(self.body) >= MANY]
        return SHARE * self.scene.solver.frame_dt / each

    def _solid(self) -> bool:
        """Whether all jellos have cells."""
        return set(self.body.jello.tolist()) == set(self.body.jello[self.body.cells[:, 0]].tolist())
