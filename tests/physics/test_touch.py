"""Contact of jellos with each other: equal and opposite, at rest, at speed, from deep inside; thin ones; themselves."""

from dataclasses import replace

import numpy as np
import pytest
from surfaces import heights
from touching_pairs import placed, touch

from taichi_jello import (
    Ball,
    Box,
    Contact,
    Pin,
    Plane,
    Rope,
    Scene,
    SceneError,
    Sheet,
    Simulation,
    Snapshot,
    scenefiles,
)
from taichi_jello.physics.forces.soft_contact.search import neighbour_list
from taichi_jello.physics.forces.soft_contact.search.neighbour_list import FULL
from taichi_jello.physics.forces.soft_contact.surface.exits import inner_neighbours, ways_out
from taichi_jello.run.explain import facts
from taichi_jello.scene.body import join
from taichi_jello.shapes.lattice import rotation
from taichi_jello.studies._contact.pairs import Pair, posed, thrown
from taichi_jello.support import runtime

WEIGHTLESS = {"gravity": (0.0, 0.0, 0.0)}


@pytest.fixture(scope="module", autouse=True)
def taichi(request):
    """In f32: the figures for drift are for it."""
    runtime.start(request.config.getoption("--arch"), "f32")


def cube(*position, points=4, **options):
    return Box(points=(points,) * 3, position=position, **options)


def middles(simulation):
    return [simulation.x[simulation.body.jello == j].mean(0) for j in range(len(simulation.scene.jello))]


def momentum(simulation):
    return (simulation.body.mass[:, None] * simulation.v.astype(np.float64)).sum(0)


@pytest.fixture(scope="module")
def crash():
    """Two cubes that hit each other askew in free space, and their simulation."""
    jello = [cube(0.0, 0.0, 0.0, velocity=(1.5, 0.0, 0.0)),
             cube(1.2, 0.2, 0.3, rotation=(10, 20, 30), velocity=(-1.5, 0.0, 0.0), spin=(0.0, 1.0, 0.0))]  # fmt: skip
    return Simulation(Scene(**WEIGHTLESS, jello=jello), method="rk4")


def test_momentum_of_two_jellos_that_collide_does_not_drift(crash):
    crash.reset()
    before, total = momentum(crash), np.sum(crash.body.mass[:, None] * np.abs(crash.v))
    for _ in range(40):
        crash.frame()
        assert np.abs(momentum(crash) - before).max() <= 1e-6 * total
    first, second = (crash.v[crash.body.jello == j].mean(0) for j in (0, 1))
    assert first[0] < 0.0 < second[0]  # thrown back


def test_the_same_bits_after_a_restore_and_with_other_lists(crash, monkeypatch):
    crash.reset()
    for _ in range(5):
        crash.frame()
    middle = crash.snapshot()
    for _ in range(5):
        crash.frame()
    end = crash.snapshot()
    near = touch(crash).near
    pairs = near.listed.to_numpy().sum()
    for least, most in ((0.05, 0.5), (0.6, 2.0)):
        monkeypatch.setattr(neighbour_list, "MIN_MARGIN", least)
        monkeypatch.setattr(neighbour_list, "MAX_MARGIN", most)
        crash.restore(middle)
        for _ in range(5):
            crash.frame()
        assert np.array_equal(crash.x, end.x) and np.array_equal(crash.v, end.v)
    assert near.listed.to_numpy().sum() > pairs > 0  # the other lists were longer


def test_the_list_holds_every_point_near_an_element(crash):
    crash.reset()
    for _ in range(8):
        crash.frame()
    crash.system.write(*crash.system.read())
    crash.energies()
    near = touch(crash).near
    number, found, x = near.listed.to_numpy(), near.found.to_numpy(), crash.x
    margin = near.margins.margin.to_numpy()
    order, first, last = (field.to_numpy() for field in (near.tree_order, near.tree_first, near.tree_last))
    jello, corners = crash.body.jello, x[near.surface.touching.nodes]
    within = np.einsum("pk,eka->epa", trilinear(np.linspace(0.0, 1.0, 5)), corners)  # places in every cell
    owner = jello[near.surface.touching.nodes[:, 0]]
    some = 0
    for q, i in enumerate(near.surface.touching.points):
        reach = 0.999 * (margin[i] + margin[near.surface.touching.nodes].min(1))
        inside = np.linalg.norm(within - x[i], axis=2).min(1) < reach
        listed = found[q * near.slots :][: number[q]].tolist()
        assert len(set(listed)) == number[q]
        listed = [e for n in listed for e in order[first[n] : last[n]]]
        some += np.count_nonzero(inside & (owner != jello[i]))
        assert set(np.flatnonzero(inside & (owner != jello[i]))) <= set(listed)
    assert some > 20


