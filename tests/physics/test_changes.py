"""Keyframes: melting, swelling, freezing, gravity and colliders that change with time, and the energy that it takes."""

import numpy as np
import pytest
from reference import spring_forces, twisted

from taichi_jello import (
    Box,
    Contact,
    GravityKeyframe,
    Keyframe,
    Move,
    Plane,
    Region,
    Room,
    Scene,
    SceneError,
    Simulation,
    Snapshot,
)
from taichi_jello.physics.forces.springs.hooke import Springs
from taichi_jello.scene.keyframes import factor

WEIGHTLESS = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def cube(**options):
    return Box(**{"points": (4, 4, 4), "stiffness": 100.0, "damping": 0.0} | options)


def test_springs_with_numbers_of_their_own_have_the_same_forces(forces, epsilon):
    """A painted cube of several hundred materials, whose springs are packed one by one."""
    paint = np.random.default_rng(3).uniform(0.5, 2.0, (5, 5, 5))
    simulation = Simulation(
        Scene(gravity=WEIGHTLESS, jello=[cube(damping=1.0, region=[Region(stiffness_factor=paint)])])
    )
    springs = next(force for force in simulation.system.all_forces if isinstance(force, Springs))
    body, rng = simulation.body, np.random.default_rng(4)
    x, v = twisted(body.x) + rng.normal(0.0, 0.02, body.x.shape), rng.normal(0.0, 1.0, body.x.shape)
    expected = spring_forces(body, x, v)
    assert springs.single
    # x is rounded to epsilon and springs multiply that by up to 200 N/m, 30 of them at a particle.
    assert forces(simulation, x, v) == pytest.approx(expected, abs=30 * 200 * 8 * epsilon)


def test_melted_it_falls_freely(epsilon):
    """From twisted and stiff to no springs at all: the centre of mass never knows."""
    melt = [Keyframe(time=0.1), Keyframe(time=0.2, stiffness=1.0), Keyframe(time=0.4, stiffness=0.0)]
    simulation = Simulation(Scene(jello=[cube(keyframe=melt, damping=0.2)]))
    simulation.restore(Snapshot(0.0, twisted(simulation.body.x), simulation.v))
    start = simulation.x.mean(0)
    simulation.advance(0.5)
    after = simulation.snapshot()
    t = simulation.time
    assert after.x.mean(0) - start == pytest.approx([0.0, -9.81 * t * t / 2, 0.0], abs=2000 * epsilon)
    assert np.ptp(after.v, axis=0).max() > 0.1  # it was in motion when it melted
    simulation.advance(0.1)
    flown = simulation.time - t
    drift = after.v.astype(float) + [0.0, -9.81 * flown, 0.0]
    # Without stiffness its dashpots remain and slow the parts towards each other: momentum stays.
    assert simulation.v.mean(0) == pytest.approx(drift.mean(0), abs=2000 * epsilon)
    assert simulation.energies()["elastic"] == 0.0


def test_the_energy_that_a_change_takes_is_booked():
    """Undamped and swinging, softened and stiffened and swollen: what the energy gains is what the changes put in."""
    rows = [
        Keyframe(time=0.0, stiffness=1.0, rest_length=1.0),
        Keyframe(time=0.1, stiffness=0.2, rest_length=1.2),
        Keyframe(time=0.2, stiffness=2.0, rest_length=0.9),
    ]
    scene = Scene(gravity=WEIGHTLESS, jello=[cube(keyframe=rows, spin=(0.0, 3.0, 1.0))])
    simulation = Simulation(scene, substeps=120)
    simulation.restore(Snapshot(0.0, twisted(simulation.body.x), simulation.v))
    before = sum(simulation.energies().values())
    simulation.advance(0.3)
    gained = sum(simulation.energies().values()) - before
    assert abs(gained) > 0.1 * before
    # RK4 at a tenth of its limit loses (ωh)⁶/144 of a mode's energy a step.
    assert simulation.work["keyframes"] == pytest.approx(gained, rel=2e-4)


def test_swollen_it_comes_to_rest_larger(epsilon):
    rows = [Keyframe(time=0.0, rest_length=1.0), Keyframe(time=0.2, rest_length=1.5)]
    simulation = Simulation(Scene(gravity=WEIGHTLESS, jello=[cube(damping=2.0, keyframe=rows)]))
    simulation.advance(2.0)
    assert np.ptp(simulation.x, axis=0) == pytest.approx([1.5] * 3, rel=1e-4)


