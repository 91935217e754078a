"""Jellos that come into each other deeply: thrown hard, crossed like blades, melted over each other."""

from dataclasses import replace

import numpy as np
import pytest
import taichi as ti
from touching_pairs import touch

from taichi_jello import Ball, Box, Contact, Keyframe, Mesh, Plane, Ring, Scene, Sheet, Simulation, Snapshot
from taichi_jello.physics.forces.soft_contact.fast.approach_speed import APPROACH, Approach
from taichi_jello.physics.forces.soft_contact.fast.inelastic_brake import RESTITUTION
from taichi_jello.physics.forces.soft_contact.surface.points_and_elements import Touching
from taichi_jello.physics.forces.soft_contact.surface.shapes import THICKNESS
from taichi_jello.physics.forces.soft_contact.thin_contacts import STOPPED_WITHIN
from taichi_jello.run.assembly import assembled
from taichi_jello.run.explain import facts, text
from taichi_jello.scenefiles import demos
from taichi_jello.studies._contact.pairs import Pair, thrown
from taichi_jello.support import runtime

WEIGHTLESS = {"gravity": (0.0, 0.0, 0.0)}


@pytest.fixture(scope="module", autouse=True)
def taichi(request):
    runtime.start(request.config.getoption("--arch"), "f32")


def middles(simulation):
    return [simulation.x[simulation.body.jello == j].mean(0) for j in range(len(simulation.scene.jello))]


@pytest.fixture(scope="module")
def small():
    """A stiff slab 0.2 m wide and 0.08 m thick that is thrown at another at 20 m/s: in a frame it goes 0.33 m."""
    slabs = [
        Box(points=(3, 4, 4), size=(0.08, 0.2, 0.2), position=(x, 0.0, 0.01 * x), velocity=(v, 0.0, 0.0), stiffness=1e6)
        for x, v in ((0.0, 0.0), (-0.6, 20.0))
    ]
    return Simulation(Scene(**WEIGHTLESS, jello=slabs), method="backward-euler")


def test_stiff_and_thin_ones_do_not_pass_at_twenty_metres_a_second(small):
    assert small.substeps == 1  # a frame that nothing hurries is one step
    assert "in parts while jellos approach each other by more than 0.01 m a step" in text(facts(small))
    small.change_step(substeps=1)
    small.frame()
    small.frame()
    assert small.system.parts == 1  # the step is a person's own
    small.change_step(dt="auto")
    small.reset()
    parts, momentum = [], small.body.mass @ small.v
    for _ in range(8):
        small.frame()
        parts.append(small.system.parts)
        still, moving = middles(small)
        assert moving[0] < still[0] - 0.06
    # 0.33 m a frame in parts of at most APPROACH of 0.08 m, while they may meet; 1 when they are apart again.
    assert max(parts) == np.ceil(20.0 / 60.0 / (APPROACH * 0.08)) and parts[0] == parts[-1] == 1
    assert small.body.mass @ small.v == pytest.approx(momentum, abs=1e-6 * 20.0)
    still, moving = (small.v[small.body.jello == j, 0].mean() for j in (0, 1))
    assert moving < still - 1.0  # apart again


@pytest.mark.parametrize(("name", "size", "poses"), [("rope", 0.1, range(6)), ("bar", 1.0, (6,))])
def test_what_is_thin_and_soft_does_not_pass_either(name, size, poses):
    """Ropes went through each other in 5 of these 6 throws, soft bars where their points are far apart."""
    simulation = Pair(name, name, size).simulation("auto")
    assert not any(told["through"] for told in thrown(simulation, size, poses))


