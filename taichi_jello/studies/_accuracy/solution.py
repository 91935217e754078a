"""The reference solution of a case: two independent solvers, how far they differ, and whether the motion is chaotic."""

from dataclasses import dataclass

import numpy as np
import taichi as ti

from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.studies._accuracy.cases import Case
from taichi_jello.studies._reference import Reference
from taichi_jello.studies._report import INSTALL
from taichi_jello.support import runtime

FINER = 8  # RK4's steps are at first so many times shorter than the safe one
PERTURBATION = 1e-9  # of the edge
CHAOTIC_GROWTH = 100.0  # growth of the perturbation beyond which point-by-point errors mean nothing
# RK4's steps are halved until the two solvers agree to this, or until this many springs were evaluated.
AGREEMENT, MAX_WORK = 1e-9, 1e8
SPRINGS_PER_LAUNCH = 2e7  # some tenths of a second, since Ctrl-C waits for the end of a launch
PASSES_PER_SOLVE = 50  # a rough estimate for implicit steps
SAME_FORCES = 1e-9  # relative difference up to which NumPy's physics and the kernels' are the same


@dataclass(frozen=True)
class Solution:
    """x [m] and v [m/s] (N, 3) at the end of a case; `edge` [m]; RMS `disagreement` of the two solvers over the edge;
    `growth` of a small perturbation; `energy` [J] at the end and at the start; `how` it was found, in words."""

    x: np.ndarray
    v: np.ndarray
    edge: float
    disagreement: float
    growth: float
    energy: float
    energy_at_start: float
    how: str

    @property
    def chaotic(self) -> bool:
        return self.growth >= CHAOTIC_GROWTH

    @property
    def floor(self) -> float:
        """Smaller errors cannot be told from the reference's own."""
        return 10.0 * self.disagreement


def rms(a: np.ndarray, b: np.ndarray, edge: float) -> float:
    """Root mean square distance of the points of a and b over the edge."""
    return float(np.sqrt(np.mean(np.sum((a.astype(float) - b) ** 2, axis=1)))) / edge


def run_case(simulation: Simulation, case: Case, substeps: int, x: np.ndarray) -> Snapshot:
    """Run the case from x and the body's initial velocities to its end."""
    simulation.change_step(substeps=substeps)
    simulation.restore(Snapshot(0.0, x, simulation.start.v))
    integrator, left = simulation.system.integrator, case.frames * substeps
    passes = PASSES_PER_SOLVE * integrator.stages if integrator.solves else integrator.passes
    batch = max(1, round(SPRINGS_PER_LAUNCH / (passes * max(1, len(simulation.body.springs)))))
    while left > 0:
        simulation.step(min(batch, left))
        left -= batch
    return simulation.snapshot()


@ti.kernel
def _accelerations(system: ti.template(), t: float, out: ti.template()):
    system.find_contacts(0, system.count, system.state.x, system.state.v, 0.0)
    system.accelerations(0, system.count, system.state.x, system.state.v, t, out)


def same_physics(reference: Reference, simulation: Simulation, moments: list[Snapshot]) -> bool:
    """Whether NumPy and the kernels agree on the accelerations at these moments of the run."""
    system, now = simulation.system, simulation.snapshot()
    memory = system.memory
    out = memory.vectors("reference", "a")
    agree = True
    for moment in moments:
        simulation.restore(moment)
        frame = min(round(moment.time / simulation.frame_dt), round(moment.time / simulation.frame_dt - 0.5))
        start = max(0, frame) * simulation.frame_dt
        for side in (system, reference):
            side.begin_frame(start, start + simulation.frame_dt)
        _accelerations(system, moment.time - start, out)
        ours = out.to_numpy()[memory.guard : memory.guard + memory.particles]
        other = reference.acceleration(moment.time - start, moment.x, moment.v)
        agree = agree and bool(np.abs(ours - other).max() <= SAME_FORCES * (np.abs(other).max() + 1e-300))
    simulation.restore(now)
    return agree


def dop853(
    case: Case, simulation: Simulation, moments: list[Snapshot]
) -> tuple[tuple[np.ndarray, np.ndarray] | None, str]:
    """x and v at the case's end by SciPy, and the solver's name; else None and the reason."""
    body = simulation.body
    titles = [force.title for force in simulation.system.all_forces]
    try:
        reference = Reference(case.scene, body)
        if not reference.knows(case.scene, titles) or not same_physics(reference, simulation, moments):
            return None, "; NumPy's reference does not know all that moves this scene"
        v = simulation.start.v.astype(float)
        return reference.solve(case.start(body.x), v, case.seconds, simulation.frame_dt), "SciPy's DOP853 at 1e-12"
    except ImportError:
        return None, f"; SciPy would confirm it: {INSTALL}"
    except ArithmeticError as error:
        return None, f"; {error}"


def perturbed(x: np.ndarray, pinned: np.ndarray, edge: float) -> np.ndarray:
    """x (N, 3) with every point that is not pinned moved a little, in a random direction."""
    push = np.where(pinned[:, None], 0.0, np.random.default_rng(0).standard_normal(x.shape))
    push *= PERTURBATION * edge / (np.sqrt(np.mean(np.sum(push**2, axis=1))) or 1.0)
    return x + push


def reference_solution(case: Case) -> Solution:
    """Solve a case in f64 on the CPU, where it starts Taichi: by RK4 with ever shorter steps and Richardson's
    extrapolation, and by SciPy. Raises Diverged if RK4 diverges."""
    runtime.start("cpu", "f64", 1)
    simulation = Simulation(case.scene, method="rk4", team=1)
    body, edge = simulation.body, case.edge
    x = case.start(body.x)
    simulation.restore(Snapshot(0.0, x, simulation.start.v))
    start = simulation.snapshot()
    energy_at_start = sum(simulation.energies().values())
    substeps = FINER * max(1, int(np.ceil(simulation.frame_dt / min(simulation.safe_dt, simulation.frame_dt / 4))))
    coarse = run_case(simulation, case, substeps, x)
    pushed = run_case(simulation, case, substeps, perturbed(x, body.pinned, edge))
    growth = rms(pushed.x, coarse.x, edge) / PERTURBATION
    solved, how = (None, "") if growth >= CHAOTIC_GROWTH else dop853(case, simulation, [start, coarse])
    while True:
        substeps *= 2
        fine = run_case(simulation, case, substeps, x)
        x_end, v_end = (b + (b - a) / 15.0 for a, b in ((coarse.x, fine.x), (coarse.v, fine.v)))
        disagreement = max(rms(x_end, fine.x if solved is None else solved[0], edge), 1e-15)
        work = case.frames * substeps * 4 * len(body.springs)
        if disagreement < AGREEMENT or work > MAX_WORK or growth >= CHAOTIC_GROWTH:
            break
        coarse = fine
    rk4 = f"RK4 at {simulation.dt:.3g} s in f64, extrapolated"
    how = rk4 + how if solved is None else f"{how}, confirmed by {rk4}"
    x_end, v_end = solved or (x_end, v_end)
    simulation.restore(Snapshot(case.seconds, x_end, v_end))
    energy = sum(simulation.energies().values())
    return Solution(x_end, v_end, edge, disagreement, growth, energy, energy_at_start, how)