FROZEN = [
    Keyframe(time=0.0, stiffness=0.0, damping=0.0),
    Keyframe(time=0.3, stiffness=0.0, damping=0.0, freeze=True),
    Keyframe(time=0.4, stiffness=1.0, damping=8.0),
]


def test_frozen_it_keeps_the_shape_that_it_has_melted_to():
    """Thrown apart without stiffness, then frozen: no energy at that moment, and it stays that large; the other jello
    of the scene does not freeze."""
    other = Box(points=(2, 1, 1), position=(3.0, 0.0, 0.0))
    jello = [cube(damping=0.2, keyframe=FROZEN), other]
    simulation = Simulation(Scene(gravity=WEIGHTLESS, jello=jello, contact=Contact(touch=False)))
    thrown = np.where(simulation.body.jello[:, None] == 0, 0.5 * simulation.body.x, 0.0)
    simulation.restore(Snapshot(0.0, simulation.x, thrown))
    simulation.advance(0.3)
    simulation.energies()
    assert simulation.work == {"keyframes": 0.0}
    simulation.advance(2.0)
    # It flew apart to 1 + 0.5·0.3 m, and went on flying while the springs grew stiff.
    assert np.ptp(simulation.x[:64], axis=0) == pytest.approx([1.15] * 3, rel=0.005)
    assert simulation.energies()["elastic"] < 1e-3
    assert np.ptp(simulation.x[64:, 0]) == pytest.approx(1.0)


def test_what_freezes_and_stiffens_at_once_freezes_first():
    """As loose until it freezes as before, it flies apart to 1 + 0.5·0.3 m; that stays its shape as it is stiff."""
    rows = [
        Keyframe(time=0.0, stiffness=0.0, damping=0.0),
        Keyframe(time=0.3, stiffness=1.0, damping=8.0, freeze=True),
        Keyframe(time=0.5, stiffness=2.0),
    ]
    times = (0.0, 0.2999, 0.3 - 1e-12, 0.4, 9.0)
    assert [factor(rows, "stiffness", time) for time in times] == pytest.approx([0.0, 0.0, 1.0, 1.5, 2.0])
    swelling = [Keyframe(time=1.0, rest_length=1.0), Keyframe(time=2.0, rest_length=2.0, freeze=True)]
    assert factor(swelling, "rest_length", 1.5) == 1.5
    simulation = Simulation(Scene(gravity=WEIGHTLESS, jello=[cube(damping=0.2, keyframe=rows)]))
    simulation.restore(Snapshot(0.0, simulation.x, 0.5 * simulation.body.x))
    simulation.advance(2.0)
    assert np.ptp(simulation.x, axis=0) == pytest.approx([1.15] * 3, rel=0.005)
    assert simulation.energies()["elastic"] < 1e-3


def test_a_run_cut_in_two_remembers_the_shape_it_froze_in(anew):
    lying = cube(damping=0.2, keyframe=FROZEN, position=(0.0, 0.0, 0.0))
    scene = Scene(jello=[lying], collider=[Plane(point=(0.0, -0.5, 0.0))])
    anew()
    whole = Simulation(scene)
    whole.step(40 * whole.substeps)
    end = whole.snapshot()
    whole.reset()
    whole.step(27 * whole.substeps + 3)
    half, work = whole.snapshot(), whole.work
    anew()
    other = Simulation(scene)
    other.restore(half)
    other.energies()
    other.restore(other.snapshot())
    other.step(13 * whole.substeps - 3)
    assert np.array_equal(end.x, other.x) and np.array_equal(end.v, other.v)
    assert other.work == work | {"keyframes": end.memory["work.0.keyframes"]}
    other.reset()
    assert other.work == {"keyframes": 0.0}
    other.change_method("verlet")
    other.step(2 * other.substeps)


