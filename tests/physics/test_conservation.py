"""Conservation laws and symmetries of the forces, in both precisions."""

import numpy as np
import pytest
from reference import elastic_energy, spring_forces, twisted

from taichi_jello import Box, Contact, Plane, Scene, Simulation, Snapshot

STILL = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module", autouse=True)
def taichi(precision):
    return precision


@pytest.fixture
def random_state(cube):
    rng = np.random.default_rng(7)
    return cube.body.x + 0.05 * rng.standard_normal((len(cube.body), 3)), rng.standard_normal((len(cube.body), 3))


@pytest.fixture(scope="module")
def cube(taichi):
    return Simulation(Scene(gravity=STILL, jello=[Box()]))


def test_same_forces_as_numpy(cube, forces, random_state, epsilon):
    x, v = (a.astype(cube.x.dtype).astype(float) for a in random_state)
    expected = spring_forces(cube.body, x, v)
    # Each of about 30 springs is rounded relative to the largest force, k R for stretch and c |w| for speed.
    assert np.abs(forces(cube, x, v) - expected).max() <= 30 * epsilon * (200 * 0.3 + 0.25 * 10)


def test_internal_forces_have_no_sum_and_no_torque(cube, forces, random_state, epsilon):
    x, v = random_state
    f = forces(cube, x, v)
    limit = 1e-6 if epsilon > 1e-10 else 1e-13
    size = np.abs(f).sum()
    assert np.abs(f.sum(0)).max() <= limit * size
    assert np.abs(np.cross(x, f).sum(0)).max() <= limit * size


def test_force_is_minus_the_gradient_of_energy(forces, epsilon):
    if epsilon > 1e-10:
        step, limit = 2e-3, 5e-3  # f32: the energy has 7 digits, its difference over 2e-3 about 3
    else:
        step, limit = 1e-5, 1e-7
    simulation = Simulation(Scene(gravity=STILL, jello=[Box(points=(3, 3, 3), damping=0.0)]))
    x = twisted(simulation.body.x)
    f = forces(simulation, x, np.zeros_like(x))
    for particle, axis in ((0, 0), (4, 1), (13, 2), (26, 0)):
        energy = []
        for sign in (1, -1):
            moved = x.copy()
            moved[particle, axis] += sign * step
            simulation.restore(Snapshot(0.0, moved, np.zeros_like(x)))
            energy.append(simulation.energies()["elastic"])
            assert energy[-1] == pytest.approx(elastic_energy(simulation.body, moved), rel=200 * epsilon)
        slope = (energy[0] - energy[1]) / (2 * step)
        assert f[particle, axis] == pytest.approx(-slope, abs=limit * np.abs(f).max())


def test_dashpots_only_take_power_and_leave_rigid_motion_alone(cube, forces, random_state, epsilon):
    x, v = random_state
    damped = forces(cube, x, v) - forces(cube, x, np.zeros_like(v))
    assert np.sum(damped * v) < 0.0
    rigid = np.array([1.0, 2.0, 3.0]) + np.cross([0.5, -1.0, 2.0], x)
    damped = forces(cube, x, rigid) - forces(cube, x, np.zeros_like(v))
    assert np.abs(damped).max() <= 1e3 * epsilon * 0.25 * np.abs(rigid).max() + 64 * epsilon * 60


def test_turned_and_moved_input_gives_turned_and_moved_output(cube, forces, random_state, epsilon):
    x, v = random_state
    turn, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    f = forces(cube, x, v)
    turned = forces(cube, x @ turn.T + [0.3, -0.2, 0.1], v @ turn.T + [1.0, 0.0, -2.0])
    assert np.abs(turned - f @ turn.T).max() <= 200 * epsilon * np.abs(f).max()


def test_symmetric_drop_stays_symmetric():
    contact = Contact(stiffness=2000.0, damping=0.5)
    simulation = Simulation(Scene(jello=[Box(position=(0.0, 0.8, 0.0))], collider=[Plane()], contact=contact))
    simulation.advance(1.5)
    x = simulation.x.astype(float).reshape(8, 8, 8, 3)
    for axis, flip in ((0, 0), (2, 2)):
        mirrored = np.flip(x, axis).copy()
        mirrored[..., flip] *= -1.0
        assert np.abs(mirrored - x).max() <= 1e-5


@pytest.mark.one_precision("f32")
@pytest.mark.parametrize(("method", "late"), [("backward-euler", 0.5), ("sdirk2", 0.0), ("bdf2", 0.0)])
def test_a_stiff_jello_falls_as_far_as_its_method_says(method, late):
    """Implicit solves end at a tolerance, and springs of 1e5 N/m rounded in float32 are louder than g dt²: without the
    last correction of each jello's momentum SDIRK2 fell 0.6 m short. Backward Euler falls g t dt/2 too far."""
    box = Box(points=(3, 3, 3), stiffness=1e5, position=(0.0, 6.0, 0.0))
    simulation = Simulation(Scene(jello=[box]), method=method, substeps=32)
    start = simulation.x.astype(float)[:, 1].mean()
    simulation.advance(0.5)
    fallen = start - simulation.x.astype(float)[:, 1].mean()
    assert fallen == pytest.approx(9.81 * 0.5 * (0.25 + late * simulation.dt), abs=2e-4)


def test_free_flight_keeps_momentum_and_angular_momentum(epsilon):
    simulation = Simulation(Scene(gravity=STILL, jello=[Box(velocity=(1.0, 2.0, 0.5), spin=(1.0, -2.0, 3.0))]))
    x, m = simulation.body.x, simulation.body.mass[:, None]
    simulation.restore(Snapshot(0.0, twisted(x, 20.0), simulation.v))

    def momenta():
        x, v = simulation.x.astype(float), simulation.v.astype(float)
        return np.sum(m * v, 0), np.sum(np.cross(x, m * v), 0)

    (momentum, angular), steps = momenta(), round(0.5 / simulation.dt)
    simulation.advance(0.5)
    # A velocity of about 3 m/s is rounded once a step; the errors of 512 particles mostly cancel.
    rounding = epsilon * 3.0 * np.sqrt(steps) * 4
    assert np.abs(momenta()[0] - momentum).max() <= rounding
    # RK4 keeps angular momentum only to its order; 1e-7 is 10 times what it loses here in f64.
    assert np.abs(momenta()[1] - angular).max() <= rounding + 1e-7
