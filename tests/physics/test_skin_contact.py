"""Contact of embedded skins: what a ball rests on, what its points share, and that no step it calls safe explodes."""

import numpy as np
import pytest

from taichi_jello import Ball, Box, Contact, Plane, Room, Scene, Simulation, Snapshot, Sphere
from taichi_jello.physics.forces.collider_contact.skin_penalty import SkinContact
from taichi_jello.physics.forces.contact_law import shares
from taichi_jello.run.explain import facts


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def lowest(simulation):
    return simulation.body.skin_points(simulation.x)[:, 1].min()


def test_a_ball_rests_on_its_skin():
    """The skin sinks in by what carries the weight; the scaffold of cells reaches below the ground untouched."""
    ball = Ball(resolution=4, position=(0.0, 0.5, 0.0), stiffness=600.0, damping=1.0)
    scene = Scene(jello=[ball], collider=[Plane()], drag=3.0)  # without drag it rolls on for long
    simulation = Simulation(scene)
    simulation.advance(4.0)
    assert simulation.energies()["kinetic"] < 1e-6
    points = simulation.body.skin_points(simulation.x)
    depth = np.maximum(-points[:, 1], 0.0)
    carried = simulation.tuning["contact_stiffness"] * (shares(simulation.body) @ depth)
    assert carried == pytest.approx(9.81, rel=1e-3)
    assert 0.0 < depth.max() < 0.02 and simulation.x[:, 1].min() < -depth.max()


def test_forces_are_those_of_the_points_by_their_weights(forces):
    """Against a plain sum in NumPy: k share depth along the normal, handed to the corners by weight."""
    contact = Contact(stiffness=800.0, damping=0.0, friction=0.0)
    ball = Ball(resolution=4, radius=0.3, springs=(), position=(0.1, 0.2, 0.0), rotation=(10.0, 20.0, 30.0))
    still = {"gravity": (0.0, 0.0, 0.0), "contact": contact}
    sphere = Sphere(center=(0.1, 0.65, 0.1), radius=0.2)
    simulation = Simulation(Scene(jello=[ball], collider=[Plane(), sphere], **still), dt=1e-3)
    body = simulation.body
    x = simulation.x * [1.1, 1.0, 0.9]
    p, k = body.skin_points(x), 800.0 * shares(body)
    push = k[:, None] * np.maximum(-p[:, 1:2], 0.0) * [0.0, 1.0, 0.0]
    away = p - sphere.center
    far = np.linalg.norm(away, axis=1, keepdims=True)
    push += k[:, None] * np.maximum(sphere.radius - far, 0.0) * away / far
    expected = np.zeros_like(x)
    np.add.at(expected, body.skin_corners, body.skin_weights[:, :, None] * push[:, None])
    found = forces(simulation, x, np.zeros_like(x))
    assert (np.abs(expected).max(0) > 0.1).all()
    assert found == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    depths = np.maximum(-p[:, 1], 0.0) ** 2 + np.maximum(sphere.radius - far[:, 0], 0.0) ** 2
    assert simulation.energies()["contact"] == pytest.approx(0.5 * k @ depths, rel=1e-5)


def test_shares_add_up_to_the_area_in_sides_of_cells():
    body = Ball(resolution=6, radius=0.3).body()
    a, b, c = (body.skin_points(body.rest)[body.skin[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert shares(body).sum() == pytest.approx(area / 0.1**2)


def test_the_bound_holds_for_the_stiffest_configuration():
    """All points pressed from one side at once: the true largest eigenvalue is below the bound, and not far."""
    body = Ball(resolution=4).body()
    simulation = Simulation(Scene(jello=[Ball(resolution=4)], collider=[Plane()]))
    force = next(f for f in simulation.system.all_forces if isinstance(f, SkinContact))
    weights = np.zeros((len(body.skin_corners), len(body)))
    np.add.at(weights, (np.arange(len(weights))[:, None], body.skin_corners), body.skin_weights)
    weights /= np.sqrt(body.mass)
    true = np.linalg.eigvalsh(weights.T @ (shares(body)[:, None] * weights))[-1]
    bound = force.steepest(np.ones(1))
    assert true <= bound * (1 + 1e-9) and bound < 2.0 * true


def test_undamped_bounces_in_a_room_do_not_gain_energy():
    ball = Ball(resolution=4, radius=0.3, position=(0.0, 0.7, 0.0), velocity=(3.0, 2.0, 1.0), damping=0.0)
    room = Room(min=(-0.5, 0.0, -0.5), max=(0.5, 1.4, 0.5))
    simulation = Simulation(Scene(jello=[ball], collider=[room], contact=Contact(damping=0.0, friction=0.0)))
    start = sum(simulation.energies().values())
    for _ in range(120):
        simulation.frame()
        # A penalty wall's force has a kink, at which each bounce errs by a little of either sign.
        assert sum(simulation.energies().values()) < 1.01 * start


def test_with_a_box_beside_it_each_touches_in_its_own_way():
    """The box's particles and the ball's skin: the ball moves as it does alone."""
    ball = Ball(resolution=3, radius=0.2, position=(1.0, 0.22, 0.0))
    box = Box(points=(3, 3, 3), size=(0.3, 0.3, 0.3), position=(-1.0, 0.17, 0.0))
    ground = {
        "collider": [Plane()],
        "contact": Contact(friction=0.0, touch=False),
    }  # friction's grip goes by the least mass of all
    alone, both = (Simulation(Scene(jello=list(j), **ground), dt=5e-4) for j in ((ball,), (ball, box)))
    for simulation in (alone, both):
        simulation.advance(0.11)
    exact = both.x.dtype == np.float64
    assert both.x[: len(alone.x)] == pytest.approx(alone.x, abs=1e-12 if exact else 1e-5)
    assert -0.01 < both.x[len(alone.x) :, 1].min() < 0.0 and -0.03 < lowest(alone) < 0.0
    compiled = [set(facts(simulation)["compiled_in"]) & {"contact", "skin contact"} for simulation in (alone, both)]
    assert compiled == [{"skin contact"}, {"contact", "skin contact"}]


def test_same_bits_in_every_form(request):
    ball = Ball(resolution=5, position=(0.0, 0.49, 0.0), rotation=(30.0, 20.0, 10.0), velocity=(1.0, 0.0, 0.0))
    box = Box(points=(3, 3, 3), position=(2.0, 0.5, 0.0))
    scene = Scene(jello=[ball, box], collider=[Plane()], contact=Contact(touch=False))
    forms = ({"team": 1}, {"team": 2}, {"team": 0}) if request.config.getoption("--arch") == "cpu" else ({}, {})
    ends = []
    for form in forms:
        simulation = Simulation(scene, method="symplectic-euler", **form)
        simulation.advance(0.03)
        ends.append(simulation.x)
    assert lowest(simulation) < 0.0 and all(np.array_equal(ends[0], other) for other in ends[1:])
