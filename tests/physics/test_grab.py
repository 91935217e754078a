"""The hand: where it holds a jello, how hard it pulls, and that no pull breaks anything."""

import numpy as np
import pytest

from taichi_jello import Box, Contact, Grab, Plane, Scene, Simulation
from taichi_jello.physics.forces.grab import FREQUENCY


@pytest.fixture(autouse=True)
def taichi(precision, anew):
    anew()


def test_a_held_weight_hangs_below_the_hand_by_its_weight(epsilon):
    """One point of 1 kg: k (target - x) = m g, and nothing moves (closed answer)."""
    simulation = Simulation(Scene(jello=[Box(points=(1, 1, 1))], force=[Grab(stiffness=500.0)]))
    simulation.grab([0], [1.0], (0.0, 0.0, 0.0))
    simulation.advance(3.0)
    assert simulation.x[0] == pytest.approx([0.0, -9.81 / 500.0, 0.0], abs=1e-5)
    assert simulation.held.force == pytest.approx([0.0, 9.81, 0.0], abs=500.0 * 1e-5)


def test_a_single_particle_follows_critically_damped(epsilon):
    """x'' = -ω²(x - d) - 2ωx' from rest: x = d (1 - (1 + ωt) e^(-ωt)), ω² = k/(m + M), the hand's mass
    M = k/FREQUENCY²; the hand jumps before the first frame."""
    scene = Scene(
        gravity=(0.0, 0.0, 0.0), jello=[Box(points=(1, 1, 1))], force=[Grab(stiffness=400.0, limit=1e3, calm=0.0)]
    )
    simulation = Simulation(scene, dt=1e-4)
    simulation.grab([0], [1.0], (0.1, 0.0, 0.0))
    omega = np.sqrt(400.0 / (1.0 + 400.0 / FREQUENCY**2))
    for _ in range(12):
        simulation.frame()
        wt = omega * simulation.time
        # RK4 at ωh = 0.002 errs by less than rounding, which adds up over the steps.
        assert simulation.x[0, 0] == pytest.approx(0.1 * (1.0 - (1.0 + wt) * np.exp(-wt)), abs=2000 * epsilon * 0.1)


def test_the_pull_is_shared_by_weight_and_limited():
    scene = Scene(
        gravity=(0.0, 0.0, 0.0), jello=[Box(points=(2, 2, 2))], force=[Grab(stiffness=100.0, limit=3.0, calm=0.0)]
    )
    simulation = Simulation(scene, substeps=200)
    weights = np.array([0.5, 0.3, 0.2])
    simulation.grab([0, 1, 2], weights, weights @ simulation.x[:3] + [0.0, 50.0, 0.0])
    start = simulation.snapshot()
    simulation.step(1)
    pulled = simulation.v - start.v
    heavier = 0.125 + weights * 100.0 / FREQUENCY**2  # each with its share of the hand's mass
    assert heavier * pulled[:3, 1] == pytest.approx(3.0 * weights * simulation.dt, rel=1e-3)
    assert np.linalg.norm(simulation.held.force) == pytest.approx(3.0)
    simulation.release()
    before = simulation.body.mass @ simulation.v
    simulation.step(400)
    assert simulation.held is None
    assert simulation.body.mass @ simulation.v == pytest.approx(before, rel=1e-4, abs=1e-7)  # thrown: momentum stays


@pytest.mark.one_precision("f32")
@pytest.mark.parametrize("stiffness", [1.0, 200.0, 1e5])
def test_no_pull_breaks_a_jello(stiffness):
    """Wild hands for two seconds: the hand's stiffness counts in the safe step, so numbers stay finite and small."""
    box = Box(points=(4, 4, 4), position=(0.0, 0.5, 0.0), stiffness=stiffness)
    simulation = Simulation(Scene(jello=[box], collider=[Plane()], force=[Grab()]))
    hands = np.random.default_rng(0)
    simulation.grab([63], [1.0], simulation.x[63])
    for frame in range(120):
        simulation.move_grab(hands.uniform(-4.0, 4.0, 3))
        if frame % 30 == 29:
            who = int(hands.integers(64))
            simulation.grab([who], [1.0], simulation.x[who])
        simulation.frame()
    assert np.abs(simulation.x).max() < 20.0