def test_gravity_follows_its_keyframes(epsilon):
    rows = [GravityKeyframe(time=0.0, gravity=(0, 0, 0)), GravityKeyframe(time=0.5, gravity=(6.0, 0, 0))]
    simulation = Simulation(Scene(keyframe=rows, jello=[Box(points=(2, 2, 2), mass=2.0)]))
    simulation.advance(0.5)
    # Each frame has the gravity of its middle, so 12 m/s³ T²/2 is exact; to T³/6 every frame of h adds h³/12.
    assert simulation.v.mean(0) == pytest.approx([12 * 0.125, 0.0, 0.0], abs=1000 * epsilon)
    fallen = 12 * (0.125 / 6 + 0.5 * simulation.frame_dt**2 / 12)
    assert simulation.x.mean(0) == pytest.approx([fallen, 0.0, 0.0], abs=1000 * epsilon)
    energies = simulation.energies()
    assert sum(energies.values()) == pytest.approx(simulation.work["keyframes"], abs=2000 * epsilon)
    assert "gravity" not in simulation.tuning


def test_colliders_follow_their_keyframes():
    lift = [Move(time=0.2, offset=(0, 0, 0)), Move(time=0.6, offset=(0, 0.8, 0.0))]
    plane = Plane(keyframe=lift)
    assert plane.moved_rows(0.3, 0.4)[0, :6] == pytest.approx([0, 0.2, 0, 0, 2, 0])
    assert plane.place(5.0) == pytest.approx([0, 0.8, 0])
    simulation = Simulation(Scene(jello=[cube(damping=1.0, position=(0.0, 0.51, 0.0))], collider=[plane]))
    simulation.advance(1.5)
    assert simulation.x[:, 1].min() == pytest.approx(0.8, abs=0.02)


def test_a_room_that_begins_elsewhere_must_hold_the_jello_there():
    up = [Move(time=0.0, offset=(0.0, 5.0, 0.0))]
    Simulation(Scene(jello=[cube(position=(0.0, 6.0, 0.0))], collider=[Room(keyframe=up)]))
    with pytest.raises(SceneError, match=r"collider.0: expected a box around jello.0"):
        Simulation(Scene(jello=[cube(position=(0.0, 1.0, 0.0))], collider=[Room(keyframe=up)]))


def test_the_step_is_safe_for_the_stiffest_keyframe():
    rows = [
        Keyframe(time=1.0, stiffness=0.25, damping=1.0),
        Keyframe(time=2.0, stiffness=4.0, damping=0.5),
        Keyframe(time=3.0),
    ]
    changing, hard = Simulation(Scene(jello=[cube(keyframe=rows)])), Simulation(Scene(jello=[cube(stiffness=400.0)]))
    assert changing.safe_dt == pytest.approx(hard.safe_dt, rel=1e-6)
    both = [Simulation(Scene(jello=[cube(damping=0.1, keyframe=k)], gravity=WEIGHTLESS)) for k in (rows, [])]
    first, plain = (simulation.system.rates[0] for simulation in both)
    assert first.damping == pytest.approx(plain.damping)
    assert first.damping_time == pytest.approx(0.5 / 4.0 * plain.damping_time)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Keyframe(time=-1.0), "time: expected a finite number of at least 0, got -1"),
        (lambda: Keyframe(time=1.0, stiffness=-2.0), "stiffness: expected a finite number of at least 0"),
        (lambda: Keyframe(time=1.0, freeze=1), "freeze: expected true or false, got 1"),
        (lambda: GravityKeyframe(time=0.0, gravity=(0, 1)), "gravity: expected three numbers"),
        (lambda: Move(time=0.0, offset="up"), "offset: expected three numbers"),
        (
            lambda: Box(keyframe=[Keyframe(time=2.0), Keyframe(time=1.5)]),
            "keyframe.1.time: expected more than 2, the time before it, got 1.5",
        ),
        (
            lambda: Scene(jello=[Box()], keyframe=[GravityKeyframe(time=1, gravity=(0, 0, 0))] * 2),
            "keyframe.1.time: expected more than 1",
        ),
        (
            lambda: Plane(keyframe=[Move(time=1, offset=(0, 0, 0)), Move(time=0, offset=(0, 0, 0))]),
            "keyframe.1.time: expected more than 1",
        ),
    ],
)
def test_mistakes_name_the_key(make, words):
    with pytest.raises(SceneError) as caught:
        make()
    assert str(caught.value).startswith(words)