def test_thin_ones_are_braked_as_they_touch_if_contact_s_springs_are_too_weak():
    """Where the edge of a strip comes on that of a sheet no point is near until they are through each other. A particle
    of 1/25 kg stops on 2000 N/m within half of the distance, 0.0625 m, from up to 14 m/s."""
    (told,) = thrown(Pair("sheet", "strip").simulation("auto"), 1.0, [47])
    assert not told["through"]
    sheet = Sheet(points=(5, 5), size=(1.0, 1.0), damping=0.0)
    jello = [sheet, replace(sheet, position=(0.01, 0.2, 0.02))]
    hard = Contact(stiffness=2000.0, damping=0.5)
    simulation = Simulation(Scene(**WEIGHTLESS, jello=jello, contact=hard), method="rk4", ledger=True)
    v = np.where((simulation.body.jello == 1)[:, None], [0.0, -1.0, 0.0], 0.0)
    half = 2.0 * THICKNESS["sheet"] * 0.25 * STOPPED_WITHIN
    limit = half * np.sqrt(simulation.tuning["contact_stiffness"] * 25.0)
    lost = []
    for speed in (0.9 * limit, 1.1 * limit):
        simulation.restore(Snapshot(0.0, simulation.body.x, speed * v))
        before = simulation.work["impacts"]
        while simulation.energies()["contact"] == 0.0 and simulation.time < 0.1:
            simulation.step()
        lost.append(simulation.work["impacts"] - before)
    assert lost[0] == 0.0 and lost[1] < -1.0


def test_parts_are_as_many_as_the_way_asks_for():
    """Two cubes 1 m apart, the second at v: within a frame of 0.02 s they meet only if it comes 1 m near."""
    body = assembled(Scene(jello=[Box(points=(2, 2, 2)), Box(points=(2, 2, 2), position=(2.0, 0.0, 0.0))]))
    approach = Approach(body, np.array([1.0, 0.5]))
    second = (body.jello == 1)[:, None]

    def parts(speed, place=0.0, dt=0.01):
        return approach.parts(body.x + second * [place, 0.0, 0.0], second * [-speed, 0.0, 0.0], 0.02, dt)

    assert parts(40.0) == 1 and parts(60.0) == np.ceil(0.6 / (APPROACH * 0.5)) and parts(60.0, dt=0.005) == 5
    assert parts(-60.0, place=-2.0) == 10  # within each other: they may strike inside
    assert parts(-60.0) == 1 and parts(3.0, place=-1.0) == 1  # away from each other; slowly
    alone = Approach(assembled(Scene(jello=[Box(points=(2, 2, 2))])), np.ones(1))
    assert alone.parts(body.x[:8], 1e3 * body.x[:8], 0.02, 0.01) == 1


def test_thickness_and_compactness_of_shapes():
    jello = [
        Box(points=(5, 3, 4), size=(1.0, 0.2, 0.6)),
        Ball(radius=0.5, resolution=6),
        Ring(),
        Mesh(file=str(demos()["rabbit"].parent / "meshes" / "rabbit.ply"), resolution=10),
        Sheet(points=(5, 5), size=(1.0, 1.0)),
        Box(points=(5, 3, 4), size=(1.0, 0.5, 0.6), rotation=(30.0, 40.0, 50.0)),
    ]
    touching = Touching.of(assembled(Scene(jello=jello)), np.zeros(6, bool))
    shapes = touching.shapes
    assert shapes.compact.tolist() == [False, True, False, False, False, True]  # a slab is slender; up to 1 : 2
    assert shapes.slender.tolist() == [True, False, True, True, False, False]
    assert shapes.thickness[0] == pytest.approx(0.2)
    assert shapes.thickness[1] == pytest.approx(1.0, abs=1 / 6)  # along a diameter, to a cell
    assert shapes.thickness[2] == pytest.approx(0.25, abs=0.01)  # the bar's
    body, spacing = assembled(Scene(jello=jello)), shapes.spacing[3]
    cells = shapes.thick[body.jello[body.cells[:, 0]] == 3]
    # Half of the rabbit's cells are in parts no thicker; an ear has one cell, of which the skin leaves a half.
    assert cells.min() == pytest.approx(0.5 * spacing) and spacing < shapes.thickness[3] < cells.max()
    assert np.count_nonzero(cells <= shapes.thickness[3]) >= 0.5 * len(cells)
    assert shapes.thickness[4] == pytest.approx(8 * 0.25 * 0.25)  # eight times its radius
    loose = Touching.of(assembled(Scene(jello=jello)), np.arange(6) == 0)
    assert not loose.shapes.compact[0] and not loose.shapes.slender[0]
    assert loose.bare == touching.bare + 3 * 1 * 2  # with the points inside


