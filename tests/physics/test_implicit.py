"""Implicit methods on stiff jellos: energy, momentum, iterations, and every force inside the solve."""

from dataclasses import replace

import numpy as np
import pytest
from reference import frame_energies

from taichi_jello import Ball, Box, Contact, Keyframe, Pin, Plane, Region, Scene, Sheet, Simulation, Snapshot
from taichi_jello.physics.integrators.implicit_solve.progress import MAX_ITERATIONS
from taichi_jello.physics.system import force_kinds

STILL = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def shape_after(simulation, accuracy, seconds=0.5):
    """(N, 3) positions about their mean after a fall that is solved as accurately as this."""
    simulation.system.integrator.solver.accuracy = accuracy
    simulation.system.integrator.tuned()
    simulation.reset()
    simulation.advance(seconds)
    return simulation.x - simulation.x.mean(0)


def apart(a, b):
    """RMS distance of two such shapes, turned onto each other."""
    left, _, right = np.linalg.svd(b.T @ a)
    return np.sqrt(np.mean(np.sum((b @ (left @ right) - a) ** 2, 1)))


def test_every_force_that_stiffens_is_seen_by_the_solve():
    """Gravity and uniform fields do not; what a grid or any function does the solve cannot know."""
    blind = {kind.title for kind in force_kinds() if not (kind.has_curvature or kind.couples)}
    assert blind == {"gravity", "uniform field", "grid field", "callable field"}


@pytest.mark.parametrize("method", ["backward-euler", "bdf2", "sdirk2"])
def test_a_stiff_cube_hits_the_ground_at_frame_rate(method, anew):
    """One step a frame, where RK4 needs up to 2000, and no hit feeds energy. Backward Euler's never rises at all; the
    schemes of second order turn a tumbling cube with an error, (ω dt)³ = 6e-4 of its energy at 5 rad/s: a step of
    theirs gained up to 1.6e-4 of all, and 0.2 if steps in which contacts change were not repeated."""
    placed = {"position": (0.0, 0.9, 0.0), "rotation": (20.0, 0.0, 30.0), "velocity": (0.5, -5.0, 0.0)}
    scene = Scene(jello=[Box(points=(4, 4, 4), stiffness=1e5, **placed)], collider=[Plane()])
    anew()
    simulation = Simulation(scene, method=method)
    assert simulation.substeps == 1
    for scale in (1.0, 100.0):
        simulation.reset()
        simulation.tune(stiffness=scale)
        energy = frame_energies(simulation, 90)
        assert max(energy) <= (1.0 + 1e-9) * energy[0]  # to the accuracy of the solve
        assert np.diff(energy).max() <= (1e-9 if method == "backward-euler" else 6e-4) * energy[0]
        assert energy[-1] < 0.6 * energy[0]
        if method == "backward-euler":
            shapes = [shape_after(simulation, accuracy) for accuracy in (1e-9, 1e-3)]  # converged; as in f32
            assert apart(*shapes) < 1e-3  # of the edge, 1 m
            simulation.advance(1.0)
        assert simulation.x[:, 1].min() > -0.1  # v √(m/k) of all the mass on a quarter of the bottom's contacts: 0.08 m
        rest = simulation.body
        lengths = np.linalg.norm(np.subtract(*(simulation.x[rest.springs[:, k]] for k in (0, 1))), axis=1)
        assert np.abs(lengths / rest.rest_length - 1.0).max() < 5e-3


@pytest.mark.parametrize("method", ["backward-euler", "bdf2", "sdirk2"])
def test_a_free_body_keeps_its_momenta_to_the_accuracy_of_the_solve(method, anew):
    """Linear momentum is kept. Backward Euler damps rotation by ω²dt² a step; what it keeps is x' × m v', since the
    forces at the end of a step have no torque about anything: L' = L + Σ (x' - x) × m (v - v') = L + dt Σ v' × m v."""
    cube = Box(points=(4, 4, 4), stiffness=1e6, position=(0.0, 0.0, 0.0), velocity=(1.0, 2.0, 0.5), spin=(1, -2, 3))
    # Far below there is the ground: the kernels are those of the cube above that hits it.
    scene = Scene(jello=[cube], collider=[Plane(point=(0.0, -100.0, 0.0))])
    anew()
    simulation = Simulation(scene, method=method, substeps=4)
    simulation.tune(gravity=STILL)
    m = simulation.body.mass[:, None]

    def angular(x, v):
        return np.sum(np.cross(x, m * v), 0)

    momentum = np.sum(m * simulation.v, 0)
    for _ in range(20):
        before = simulation.snapshot()
        simulation.step()
        if method == "backward-euler":
            expected = angular(before.x, before.v) + simulation.dt * np.sum(np.cross(simulation.v, m * before.v), 0)
            assert angular(simulation.x, simulation.v) == pytest.approx(expected, abs=1e-7)
    assert np.sum(m * simulation.v, 0) == pytest.approx(momentum, abs=1e-7)


def products(simulation, frames=12):
    """Evaluations of the forces and products with H that a twisted fall onto the ground takes."""
    solver = simulation.system.integrator.solver
    before = solver.passes
    for _ in range(frames):
        simulation.frame()
    return solver.passes - before


def checker(places):
    """Eight blocks in turns, which hang together at their edges only."""
    return np.where(np.floor(places * 1.999).sum(1) % 2 == 0, 1.0, 1e-6)


