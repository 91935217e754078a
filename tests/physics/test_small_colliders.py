"""Colliders that fit between the particles: faces and edges touch them, by forces that are shared out."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_jello import Ball, Block, Box, Contact, Plane, Rope, Scene, Sheet, Simulation, Snapshot, Sphere
from taichi_jello.physics.forces.collider_contact.face_penalty import FaceContact
from taichi_jello.physics.forces.collider_contact.surface_points import (
    HOLE,
    MAX_PARTS,
    TOGETHER,
    Faces,
    of_skin,
)
from taichi_jello.run.explain import facts

SPHERE = Sphere(radius=0.1)
SOFT = Box(points=(4, 4, 4), size=(0.6, 0.6, 0.6), mass=0.2, stiffness=500.0, damping=1.0, position=(0.0, 0.4, 0.0))
CUBE = Box(points=(5, 5, 5), size=(0.6, 0.6, 0.6), mass=0.2, stiffness=500.0, position=(0.0, 0.5, 0.0))


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def faces_of(simulation):
    return [force for force in simulation.system.all_forces if isinstance(force, FaceContact)]


def test_only_small_colliders_have_points_between_particles():
    """0.15 m between particles: a sphere of 0.3 m is no longer small, nor is a slab."""
    for collider, some in ((SPHERE, True), (Sphere(radius=0.15), False), (Block(size=(9.0, 0.3, 9.0)), False)):
        told = facts(Simulation(Scene(jello=[CUBE], collider=[Plane(), collider])))
        assert ("edge contact" in told["compiled_in"]) == some and ("edge contact" in told["fields"]) == some
    assert not faces_of(Simulation(Scene(jello=[CUBE], collider=[SPHERE], contact=Contact(stiffness=0.0))))


def test_points_are_a_grid_on_the_faces_without_the_particles():
    """The sides of 6 faces of 4 × 4 squares in m parts: the grid's points on a cube's surface less the particles."""
    body = CUBE.body()
    faces = Faces.bare(body)
    m = int(faces.parts([SPHERE])[0, 0])
    assert m == np.ceil(0.15 / (HOLE * 0.2)) and faces.side == pytest.approx([0.15])
    triangle, weights = faces.grid(np.full(len(faces.triangles), m))
    places = np.einsum("sk,skd->sd", weights, body.rest[faces.triangles[triangle]])
    assert len(places) == (6 * (4 * m) ** 2 + 2) - (6 * 4**2 + 2)
    assert len(np.unique(np.round(places / (0.15 / m)).astype(int), axis=0)) == len(places)
    assert np.abs(places).max(1) == pytest.approx(0.3) and weights.sum(1) == pytest.approx(1.0)


def test_sheets_have_them_once_and_ropes_on_their_segments():
    rope = Rope(points=5, length=1.0)
    for jello, count in ((Sheet(points=(3, 3), size=(1.0, 1.0)), 9**2 - 3**2), (rope, 4 * 3)):
        faces = Faces.bare(jello.body())
        assert len(faces.grid(np.full(len(faces.triangles), 4))[0]) == count
        assert not len(faces.grid(np.ones(len(faces.triangles), int))[0])


def pressed(x, points, radius):
    """(S, 3) how deep points between particles at x, or these, are in a sphere at the origin, along its normals."""
    p = x if points is None else np.einsum("sk,skd->sd", points.weights, x[points.corners])
    far = np.linalg.norm(p, axis=1, keepdims=True)
    return np.maximum(radius - far, 0.0) * p / far


@pytest.mark.parametrize("jello", [CUBE, Ball(resolution=4, radius=0.4, springs=())], ids=["faces", "skin"])
def test_forces_are_those_of_the_points_by_their_weights(jello, forces):
    """k share depth along the normal, handed to the corners by weight: together what the sphere gets."""
    scene = Scene(
        gravity=(0.0, 0.0, 0.0), jello=[jello], collider=[SPHERE], contact=Contact(stiffness=800.0, friction=0.0)
    )
    simulation = Simulation(scene, dt=1e-4)
    simulation.tune(contact_damping=0.0)
    (force,) = faces_of(simulation)
    body, points = simulation.body, force.touching
    lowest = (body.skin_points(body.x) if len(body.skin) else body.x).min(0)[1]
    x = body.x - [body.x[:, 0].mean() - 0.03, lowest - 0.07, body.x[:, 2].mean() - 0.02]
    push = 800.0 * points.share[:, None] * pressed(x, points, 0.1)
    expected = np.zeros_like(x)
    np.add.at(expected, points.corners, points.weights[:, :, None] * push[:, None])
    assert np.abs(push.sum(0)).max() > 1.0 and expected.sum(0) == pytest.approx(push.sum(0))
    others = of_skin(body) if len(body.skin) else None
    for_others = 800.0 * pressed(x, others, 0.1)
    if others:
        np.add.at(expected, others.corners, others.weights[:, :, None] * (others.share[:, None] * for_others)[:, None])
    else:
        expected += for_others
    assert forces(simulation, x, np.zeros_like(x)) == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())


def middle(simulation):
    return np.average(simulation.x.astype(float), axis=0, weights=simulation.body.mass)


@pytest.mark.parametrize("method", ["rk4", "xpbd", "backward-euler"])
def test_a_cube_rests_on_small_spheres_and_is_stopped_by_them(method):
    """It fell through. Set on four, it stays without creep, and the points carry its weight. At 8 m/s its face reaches
    the cores. An implicit step is a frame long, so only 4 m/s are stopped."""
    spheres = [Sphere(center=(x, 0.0, z), radius=0.1) for x in (-0.15, 0.15) for z in (-0.15, 0.15)]
    simulation = Simulation(Scene(jello=[SOFT], collider=spheres, drag=4.0), method=method)
    simulation.advance(1.5)
    before = middle(simulation)
    assert 0.36 < before[1] < 0.41
    simulation.advance(0.5)
    assert np.linalg.norm(middle(simulation) - before) < 5e-4
    carried, k = 0.0, simulation.tuning["contact_stiffness"]
    for sphere in spheres:
        for points in (faces_of(simulation)[0].touching, None):
            push = pressed(simulation.x - sphere.center, points, sphere.radius)
            carried += k * (push * (1.0 if points is None else points.share[:, None])).sum(0)
    assert carried[1] == pytest.approx(0.2 * 9.81, rel=0.1)  # friction on their slanted sides carries the rest
    x, speed = simulation.body.x, 4.0 if method == "backward-euler" else 8.0
    simulation.restore(Snapshot(0.0, x, np.full_like(x, -speed) * [0.0, 1.0, 0.0]))
    for _ in range(12):
        simulation.frame()
        assert middle(simulation)[1] > 0.15
    assert simulation.v[:, 1].mean() > 0.0 or method == "backward-euler"


@pytest.mark.parametrize("turn", [0.0, 45.0], ids=["face on a pillar", "edge across a wall"])
def test_what_is_pushed_onto_the_rim_of_a_thin_block_is_stopped(turn):
    """Neither meets a particle of the cube at first; it would be 0.4 m lower."""
    cube = Box(points=(4, 4, 4), size=(0.6, 0.6, 0.6), mass=0.2, stiffness=500.0, rotation=(0.0, 0.0, turn))
    reach = 0.3 if turn == 0.0 else 0.3 * np.sqrt(2.0)
    block = Block(size=(0.08 if turn == 0.0 else 2.0, 1.0, 0.08), center=(0.0, -0.5, 0.0))
    scene = Scene(jello=[replace(cube, position=(0.0, reach + 0.1, 0.0))], collider=[block])
    simulation = Simulation(scene, method="symplectic-euler")
    for _ in range(20):
        simulation.frame()
        assert middle(simulation)[1] > reach - 0.08


@pytest.mark.parametrize(
    "jello, collider",
    [
        (Sheet(points=(8, 8), position=(0.0, 0.2, 0.0), mass=0.3, damping=0.1), SPHERE),
        (Rope(points=11, length=2.0, position=(0.1, 0.2, 0.0), stiffness=2000.0), Block(size=(0.12, 0.12, 2.0))),
        (Ball(resolution=4, radius=0.3, position=(0.0, 0.4, 0.0), stiffness=500.0), Sphere(radius=0.05)),
    ],
    ids=["sheet", "rope", "skin"],
)
def test_sheets_ropes_and_skins_are_held_too(jello, collider):
    """In free fall even the ball's top would be below the collider."""
    simulation = Simulation(Scene(jello=[jello], collider=[collider]), method="symplectic-euler")
    simulation.advance(0.5)
    assert faces_of(simulation) and simulation.x[:, 1].max() > 0.0