@pytest.mark.parametrize("turn", ["crossed", "by half"])
def test_slabs_laid_into_each_other_gain_nothing(slabs, turn):
    """Led from middle to middle, to far ends, they came apart with about twice the energy that there was. Now they stay
    in each other, and a scene that begins so is warned of."""
    rest = slabs.body.rest[: len(slabs.body) // 2]
    other = rest[:, [0, 2, 1]] if turn == "crossed" else rest + [0.5, 0.01, 0.02]
    start = Snapshot(0.0, np.concatenate([rest, other]), np.zeros((len(slabs.body), 3)))
    slabs.restore(start)
    before = sum(slabs.energies().values())
    slabs.advance(1.5)
    after = slabs.energies()
    assert before > 10.0 and sum(after.values()) < 1.01 * before


@pytest.fixture(scope="module")
def slabs():
    return Simulation(Scene(**WEIGHTLESS, jello=[Box(points=(6, 6, 2), size=(1.0, 1.0, 0.2))] * 2), method="rk4")


def test_a_run_cut_within_a_frame_in_parts_goes_on_to_the_same_bits(slabs):
    first = (slabs.body.jello == 0)[:, None]
    x = slabs.body.x + first * [0.0, 0.0, 0.4]
    slabs.restore(Snapshot(0.0, x, first * np.array([0.0, 0.0, -25.0])))
    slabs.step(4)
    assert slabs.system.parts > 1 and slabs.substeps > 4
    middle = slabs.snapshot()
    slabs.frame()
    slabs.frame()
    whole = slabs.snapshot()
    slabs.reset()
    slabs.restore(middle)
    slabs.frame()
    slabs.frame()
    assert np.array_equal(slabs.x, whole.x) and np.array_equal(slabs.v, whole.v) and slabs.time == whole.time


def test_one_that_melts_on_another_stays_on_it_and_makes_no_energy():
    """Its points inside are carried too: they sank through what it lay on, and its cells with them, with 50 times the
    energy that there was."""
    melts = [Keyframe(time=0.1, stiffness=1.0), Keyframe(time=0.3, stiffness=0.0)]
    jello = [
        Box(points=(4, 4, 4), position=(0.0, 0.5, 0.0)),
        Box(points=(5, 5, 5), size=(0.5, 0.5, 0.5), position=(0.0, 1.26, 0.0), keyframe=melts),
    ]
    simulation = Simulation(Scene(jello=jello, collider=[Plane()]), method="rk4", ledger=True)
    total = sum(simulation.energies().values())
    simulation.advance(1.6)
    top = simulation.body.jello == 1
    x = simulation.x
    assert x[top, 1].max() < 1.1 and x[top, 1].min() > 0.95
    assert abs(simulation.energy_residual) < 0.01 * total


def test_a_ball_that_melts_does_not_leave_its_inside_in_the_ground():
    melts = [Keyframe(time=0.1, stiffness=1.0), Keyframe(time=0.3, stiffness=0.0)]
    ball = Ball(radius=0.4, resolution=5, position=(0.0, 0.41, 0.0), keyframe=melts)
    simulation = Simulation(Scene(jello=[ball], collider=[Plane()]), method="rk4")
    simulation.advance(1.5)
    body, x = simulation.body, simulation.x
    assert body.inside.sum() > 20
    # The springs of contact carry one particle's weight, at most all that lie upon each other in a column.
    static = 9.81 * body.mass.max() * 6 / simulation.tuning["contact_stiffness"]
    assert x[body.inside, 1].min() > -10.0 * static and body.skin_points(x)[:, 1].min() > -10.0 * static


WEAK = {"mass": 1.0, "stiffness": 200.0, "damping": 0.25}
SLABS = [
    Box(points=(3, 6, 6), size=(0.03, 0.1, 0.1), **WEAK),
    Box(points=(3, 6, 6), size=(0.03, 0.1, 0.1), position=(-0.3, 0.007, 0.005), velocity=(20.0, 0.0, 0.0), **WEAK),
]


@pytest.mark.parametrize(
    "shape, method",
    [(shape, method) for shape in ("box", "ball", "slab") for method in ("rk4", "backward-euler", "xpbd")]
    + [("sheet", "rk4")],
)
def test_what_is_too_weak_for_its_own_speed_does_not_pass(shape, method):
    """1 kg of 0.1 m at 20 m/s; what came after passed through the front that contact had stopped."""
    made = {
        "box": lambda **k: Box(points=(6, 6, 6), size=(0.1, 0.1, 0.1), **k),
        "ball": lambda **k: Ball(radius=0.05, resolution=6, **k),
        "slab": lambda **k: Box(points=(3, 6, 6), size=(0.03, 0.1, 0.1), **k),
        "sheet": lambda **k: Sheet(points=(9, 9), size=(0.1, 0.1), rotation=(0.0, 0.0, 90.0), **k),
    }[shape]
    jello = [made(**WEAK), made(position=(-0.3, 0.007, 0.005), velocity=(20.0, 0.0, 0.0), **WEAK)]
    simulation = Simulation(Scene(**WEIGHTLESS, jello=jello), method=method)
    energy = sum(simulation.energies().values())
    for _ in range(12):
        simulation.frame()
        still, moving = middles(simulation)
        assert moving[0] < still[0]
    # What two equal masses keep of their energy when they stick to each other is a half.
    assert moving[0] < still[0] - 0.1
    assert 0.48 * energy < sum(simulation.energies().values()) < 0.7 * energy


def test_the_brake_keeps_momentum_and_angular_momentum_and_its_work_is_booked():
    simulation = Simulation(Scene(**WEIGHTLESS, jello=SLABS), method="rk4", ledger=True)
    body, first = simulation.body, simulation.body.jello == 0

    def momenta():
        x, v = simulation.x.astype(float), simulation.v.astype(float)
        return body.mass @ v, np.einsum("n,nd->d", body.mass, np.cross(x, v))

    before, energy, lost, braked = momenta(), sum(simulation.energies().values()), 0.0, 0
    for _ in range(40):
        work = simulation.work["impacts"]
        simulation.step()
        assert simulation.work["impacts"] <= work + 1e-6  # it only takes
        braked += simulation.work["impacts"] < work
        lost = simulation.work["impacts"]
    after = momenta()
    assert braked > 0 and lost < -0.3 * energy
    # What leaves by another than the nearest place is not driven by a potential: 7 J of 200 at any step.
    assert abs(simulation.energy_residual) < 0.05 * energy
    assert after[0] == pytest.approx(before[0], abs=20.0 * 1e-6)
    # Contact's friction and dashpots act on a point and on a surface as deep as it has come in, 0.03 m at the most.
    assert after[1] == pytest.approx(before[1], abs=20.0 * 0.03 * 0.05)
    assert touch(simulation).brake.jellos == 2 and simulation.v[first, 0].mean() > 5.0


def test_the_brake_alone_leaves_two_turning_as_one_and_a_tenth_of_the_rest_backwards():
    """A pair that comes at each other beside the line through both centres: of their motion the rigid one stays that
    has the same momentum and angular momentum (two rigid balls that stick, in closed form); of the rest a tenth,
    turned round."""
    balls = [Ball(radius=0.5, resolution=6), Ball(radius=0.5, resolution=6, position=(3.0, 0.0, 0.0))]
    simulation = Simulation(Scene(**WEIGHTLESS, jello=balls), method="rk4")
    body, first = simulation.body, simulation.body.jello == 0
    x = body.x - np.where(first[:, None], [0.0, 0.0, 0.0], [2.3, -0.4, 0.0])
    v = np.where(first[:, None], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    simulation.restore(Snapshot(0.0, x, v))
    brake = touch(simulation).brake
    brake.deep[1] = brake.deep[2] = brake.any[0] = 1
    only_brake(simulation.system, brake)
    after = np.stack([simulation.system.state.v[i] for i in range(len(body))])
    mass, centre = body.mass, np.average(x, axis=0, weights=body.mass)
    arm = x - centre
    inertia = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(mass, arm, strict=True))
    turning = np.linalg.solve(inertia, mass @ np.cross(arm, v))
    assert turning[2] > 0.1
    as_one = np.array([1.0, 0.0, 0.0]) + np.cross(turning, arm)
    assert after == pytest.approx(as_one - RESTITUTION * (v - as_one), abs=1e-5)


@ti.kernel
def only_brake(system: ti.template(), brake: ti.template()):
    brake.brake(system, 0, system.count, system.state.x, system.state.v)