# 1:1e6, and a 1:1e4 of masses, within one body.
UNEQUAL = {
    "families": {"stiffness": {"structural": 1e6, "shear": 1e3, "bend": 1.0}},
    "masses": {"stiffness": 1e6, "region": [Region(max=(1.0, 0.4, 1.0), mass_factor=1e4)]},
    "side by side": {"stiffness": 1.0, "region": [Region(max=(0.5, 1.0, 1.0), stiffness_factor=1e6)]},
    "ball within": {"stiffness": 1.0, "region": [Region(radius=0.36, stiffness_factor=1e6)]},
    "checker": {"stiffness": 1e6, "region": [Region(stiffness_factor=checker)]},
}


def landing(**springs):
    cube = Box(points=(4, 4, 4), position=(0.0, 0.55, 0.0), velocity=(0.0, -2.0, 0.0), **springs)
    contact = Contact(stiffness=2000.0, damping=1.0, friction=0.0)
    return Simulation(Scene(jello=[cube], collider=[Plane()], contact=contact), method="backward-euler")


@pytest.fixture(scope="module")
def uniform_products(taichi):
    """What a uniform body takes, as stiff as the stiff parts, or as the soft ones if that is more."""
    uniform = landing(stiffness=1e6)
    stiff = products(uniform)
    uniform.system.tune(stiffness=1e-6, damping=1.0)
    uniform.reset()
    return max(stiff, products(uniform))


@pytest.mark.parametrize("name", UNEQUAL)
def test_unequal_stiffnesses_and_masses_take_at_most_twice_the_iterations(name, uniform_products, anew):
    anew()
    assert products(landing(**UNEQUAL[name])) <= 2 * uniform_products


def test_a_solve_ends_where_no_step_solves_it():
    """Where a dashpot begins to press, its force jumps, and there may be nothing between: this hit went to the limit of
    30 rounds in 208 passes. What is left there must not feed energy."""
    placed = {"position": (0.0, 0.75, 0.0), "rotation": (10.0, 20.0, 5.0), "velocity": (0.0, -5.0, 0.0)}
    scene = Scene(jello=[Box(points=(4, 4, 4), stiffness=1e5, **placed)], collider=[Plane()])
    scene = replace(scene, contact=Contact(stiffness=2000.0, damping=0.5, friction=0.0))
    simulation = Simulation(scene, method="backward-euler", substeps=1)
    solver = simulation.system.integrator.solver
    for _ in range(6):
        before = sum(simulation.energies().values())
        assert products(simulation, frames=1) <= 140
        assert solver.now.iterations[0] <= MAX_ITERATIONS // 2
        assert sum(simulation.energies().values()) <= before


def test_no_force_leaves_a_body_alone_and_a_state_at_rest_takes_no_round():
    simulation = Simulation(Scene(gravity=STILL, jello=[Box(points=(3, 3, 3), stiffness=1e6)]), method="backward-euler")
    start = simulation.snapshot()
    for velocity in (STILL, (1.0, 0.0, 0.0)):
        simulation.restore(Snapshot(0.0, start.x, start.v + velocity))
        simulation.frame()
        moved = start.x + simulation.dt * np.array(velocity)
        assert simulation.x == pytest.approx(moved, abs=1e-12) and np.isfinite(simulation.v).all()


def test_a_body_that_is_pinned_whole_rests():
    simulation = Simulation(Scene(jello=[Box(points=(3, 3, 3), pin=[Pin()])]), method="backward-euler")
    simulation.frame()
    assert simulation.x == pytest.approx(simulation.body.x) and not simulation.v.any()


def test_the_solve_goes_by_springs_as_stiff_as_they_are_now():
    """Melted to a thousandth: A and what is made of it follow, up to a factor of two."""
    melt = [Keyframe(time=0.0, stiffness=1.0), Keyframe(time=1.0, stiffness=1e-3)]
    scene = Scene(jello=[Box(points=(3, 3, 3), stiffness=1e6, damping=0.0, keyframe=melt)])
    simulation = Simulation(scene, method="backward-euler")
    integrator, dt = simulation.system.integrator, simulation.dt
    found = []
    for time in (0.0, 1.0):
        simulation.system.begin_frame(time, time + dt)
        integrator.prepare(simulation.system, dt)
        inverse = integrator.solver.preconditioner.inverse.to_numpy()[:27, :27]
        found.append(np.linalg.inv(inverse) - np.diag(simulation.body.mass / dt**2))
    assert found[1] == pytest.approx(found[0] * 1.024e-3, rel=0.05, abs=1e-3)


@pytest.mark.parametrize("jello", [Box(points=(6, 3, 6)), Ball(resolution=5), Sheet(points=(9, 4))])
def test_nodes_of_the_coarse_grid_that_move_no_particles(jello):
    """As where there are few between two nodes. The coarse matrix could not be inverted then: backward Euler ended
    after a pass, and fed energy."""
    simulation = Simulation(Scene(jello=[jello]), method="backward-euler")
    integrator, dt = simulation.system.integrator, simulation.dt
    integrator.prepare(simulation.system, dt)
    coarse = integrator.solver.preconditioner
    inverse = coarse.inverse.to_numpy()[: coarse.count, : coarse.count]
    assert np.linalg.cond(inverse) < 1e-3 / np.finfo(np.float32).eps  # three digits of it are right in float32