def test_lists_have_room_however_far_jellos_fly_in_a_frame():
    """A strip and a ring of 0.1 m that come by 0.33 m a frame: near to a point was all that it would come by in three
    frames, for which there was no room; the strip went through."""
    pair = Pair("ring", "strip", 0.1)
    simulation = pair.simulation("rk4")
    near = touch(simulation).near
    (told,) = thrown(simulation, 0.1, [30])
    assert not told["through"]
    first, (low, high, way) = (simulation.body.jello == 0)[:, None], posed(simulation, 30)
    simulation.restore(Snapshot(0.0, np.concatenate([low - 0.2 * way, high]), first * 20.0 * way))
    for _ in range(4):
        simulation.step(6)
        assert not near.state[FULL]
        assert near.margins.clock[1] >= simulation.dt / simulation.system.parts


def trilinear(steps):
    """(P, 8): the weights of a cell's corners in a grid of places in it."""
    a, b, c = (g.ravel()[:, None] for g in np.meshgrid(steps, steps, steps))
    k = np.arange(8)
    return (np.where(k & 4, a, 1 - a)) * (np.where(k & 2, b, 1 - b)) * (np.where(k & 1, c, 1 - c))


@pytest.mark.parametrize("shift", [(0.5, 0.0, 0.0), (0.5, 0.1, 0.13), (0.5, 0.5, 0.5)])
def test_a_pair_that_overlaps_by_half_comes_apart(shift, crash):
    rest = crash.body.x[crash.body.jello == 0]
    x = np.concatenate([rest, rest + shift])
    crash.restore(Snapshot(0.0, x, np.zeros_like(x)))
    crash.advance(1.0)
    first, second = middles(crash)
    assert np.linalg.norm(second - first) > np.sqrt(3.0)  # no part of one can be in the other
    assert crash.energies()["contact"] == 0.0


def test_however_two_that_overlap_by_half_are_turned_they_come_apart(crash):
    first, draw = crash.body.jello == 0, np.random.default_rng(0)
    rest = crash.body.rest[first]
    for _ in range(6):
        turn, way = np.linalg.qr(draw.standard_normal((3, 3)))[0], draw.standard_normal(3)
        turn *= np.sign(np.linalg.det(turn))
        x = np.concatenate([rest, rest @ turn.T + 0.5 * way / np.linalg.norm(way)])
        crash.restore(Snapshot(0.0, x, np.zeros_like(x)))
        crash.advance(0.25)
        low, high = middles(crash)
        assert np.linalg.norm(high - low) > np.sqrt(3.0) and crash.energies()["contact"] == 0.0


def test_a_corner_that_comes_in_over_an_edge_is_not_pressed_at_once_as_deep_as_it_is_behind_it(crash):
    """A corner 0.1 m below the top of the other cube crosses its side, towards which it faces."""
    first = crash.body.jello == 0
    x, depth, energy = crash.body.x.copy(), 0.1, []
    x[~first] = x[first] + [-0.01, 1.0 - depth, -0.85]
    corner = np.flatnonzero(~first)[np.argmax((x[~first] - x[~first].mean(0)) @ [1.0, -1.0, 1.0])]
    for beyond in (1e-3, -1e-3):  # m
        x[corner, 0] = x[first, 0].max() + beyond
        crash.restore(Snapshot(0.0, x, np.zeros_like(x)))
        energy.append(crash.energies()["contact"])
    # Of what other points store a little changes with the corner's place: by 2 mm of their depth, about 0.1 m too.
    assert energy[0] > 0.0 and abs(energy[1] - energy[0]) < 0.1 * 0.5 * crash.tuning["contact_stiffness"] * depth**2


def test_a_jello_thrown_at_twenty_metres_a_second_does_not_pass():
    simulation = Simulation(Scene(**WEIGHTLESS, jello=[cube(0.0, 0.0, 0.0), cube(-1.6, 0.1, 0.13)]))
    v = np.where((simulation.body.jello == 0)[:, None], 0.0, [20.0, 0.0, 0.0])
    for turn in (np.eye(3), rotation((10.0, 20.0, 30.0))):
        placed(simulation, (np.eye(3), turn), (-1.6, 0.1, 0.13), v)
        for _ in range(20):
            simulation.frame()
            still, moving = middles(simulation)
            assert moving[0] < still[0] - 0.2
        velocity = [simulation.v[simulation.body.jello == j, 0].mean() for j in (0, 1)]
        assert velocity[0] > velocity[1] + 1.0  # apart again


