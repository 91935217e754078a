"""The force that resists a change of volume: its slope, what it keeps, and that it turns cells right side out."""

import numpy as np
import pytest

from taichi_jello import Ball, Box, Contact, Plane, Scene, SceneError, Sheet, Simulation, Snapshot
from taichi_jello.physics.forces.volume import volumes


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def cube(volume=1.0, **options):
    return Box(points=(5, 5, 5), volume=volume, **options)


def free(jello, **options):
    return Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=[jello]), **options)


def ratios(body, x):
    """(C,) the signed volume of each cell over that of the undeformed cell."""
    return volumes(x.astype(float), body.cells) / volumes(body.rest, body.cells)


def farthest_from_shape(body, x):
    """How far the farthest particle is from the undeformed shape, turned to fit best, over the shape's edge."""
    x, rest = x - x.mean(0), body.rest - body.rest.mean(0)
    u, _, vt = np.linalg.svd(x.T @ rest)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return np.linalg.norm(x - rest @ turn.T, axis=1).max() / np.ptp(rest[:, 0])


def start(kind, rest):
    rng, x = np.random.default_rng(1), rest.copy()
    if kind == "mirrored":
        x[:, 0] *= -1.0
    elif kind == "flat":
        x[:, 1] *= 1e-3
    elif kind == "line":
        x[:, 1:] *= 1e-3
    else:
        x = rng.uniform(-0.5, 0.5, x.shape)
    return x


@pytest.mark.parametrize(
    "method, kind",
    [
        ("rk4", "mirrored"),
        ("rk4", "flat"),
        ("rk4", "line"),
        ("rk4", "random"),
        ("xpbd", "random"),
        ("adaptive", "random"),
    ],
)
def test_a_free_cube_comes_back_from_any_start(method, kind):
    simulation = free(cube(), method=method)
    x = start(kind, simulation.body.rest)
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    simulation.advance(5.0)
    assert ratios(simulation.body, simulation.x).min() > 0.9
    assert farthest_from_shape(simulation.body, simulation.x) < 0.01


def test_without_it_a_random_start_stays_inside_out():
    simulation = free(cube(volume=0.0), method="rk4")
    x = start("random", simulation.body.rest)
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    simulation.advance(5.0)
    assert ratios(simulation.body, simulation.x).min() < 0.0


def test_its_force_is_the_slope_of_its_energy(forces):
    simulation = free(cube(volume=3.0, damping=0.0))
    rng = np.random.default_rng(3)
    x = simulation.body.rest + 0.15 * rng.normal(size=simulation.body.rest.shape)  # some cells are inside out
    assert ratios(simulation.body, x).min() < 0.0
    force, step = forces(simulation, x), 1e-6
    for particle, axis in ((0, 0), (31, 1), (62, 2), (124, 0)):
        energies = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[particle, axis] += sign * step
            simulation.restore(Snapshot(0.0, moved, np.zeros_like(x)))
            energies.append(simulation.energies()["elastic"])
        slope = (energies[0] - energies[1]) / (2.0 * step)
        # Central differences of energies of 1e3 J in f64: rounding 1e3 · 1e-16/1e-6, and step² of the third derivative.
        assert force[particle, axis] == pytest.approx(-slope, rel=1e-5, abs=1e-4)


@pytest.mark.parametrize("method", ["rk4", "xpbd", "backward-euler", "adaptive"])
def test_momentum_and_angular_momentum_stay(method):
    simulation = free(cube(volume=5.0), method=method)
    rest, mass = simulation.body.rest, simulation.body.mass[:, None]
    rng = np.random.default_rng(5)
    x, v = rest * (1.3, 0.7, 1.0), np.cross((1.0, 2.0, 3.0), rest) + 0.3 * rng.normal(size=rest.shape)
    simulation.restore(Snapshot(0.0, x, v))

    def momenta():
        x, v = simulation.x.astype(float), simulation.v.astype(float)
        return np.concatenate([(mass * v).sum(0), (mass * np.cross(x, v)).sum(0)])

    before = momenta()
    simulation.advance(0.5)
    assert np.abs(momenta() - before)[:3].max() < 1e-6 * np.abs(mass * v).sum()
    if method != "backward-euler":  # which slows down any turning
        assert np.abs(momenta() - before)[3:].max() < 2e-3 * np.linalg.norm(before[3:])


def test_energy_of_an_undamped_cube_stays():
    simulation = free(cube(volume=5.0, damping=0.0), method="rk4", substeps=300)
    x = simulation.body.rest * (1.2, 0.9, 0.95)
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    before = sum(simulation.energies().values())
    simulation.advance(1.0)
    assert sum(simulation.energies().values()) == pytest.approx(before, rel=1e-3)


@pytest.mark.parametrize("method", ["rk4", "verlet", "symplectic-euler"])
def test_the_safe_step_is_safe_from_a_random_start(method):
    simulation = free(cube(volume=10.0, damping=0.0), method=method)
    x = start("random", simulation.body.rest)
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    before = sum(simulation.energies().values())
    simulation.advance(3.0)
    assert sum(simulation.energies().values()) < 1.1 * before


def pressed(volume):
    """The volume and the width of a soft cube that its own weight squashes, over those of the undeformed cube."""
    box = cube(volume=volume, stiffness=4.0, damping=0.5, position=(0.0, 0.5, 0.0))
    simulation = Simulation(Scene(jello=[box], collider=[Plane()], contact=Contact(friction=0.0)))
    simulation.advance(6.0)
    return ratios(simulation.body, simulation.x).mean(), np.ptp(simulation.x[:, 0].astype(float))


def test_what_is_squashed_bulges():
    volume, width = pressed(0.0)
    kept, bulged = pressed(20.0)
    assert volume < 0.985 < 0.998 < kept
    assert bulged > 1.0 + 1.5 * (width - 1.0)


def test_it_is_tuned_while_it_runs():
    simulation = free(cube(volume=2.0))
    before = simulation.safe_dt
    simulation.tune(volume=4.0)
    assert simulation.tuning["volume"] == 4.0
    assert simulation.safe_dt < before


def test_a_scene_without_it_has_no_fields_of_it():
    simulation = free(cube(volume=0.0))
    assert "volume" in simulation.system.absent
    assert not any(owner == "volume" for owner, _, _ in simulation.system.memory.fields)


def test_a_ball_keeps_it_too():
    simulation = free(Ball(resolution=5, volume=1.0))
    x = simulation.body.rest * (1.0, 0.02, 1.0)
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    simulation.advance(3.0)
    assert farthest_from_shape(simulation.body, simulation.x) < 0.01


def test_what_has_no_volume_refuses_it():
    with pytest.raises(SceneError, match="volume: expected 0 for a sheet"):
        Simulation(Scene(jello=[Sheet(points=(4, 4), volume=1.0)]))
    with pytest.raises(SceneError, match="volume"):
        Simulation(Scene(jello=[cube(volume=-1.0)]))
