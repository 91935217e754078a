"""Contact with planes, rooms and spheres: rest, depth, friction, and energy without any damping."""

import numpy as np
import pytest
from reference import twisted

from taichi_jello import Box, Contact, Plane, Room, Scene, Simulation, Snapshot, Sphere


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def test_dropped_cube_comes_to_rest_within_ten_seconds():
    scene = Scene(jello=[Box(position=(0.0, 1.5, 0.0), rotation=(20.0, 0.0, 35.0))], collider=[Plane()])
    simulation = Simulation(scene)
    simulation.advance(10.0)
    assert simulation.energies()["kinetic"] < 1e-6
    y = simulation.x[:, 1]
    touching = np.count_nonzero(y < 0.0)
    mean_static_depth = 9.81 / (simulation.tuning["contact_stiffness"] * touching)
    assert touching >= 64
    assert -y.min() <= 3 * mean_static_depth


def energies_of_a_minute(simulation):
    energy = []
    for _ in range(600):
        simulation.advance(0.1)
        energy.append(sum(simulation.energies().values()))
    return np.array(energy)


def minute_trend(energy):
    """How far the fitted line rises within the minute, over the mean energy."""
    return 60.0 * np.polyfit(np.arange(600) * 0.1, energy, 1)[0] / energy.mean()


def test_verlet_energy_has_no_trend_in_free_flight_without_damping():
    box = Box(points=(4, 4, 4), mass=0.125, damping=0.0)
    simulation = Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=[box]), method="verlet")
    x = twisted(simulation.body.x)
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    energy = energies_of_a_minute(simulation)
    # It swings by 1 % from moment to moment at this step; the line through 600 of them is known to about 0.1 %.
    assert abs(minute_trend(energy)) < 2e-3
    assert np.abs(energy / energy[0] - 1).max() < 0.03


def test_verlet_energy_has_no_trend_in_bouncing_without_damping():
    """A penalty floor's force has a kink, at which each bounce errs by a little of either sign; at half the automatic
    step the sum over a minute is below a thousandth (at the automatic step it is below a hundredth)."""
    box = Box(points=(4, 4, 4), mass=0.125, position=(0.0, 0.8, 0.0), rotation=(10.0, 0.0, 20.0), damping=0.0)
    scene = Scene(jello=[box], collider=[Plane()], contact=Contact(damping=0.0, friction=0.0))
    substeps = 2 * Simulation(scene, method="verlet").substeps
    energy = energies_of_a_minute(Simulation(scene, method="verlet", substeps=substeps))
    assert abs(minute_trend(energy)) < 1e-3
    assert np.abs(energy / energy[0] - 1).max() < 5e-3


def test_a_point_rests_on_a_tilted_plane_or_slides_down_it():
    """Coulomb: it stays (creeps viscously) below tan α = μ and accelerates at g(sin α - μ cos α) above."""
    alpha, g = np.radians(30.0), 9.81
    normal = (np.sin(alpha), np.cos(alpha), 0.0)

    def slide(friction):
        scene = Scene(
            jello=[Box(points=(1, 1, 1), mass=0.01, position=(0.0, 0.0, 0.0))],
            collider=[Plane(normal=normal)],
            contact=Contact(stiffness=2000.0, damping=2.0, friction=friction),
        )
        simulation = Simulation(scene)
        simulation.advance(0.5)
        before = np.linalg.norm(simulation.v)
        simulation.advance(0.5)
        return np.linalg.norm(simulation.v), (np.linalg.norm(simulation.v) - before) / 0.5

    speed, acceleration = slide(0.9)
    assert speed < 0.02 and abs(acceleration) < 1e-3
    assert slide(0.3)[1] == pytest.approx(g * (np.sin(alpha) - 0.3 * np.cos(alpha)), rel=0.01)
    assert slide(0.0)[1] == pytest.approx(g * np.sin(alpha), rel=1e-3)


def test_room_keeps_every_point_inside():
    room = Room(min=(-1.2, 0.0, -1.2), max=(1.2, 2.4, 1.2))
    box = Box(position=(0.0, 1.2, 0.0), velocity=(8.0, 6.0, 7.0))
    scene = Scene(jello=[box], collider=[room], contact=Contact(stiffness=2000.0, damping=0.5))
    simulation = Simulation(scene)
    walls = np.zeros(6, bool)
    for _ in range(240):
        simulation.frame()
        x = simulation.x
        # The deepest that one point alone can sink: v √(m/k), for the fastest corner at about 30 m/s.
        depth = 30.0 * np.sqrt((1.0 / 512) / simulation.tuning["contact_stiffness"])
        assert np.all(x > np.array(room.min) - depth) and np.all(x < np.array(room.max) + depth)
        walls |= np.concatenate([x.min(0) < room.min, x.max(0) > room.max])
    assert walls.all()


def test_a_moving_sphere_pushes_and_a_still_one_holds():
    jello = [Box(points=(3, 3, 3), size=(0.3, 0.3, 0.3), mass=0.05)]
    still = Scene(jello=jello, collider=[Sphere(center=(0.8, 0.0, 0.0), radius=0.3)], gravity=(0.0, 0.0, 0.0))
    simulation = Simulation(still)
    simulation.advance(0.5)
    assert np.abs(simulation.v).max() < 1e-12  # nothing touches, nothing moves
    ram = Sphere(center=(0.8, 0.0, 0.0), radius=0.3, velocity=(-2.0, 0.0, 0.0))
    simulation = Simulation(Scene(jello=jello, collider=[ram], gravity=(0.0, 0.0, 0.0)))
    simulation.advance(0.6)
    assert simulation.v[:, 0].mean() < -2.0  # thrown off faster than the ram moves
    center = ram.origin(simulation.time)
    assert np.linalg.norm(simulation.x - center, axis=1).min() > 0.29


def test_symmetric_colliders_act_alike_in_any_orientation():
    """The same drop seen from a turned frame: gravity, plane and cube turned together."""
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    plain = Simulation(Scene(jello=[Box(points=(1, 1, 1), position=(0.0, 0.2, 0.0), velocity=(1.0, 0.0, 0.0))],
                             collider=[Plane()]))  # fmt: skip
    turned = Simulation(
        Scene(
            gravity=tuple(turn @ [0.0, -9.81, 0.0]),
            jello=[
                Box(
                    points=(1, 1, 1),
                    position=tuple(turn @ [0.0, 0.2, 0.0]),
                    velocity=tuple(turn @ [1.0, 0.0, 0.0]),
                )
            ],
            collider=[Plane(normal=tuple(turn @ [0.0, 1.0, 0.0]))],
        )
    )
    for simulation in (plain, turned):
        simulation.advance(0.6)
    assert turned.x[0] == pytest.approx(turn @ plain.x[0], abs=1e-9 if turned.x.dtype == np.float64 else 1e-4)


def test_contact_energy_follows_a_moving_sphere():
    """A free point deep in the path of a sphere: ½ k depth², with the sphere where it is at that moment."""
    ram = Sphere(center=(0.0, -1.0, 0.0), radius=0.5, velocity=(0.0, 1.0, 0.0))
    point = Box(points=(1, 1, 1), mass=1e6)  # too heavy to be moved
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[point], collider=[ram], contact=Contact(stiffness=100.0))
    simulation = Simulation(scene, substeps=4)
    for steps in (4 * 33, 2, 1, 4):
        simulation.step(steps)
        depth = max(0.0, 0.5 - abs(simulation.time - 1.0))
        assert simulation.energies()["contact"] == pytest.approx(50.0 * depth**2, rel=1e-3, abs=1e-9)
    assert depth > 0.05