def test_a_stack_at_rest_has_no_gaps():
    jello = [cube(0.0, 0.5, 0.0, stiffness=500.0), cube(0.1, 1.52, 0.05, rotation=(0, 20, 0), stiffness=500.0)]
    simulation = Simulation(Scene(jello=jello, collider=[Plane()], contact=Contact(damping=2.0)))
    simulation.advance(6.0)
    assert simulation.energies()["kinetic"] < 1e-5
    low, high = (simulation.x[simulation.body.jello == j] for j in (0, 1))
    under, over = high.reshape(4, 4, 4, 3)[:, 0], low.reshape(4, 4, 4, 3)[:, -1]
    inner = np.all(np.abs(under[..., [0, 2]] - over[..., [0, 2]].mean((0, 1))) < 0.4, axis=-1)
    assert np.abs(under[inner, 1] - over[1:3, 1:3, 1].mean()).max() < 0.05 / 3  # of the spacing


def test_the_demo_s_stack_at_rest_has_neither_overlaps_nor_gaps():
    """By the surfaces as they are deformed, straight up and down: no way through an overlap is longer."""
    simulation = Simulation(scenefiles.load("stack"), method="backward-euler")  # which comes to rest sooner than RK4
    simulation.advance(1.0)
    assert simulation.energies()["kinetic"] < 1e-5
    body, x = simulation.body, simulation.x.astype(float)
    surfaces = [(x, body.bare_surface[body.jello[body.bare_surface[:, 0]] == j]) for j in range(3)]
    surfaces.append((body.skin_points(x), body.skin))
    columns = np.stack(np.meshgrid(*(np.arange(-0.55, 0.56, 0.011),) * 2), -1).reshape(-1, 2)
    for low, high, spacing in ((0, 2, 0.1), (1, 2, 0.1), (2, 3, 0.5 / 6)):
        apart = heights(*surfaces[high], columns, -1) - heights(*surfaces[low], columns, 1)
        apart = apart[~np.isnan(apart)]
        assert len(apart) > 100 and -0.05 * spacing < apart.min() < 0.0
        if high < 3:  # a face that lies on a face
            assert apart.max() < 0.05 * spacing
    assert abs(min(x[:, 1])) < 0.05 * 0.1


def test_an_embedded_skin_touches_where_it_is_and_keeps_momentum():
    """A ball is thrown at a cube as heavy: when its skin is there, not the cells that carry it, it hands on its way."""
    ball = Ball(radius=0.4, resolution=4, position=(1.1, 0.05, 0.02), velocity=(-1.0, 0.0, 0.0))
    simulation = Simulation(Scene(**WEIGHTLESS, jello=[cube(0.0, 0.0, 0.0), ball]))
    body, before = simulation.body, momentum(simulation)
    touched = None
    while simulation.time < 0.8:
        simulation.frame()
        if simulation.energies()["contact"] > 0.0 and touched is None:
            touched = body.skin_points(simulation.x)[:, 0].min()
    # At most a frame's way, 1/60 m, into the face at 0.5 m.
    assert 0.48 < touched < 0.5
    pushed, thrown = (simulation.v[body.jello == j, 0].mean() for j in (0, 1))
    assert pushed < thrown - 0.5
    assert np.abs(momentum(simulation) - before).max() <= 1e-6


@pytest.mark.filterwarnings("ignore:dt = ")
def test_forces_are_opposite_and_lead_downhill(forces):
    """Without damping and friction the force is the slope of the energy: by differences on points that touch."""
    jello = [cube(0.0, 0.0, 0.0, points=3, damping=0.0, stiffness=0.0),
             cube(0.95, 0.3, 0.2, points=3, damping=0.0, stiffness=0.0, rotation=(20, 30, 40))]  # fmt: skip
    simulation = Simulation(Scene(**WEIGHTLESS, jello=jello, contact=Contact(damping=0.0, friction=0.0)), substeps=1)
    f, x = forces(simulation), simulation.x
    assert np.abs(f.sum(0)).max() < 1e-5 * np.abs(f).sum()
    assert np.abs(np.cross(x, f).sum(0)).max() < 1e-5 * np.abs(f).sum()
    step = 1e-3
    for i in np.argsort(-np.linalg.norm(f, axis=1))[:6]:
        energy = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[i] += sign * step * f[i] / np.linalg.norm(f[i])
            simulation.restore(Snapshot(0.0, moved, np.zeros_like(x)))
            energy.append(simulation.energies()["contact"])
        assert (energy[1] - energy[0]) / (2.0 * step) == pytest.approx(np.linalg.norm(f[i]), rel=0.02)