@pytest.mark.one_precision("f32")
def test_holding_takes_no_step_more():
    """The hand's spring, on the hand's mass, is slower than contact: the frame has as many substeps as before."""
    box = Box(points=(3, 3, 3), mass=27 / 512, position=(0.0, 0.6, 0.0))
    simulation = Simulation(Scene(jello=[box], collider=[Plane()], force=[Grab()]))
    before = simulation.substeps
    simulation.grab([26], [1.0], simulation.x[26])
    assert simulation.substeps == before > 1


@pytest.mark.one_precision("f32")
def test_a_far_hand_brings_the_point_in_without_overshoot(anew):
    """Metres away from one frame to the next; nothing but the hand's own law brakes a single particle."""
    for mass in (0.001, 1.0):
        anew()
        scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[Box(points=(1, 1, 1), mass=mass)], force=[Grab(calm=0.0)])
        simulation = Simulation(scene)
        for far in (0.1, 2.0, -8.0):
            start = simulation.x[0, 0]
            simulation.grab([0], [1.0], simulation.x[0])
            simulation.frame()
            simulation.move_grab((start + far, 0.0, 0.0))
            way = []
            for _ in range(120):
                simulation.frame()
                way.append((simulation.x[0, 0] - start) / far)
            assert max(way) < 1.02 and way[-1] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.one_precision("f32")
def test_without_a_grab_there_is_no_hand():
    simulation = Simulation(Scene(jello=[Box(points=(2, 2, 2))]))
    assert simulation.held is None and not any(owner == "grab" for owner, *_ in simulation.system.memory.fields)
    with pytest.raises(ValueError, match="no Grab"):
        simulation.grab([0], [1.0], (0.0, 0.0, 0.0))


@pytest.mark.one_precision("f32")
def test_tuning_changes_forces_and_the_safe_step():
    """Four times the stiffness, half the undamped step; free fall under the new gravity at once."""
    box = Box(points=(3, 3, 3), damping=0.0)
    simulation = Simulation(Scene(jello=[box]), method="symplectic-euler")
    before = simulation.safe_dt
    simulation.tune(stiffness=4.0, gravity=(0.0, 3.0, 0.0))
    assert simulation.safe_dt == pytest.approx(before / 2.0, rel=1e-6) and simulation.dt <= simulation.safe_dt
    simulation.frame()
    assert simulation.body.mass @ simulation.v == pytest.approx([0.0, 3.0 * simulation.frame_dt, 0.0], rel=1e-4)
    with pytest.raises(ValueError, match="friction: expected one of"):
        simulation.tune(friction=0.5)


@pytest.mark.one_precision("f32")
def test_tuned_is_the_same_as_made_so(anew):
    """A scene tuned to other numbers goes on as one that was made with them."""
    place = {"points": (3, 3, 3), "position": (0.0, 0.45, 0.0)}
    rest = {"collider": [Plane()], "contact": Contact(stiffness=2000.0, damping=0.5)}
    made = Scene(jello=[Box(stiffness=600.0, damping=0.5, **place)], **rest)
    tuned = Scene(jello=[Box(stiffness=200.0, damping=0.25, **place)], **rest)
    one = Simulation(made)
    one.advance(0.3)
    dt, x = one.dt, one.x
    anew()
    two = Simulation(tuned)
    two.tune(stiffness=3.0, damping=2.0)
    assert two.dt == dt
    two.advance(0.3)
    assert np.array_equal(x, two.x)


@pytest.mark.one_precision("f32")
def test_a_hand_can_hold_many_particles():
    """A held body of one point of a skin's triangle: up to 24 particles share the weight."""
    scene = Scene(jello=[Box(points=(3, 3, 3), size=(0.2, 0.2, 0.2))], force=[Grab(stiffness=500.0)], drag=5.0)
    simulation = Simulation(scene)
    particles, weights = np.arange(24), np.full(24, 1 / 24)
    simulation.grab(particles, weights, weights @ simulation.x[:24])
    simulation.advance(3.0)
    assert simulation.held.force == pytest.approx([0.0, 9.81, 0.0], abs=0.02)
    with pytest.raises(ValueError, match="1 to 24"):
        simulation.grab(np.arange(25), np.full(25, 0.04), (0.0, 0.0, 0.0))