def test_the_energy_of_a_bounce_is_booked():
    simulation = Simulation(Scene(jello=[CUBE], collider=[SPHERE]), method="symplectic-euler", ledger=True)
    start = sum(simulation.energies().values())
    simulation.advance(0.6)
    # It has bounced; as for other contact, friction makes the force less smooth than the quadrature wants.
    assert simulation.v[:, 1].mean() > 0.0 and abs(simulation.energy_residual) < 2e-3 * start


def test_the_bound_holds_for_the_stiffest_configuration():
    simulation = Simulation(Scene(jello=[CUBE], collider=[SPHERE]))
    (force,) = faces_of(simulation)
    points, body = force.touching, simulation.body
    weights = np.zeros((len(points), len(body)))
    np.add.at(weights, (np.arange(len(points))[:, None], points.corners), points.weights)
    weights /= np.sqrt(body.mass)
    true = np.linalg.eigvalsh(weights.T @ (points.share[:, None] * weights))[-1]
    bound = force.steepest(np.ones(1))
    assert true <= bound * (1 + 1e-9) and bound < 1.5 * true
    assert bound * body.mass[0] < TOGETHER * 1.01


def test_a_snapshot_goes_on_to_the_same_bits_in_every_form(request):
    on_cpu = request.config.getoption("--arch") == "cpu"
    scene = Scene(jello=[SOFT], collider=[SPHERE])
    ends = []
    for form in ({"team": 2}, {"team": 0}) if on_cpu else ({}, {}):
        simulation = Simulation(scene, method="symplectic-euler", **form)
        simulation.advance(0.06)
        kept = simulation.snapshot()
        simulation.advance(0.05)
        ends.append(simulation.x)
        simulation.restore(kept)
        simulation.advance(0.05)
        ends.append(simulation.x)
    assert any("held points" in name for name in kept.memory)
    assert all(np.array_equal(ends[0], other) for other in ends[1:])


def test_what_is_torn_touches_nothing():
    sheet = Sheet(points=(4, 4), position=(0.0, 1.0, 0.0), tear_strain=0.5, stiffness=100.0)
    simulation = Simulation(Scene(gravity=(0.0, 0.0, 0.0), jello=[sheet], collider=[SPHERE]), method="symplectic-euler")
    (force,) = faces_of(simulation)
    x = simulation.x.copy()
    x[x[:, 0] > 0.2, 0] += 1.0  # far beyond the strain
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    for _ in range(2):
        simulation.frame()
    torn = ~force.whole
    assert torn.any() and not torn.all()
    share = force.skin.to_numpy()[:, 3]
    assert (share[torn[force.skin_cells]] == 0.0).all() and (share[~torn[force.skin_cells]] > 0.0).all()


def test_no_side_is_cut_into_too_many_parts():
    simulation = Simulation(Scene(jello=[CUBE], collider=[Sphere(radius=0.001)]))
    (force,) = faces_of(simulation)
    assert (force.touching.weights * MAX_PARTS) == pytest.approx(np.round(force.touching.weights * MAX_PARTS))