def test_a_cube_lies_on_a_sheet_and_ropes_hold_each_other():
    pinned = {"pin": [Pin(max=(0.0, 1.0, 1.0)), Pin(min=(1.0, 0.0, 0.0))]}
    sheet = Sheet(points=(9, 7), size=(1.6, 1.2), stiffness=100.0, **pinned)
    light = cube(0.0, 0.4, 0.0, mass=0.3, size=(0.5, 0.5, 0.5))
    across = Rope(points=9, length=1.6, position=(0.0, 0.5, 1.5), stiffness=100.0, mass=0.3, **pinned)
    falls = Rope(points=9, length=1.2, position=(0.03, 0.7, 1.5), rotation=(0, 90, 0), mass=0.05)
    simulation = Simulation(Scene(jello=[sheet, light, across, falls], contact=Contact(friction=0.9)))
    simulation.advance(1.5)
    sheet_x, cube_x, across_x, falls_x = (simulation.x[simulation.body.jello == j] for j in range(4))
    assert sheet_x[:, 1].min() < -0.05 and abs(cube_x[:, 1].mean() - sheet_x[:, 1].min() - 0.25) < 0.1
    assert falls_x[4, 1] > across_x[4, 1]


def test_a_folded_rope_feels_itself_only_where_it_is_asked_to():
    def arms_apart(self_contact):
        rope = Rope(points=12, length=1.1, stiffness=20.0, springs=("structural",), self_contact=self_contact)
        simulation = Simulation(Scene(**WEIGHTLESS, jello=[rope]))
        x = simulation.x.copy()
        x[6:] = x[5::-1] + [0.0, 0.02, 0.0]  # lies on its first half
        simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
        simulation.advance(0.3)
        return np.linalg.norm(simulation.x[0] - simulation.x[-1])

    assert arms_apart(False) < 0.05
    assert arms_apart(True) > 0.1


def test_what_is_torn_away_is_not_touched_any_more():
    """A small cube stands in the middle one of three cells, whose edges along x tear."""
    slab = Box(points=(4, 2, 2), size=(3.0, 1.0, 1.0), tear_strain=0.5)
    simulation = Simulation(
        Scene(**WEIGHTLESS, jello=[slab, cube(0.0, 0.6, 0.0, points=2, size=(0.4, 0.4, 0.4))]), method="rk4"
    )
    assert simulation.energies()["contact"] > 0.0
    before, body = simulation.snapshot(), simulation.body
    middle = np.abs(body.rest[body.springs].mean(1)[:, 0]) < 0.1
    torn = middle & (body.family == 0) & (np.abs(body.direction[:, 0]) > 0.9) & (body.jello[body.springs[:, 0]] == 0)
    assert torn.sum() == 4
    simulation.restore(replace(before, memory=before.memory | {"whole": ~torn}))
    assert simulation.energies()["contact"] == 0.0
    simulation.restore(before)
    assert simulation.energies()["contact"] > 0.0


def test_touch_is_compiled_only_where_jellos_may_touch():
    two = [cube(0.0, 0.0, 0.0), cube(2.0, 0.0, 0.0)]
    for jello, contact, there in (
        (two, Contact(), True),
        (two[:1], Contact(), False),
        (two, Contact(touch=False), False),
        (two, Contact(stiffness=0.0), False),
        ([cube(0.0, 0.0, 0.0, self_contact=True)], Contact(), True),
    ):
        told = facts(Simulation(Scene(**WEIGHTLESS, jello=jello, contact=contact)))
        assert ("touch" in told["compiled_in"]) == ("touch" in told["fields"]) == there
        assert ("touch" in told["left_out"]) != there


def test_wrong_values_are_named():
    with pytest.raises(SceneError, match="touch: expected true or false, got 1"):
        Contact(touch=1)
    with pytest.raises(SceneError, match="self_contact: expected true or false, got 'yes'"):
        cube(0.0, 0.0, 0.0, self_contact="yes")


def test_ways_out_are_straight_and_inner_neighbours_opposite():
    body = join([Box(points=(4, 5, 6), size=(3.0, 4.0, 5.0)).body(), Ball(resolution=6).body()])
    faces, _, exits, way = ways_out(body.rest, body.cells)
    middle = body.rest[body.cells].mean(1)
    for side in range(6):
        step = body.rest[faces[exits[:, side]]].mean(1) - middle
        along = step[:, side // 2] * (1 if side % 2 else -1)
        assert np.allclose(along, way[:, side]) and np.all(along > 0.0)
        assert np.allclose(np.delete(step, side // 2, 1), 0.0)
    box = inner_neighbours(body.rest, body.cells)[:120].reshape(4, 5, 6)
    index = np.arange(120).reshape(4, 5, 6)
    assert box[0, 0, 0] == index[1, 1, 1] and box[3, 2, 3] == index[2, 2, 3] and box[3, 4, 2] == index[2, 3, 2]
