"""What a case's state is at its end, as well as can be known: two solvers, how far apart they are, and whether the
motion can be predicted point by point at all."""

import warnings
from dataclasses import dataclass

import numpy as np
import taichi as ti

from taichi_jello.run.clock import StepWarning
from taichi_jello.run.simulation import Simulation
from taichi_jello.run.snapshot import Snapshot
from taichi_jello.studies._accuracy.cases import Case
from taichi_jello.studies._reference import Reference
from taichi_jello.studies._report import INSTALL
from taichi_jello.support import runtime

FINER = 8  # times as many steps as RK4 needs to be stable, and twice that for Richardson's extrapolation
PUSH = 1e-9  # of the edge: the perturbation of the chaos gate
GROWTH = 100.0  # of the perturbation, beyond which no error is told point by point
AGREED, WORK = 1e-9, 1e8  # RK4's steps are halved until the solvers agree so well, or so many springs were visited
PIECE = 2e7  # springs passed in a launch of kernels: some tenths of a second, since Ctrl-C waits for its end
PASSES = 50  # through all springs that an implicit step may take
SAME = 1e-9  # relative difference of forces below which NumPy's physics is the program's


@dataclass(frozen=True)
class Truth:
    """x [m] and v [m/s] (N, 3) at the end; `edge` [m]; `disagreement` of the two solvers, RMS over the edge; `growth`
    of a small perturbation; `energy` [J] at the end and at the start; `how` it was found, in words."""

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
        return self.growth >= GROWTH

    @property
    def floor(self) -> float:
        """Errors below it say nothing."""
        return 10.0 * self.disagreement


def rms(a: np.ndarray, b: np.ndarray, edge: float) -> float:
    """Root mean square distance of the points of a and b over the edge."""
    return float(np.sqrt(np.mean(np.sum((a.astype(float) - b) ** 2, axis=1)))) / edge


def roll_out(simulation: Simulation, case: Case, substeps: int, x: np.ndarray) -> Snapshot:
    """The case from x and the body's own velocities to its end."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)
        simulation.change_step(substeps=substeps)
    simulation.restore(Snapshot(0.0, x, simulation.start.v))
    integrator, left = simulation.system.integrator, case.frames * substeps
    passes = PASSES * integrator.stages if integrator.solves else integrator.passes
    piece = max(1, round(PIECE / (passes * max(1, len(simulation.body.springs)))))
    while left > 0:
        simulation.step(min(piece, left))
        left -= piece
    return simulation.snapshot()


@ti.kernel
def _accelerations(system: ti.template(), t: float, out: ti.template()):
    system.find_contacts(0, system.count, system.state.x, system.state.v, 0.0)
    system.accelerations(0, system.count, system.state.x, system.state.v, t, out)


def same_physics(reference: Reference, simulation: Simulation, moments: list[Snapshot]) -> bool:
    """Whether NumPy and the kernels agree on the accelerations at some moments of the run."""
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
        mine = out.to_numpy()[memory.guard : memory.guard + memory.particles]
        other = reference.acceleration(moment.time - start, moment.x, moment.v)
        agree = agree and bool(np.abs(mine - other).max() <= SAME * (np.abs(other).max() + 1e-300))
    simulation.restore(now)
    return agree


def dop853(
    case: Case, simulation: Simulation, moments: list[Snapshot]
) -> tuple[tuple[np.ndarray, np.ndarray] | None, str]:
    """x and v at the case's end by SciPy, and what that is called; None where it cannot be had, and why."""
    body = simulation.body
    titles = [force.title for force in simulation.system.all_forces]
    try:
        reference = Reference(case.scene, body)
        if not reference.knows(case.scene, titles) or not same_physics(reference, simulation, moments):
            return None, "; NumPy's reference does not know all that moves this scene"
        solved = reference.solve(
            case.start(body.x), simulation.start.v.astype(float), case.seconds, simulation.frame_dt
        )
        return solved, "SciPy's DOP853 at 1e-12"
    except ImportError:
        return None, f"; SciPy would confirm it: {INSTALL}"
    except ArithmeticError as error:
        return None, f"; {error}"


def truth(case: Case) -> Truth:
    """The truth of a case. Starts Taichi in f64 on the CPU. Raises Diverged for a scene that has no end."""
    runtime.start("cpu", "f64", 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)
        simulation = Simulation(case.scene, method="rk4", team=1)
    body, edge = simulation.body, case.edge
    x = case.start(body.x)
    simulation.restore(Snapshot(0.0, x, simulation.start.v))
    begun = simulation.snapshot()
    energy_at_start = sum(simulation.energies().values())
    substeps = FINER * max(1, int(np.ceil(simulation.frame_dt / min(simulation.safe_dt, simulation.frame_dt / 4))))
    coarse = roll_out(simulation, case, substeps, x)
    kick = np.where(body.pinned[:, None], 0.0, np.random.default_rng(0).standard_normal(x.shape))
    kick *= PUSH * edge / (np.sqrt(np.mean(np.sum(kick**2, axis=1))) or 1.0)
    growth = rms(roll_out(simulation, case, substeps, x + kick).x, coarse.x, edge) / PUSH
    solved, told = (None, "") if growth >= GROWTH else dop853(case, simulation, [begun, coarse])
    while True:
        substeps *= 2
        fine = roll_out(simulation, case, substeps, x)
        best = [b + (b - a) / 15.0 for a, b in ((coarse.x, fine.x), (coarse.v, fine.v))]
        disagreement = max(rms(best[0], fine.x if solved is None else solved[0], edge), 1e-15)
        work = case.frames * substeps * 4 * len(body.springs)
        if disagreement < AGREED or work > WORK or growth >= GROWTH:
            break
        coarse = fine
    rk4 = f"RK4 at {simulation.dt:.3g} s in f64, extrapolated"
    told = rk4 + told if solved is None else f"{told}, confirmed by {rk4}"
    best = best if solved is None else list(solved)
    simulation.restore(Snapshot(case.seconds, best[0], best[1]))
    energy = sum(simulation.energies().values())
    return Truth(best[0], best[1], edge, disagreement, growth, energy, energy_at_start, told)
