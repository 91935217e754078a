"""The automatic step of the symplectic methods: no start feeds energy, and only wild ones cost more."""

import numpy as np
import pytest
from reference import frame_energies, twisted

from taichi_jello import Box, Scene, Simulation, Snapshot
from taichi_jello.physics.integrators._symplectic import CALM
from taichi_jello.physics.integrators.energy_limits.heat import WILD

STILL = (0.0, 0.0, 0.0)
METHODS = ["verlet", "symplectic-euler"]


def cube(method, damping=0.0, **options):
    box = Box(points=(4, 4, 4), mass=64 / 512, damping=damping)
    return Simulation(Scene(gravity=STILL, jello=[box]), method=method, **options)


def starts(body):
    """Positions from which springs pass zero length, by name; about the cube's middle."""
    x, random = body.x - body.x.mean(0), np.random.default_rng(5)
    return {
        "stretched 2": x * [1.0, 2.0, 1.0],
        "stretched 10": x * [1.0, 10.0, 1.0],
        "twisted": twisted(x, 360.0),
        "random": random.uniform(-0.5, 0.5, x.shape),
        "flat": x * [1.0, 0.0, 1.0],
        "squashed": x * [1.0, 0.5, 1.0],
        "a point": 1e-3 * random.uniform(-0.5, 0.5, x.shape),
    }


def energies(simulation, x, seconds):
    """The energy at every frame's end over that of the start, from rest."""
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    found = frame_energies(simulation, round(seconds / simulation.frame_dt))
    return found[1:] / found[0]


@pytest.mark.parametrize("method", METHODS)
def test_an_undamped_cube_keeps_its_energy_from_any_start(precision, method):
    """In a minute Verlet's energy leaves the start's by up to 1.3 % with these; with √Λ dt = 0.8 in all frames
    "stretched 2" ends it at 124 times its energy. Symplectic Euler moves the same way, but its velocities are half a
    step late, by which its energies swing: up to 2.3 %."""
    simulation = cube(method)
    for name, x in starts(simulation.body).items():
        ratio = energies(simulation, x, 1.0)
        assert simulation.system.parts == 6, name
        assert np.abs(ratio - 1.0).max() <= (0.02 if method == "verlet" else 0.04), name


def test_a_small_swing_keeps_its_energy_at_a_sixth_of_the_price(best_precision):
    """Verlet shows 1 - (ω dt)²/8 of the energy of a swing that began at rest, on average: here 0.983 or
    more, and it does not drift."""
    simulation = cube("verlet")
    ratio = energies(simulation, simulation.body.x * [1.0, 1.02, 1.0], 10.0)
    assert simulation.system.parts == 1
    assert ratio.min() >= 0.98 and ratio.max() <= 1.001
    assert ratio[:60].mean() == pytest.approx(ratio[-60:].mean(), abs=1e-3)


@pytest.mark.parametrize("method", METHODS)
def test_with_dashpots_energy_never_exceeds_the_start(best_precision, method):
    """Steps get longer with the dashpots, up to what linear theory allows. Where dashpots take next to nothing,
    symplectic Euler's energies swing as without: up to 3.6 %."""
    simulation, lengths = cube(method, damping=0.25), []
    for part in (1.0, 0.1, 0.01, 1e-3, 1e-4):
        simulation.tune(damping=part)
        bound = simulation.system.bound
        lengths.append(bound.safety)
        for name, x in starts(simulation.body).items():
            assert energies(simulation, x, 0.25).max() <= (1.0 if part >= 0.01 else 1.05), (name, part)
    assert lengths[0] == pytest.approx(0.95) and lengths[-1] == pytest.approx(CALM / 2.0, abs=0.01)
    assert np.all(np.diff(lengths) <= 0.0)


@pytest.mark.filterwarnings("ignore:dt = ")
def test_a_wild_frame_goes_on_from_within_to_the_same_bits(best_precision):
    simulation = cube("verlet")
    x = starts(simulation.body)["random"]
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    simulation.step(7)
    within = simulation.snapshot()
    simulation.step(2 * simulation.substeps)
    after = simulation.snapshot()
    simulation.reset()
    simulation.frame()
    assert simulation.system.parts == 1
    simulation.restore(within)
    simulation.step(2 * simulation.substeps)
    assert np.array_equal(simulation.x, after.x) and np.array_equal(simulation.v, after.v)
    simulation.change_step(substeps=20)
    simulation.frame()
    assert simulation.system.parts == 1  # the step is a person's own


def test_wild_is_what_has_the_energy_whatever_it_flies_with(best_precision):
    """Two cubes fly at 100 m/s, one hot: what counts is the hot one's energy, without its flight."""
    box = Box(points=(3, 3, 3), mass=27 / 512, damping=0.0)
    scene = Scene(gravity=STILL, jello=[box, Box(points=(3, 3, 3), mass=1.0, position=(3.0, 0.0, 0.0), damping=0.0)])
    simulation = Simulation(scene, method="verlet")
    body, random = simulation.body, np.random.default_rng(2)
    hot = body.jello == 1
    v = hot[:, None] * random.standard_normal(body.x.shape)
    v -= hot[:, None] * v[hot].mean(0)
    crushed = 0.5 * np.sum((body.stiffness * body.rest_length**2)[hot[body.springs[:, 0]]])
    v *= np.sqrt(WILD * crushed / (0.5 * np.sum(body.mass[:, None] * v**2)))
    for share, wild in ((0.99, False), (1.01, True)):
        simulation.restore(Snapshot(0.0, body.x, np.sqrt(share) * v + [0.0, 100.0, 0.0]))
        assert simulation.system.heat.wild() == wild
