"""What contact goes by: numbers that are given, and what "auto" makes of each jello's springs; friction between two."""

import numpy as np
import pytest
from touching_pairs import touch

from taichi_jello import Ball, Box, Contact, Plane, Rope, Scene, SceneError, Sheet, Simulation, Snapshot, scenefiles
from taichi_jello.physics.adaptive.rigid_motion import rotation
from taichi_jello.physics.forces.contact_law import contact_numbers
from taichi_jello.run.assembly import assembled

STILL = (0.0, 0.0, 0.0)
G = 9.81


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def law(*jello, **options):
    """(J, 2) stiffness and damping of the contact of each jello, and the scene's body."""
    scene = Scene(jello=jello, **options)
    body = assembled(scene)
    return contact_numbers(scene, body), body


def standing(n):
    """Of the n³ - (n-2)³ points around a cube, those on one of six sides that are alike."""
    return (n**3 - (n - 2) ** 3) / 6.0


def test_numbers_that_are_given_stay():
    jello = [Box(points=(3, 3, 3), stiffness=1e6), Rope()]
    assert np.array_equal(law(*jello, contact=Contact(stiffness=1234.0, damping=0.5))[0], [[1234.0, 0.5]] * 2)
    numbers = law(*jello, contact=Contact(damping=0.0))[0]
    assert not numbers[:, 1].any() and numbers[0, 0] > 1e5 > numbers[1, 0]
    numbers = law(*jello, contact=Contact(stiffness=2000.0))[0]  # then the springs' own damping time, 0.25/1e6 s
    assert (numbers[:, 0] == 2000.0).all() and numbers[0, 1] == pytest.approx(2000.0 * 0.25e-6)


def test_a_box_stands_on_points_that_are_one_and_a_half_times_as_stiff_as_it():
    """E A/H of a uniform cube of 1 m: E V = Σ k L²/6 over its 3n²(n-1) edges, 6n(n-1)² and 4(n-1)³ diagonals and
    3n²(n-2) bend springs, of squares 1, 2, 3 and 4 times the spacing's. In 8³ points 1.5 springs a point."""
    n, k = 8, 200.0
    squares = 3 * n**2 * (n - 1) + 2 * 6 * n * (n - 1) ** 2 + 3 * 4 * (n - 1) ** 3 + 4 * 3 * n**2 * (n - 2)
    bar = k * squares / (n - 1) ** 2 / 6.0
    ((stiffness, damping),) = law(Box(stiffness=k))[0]
    assert stiffness == pytest.approx(1.5 * bar / standing(n), rel=1e-9)
    assert stiffness == pytest.approx(1.5 * k, rel=0.03)
    assert damping / stiffness == pytest.approx(0.25 / k)


def test_contact_is_as_stiff_however_many_points_there_are():
    """All standing points together; of springs of one Young's modulus, and of k = 1400 N/m times the spacing, which
    have the same but for the whole springs on the surface: (n/(n-1))² of what is inside, 14 % at 16 points."""
    for made in (lambda n: {"young": 1e4}, lambda n: {"stiffness": 1400.0 / (n - 1)}):
        total = [law(Box(points=(n,) * 3, **made(n)))[0][0, 0] * standing(n) for n in (8, 16)]
        assert total[1] == pytest.approx(total[0], rel=0.15)
    assert law(Box(points=(12,) * 3, young=1e4))[0][0, 0] * standing(12) == pytest.approx(1.5e4, rel=1e-6)


@pytest.mark.parametrize("n", [4, 8])
def test_a_soft_cube_sinks_in_by_a_fiftieth_at_most(n):
    """At rest on one side, n² points of 1 kg in all; the law counts a little fewer points. Under the most gravity that
    the scene is told to have."""
    for gravity in (G, 3.0 * G):
        ((stiffness, damping),) = law(Box(points=(n,) * 3, stiffness=1.0), gravity=(0.0, 0.0, gravity))[0]
        depth = gravity / (stiffness * n**2)
        assert 0.01 < depth <= 0.02
        assert damping / stiffness == pytest.approx(0.25)


@pytest.mark.parametrize(
    "shape", [{"points": (9, 9, 2)}, {"points": (9, 9, 2), "size": (1.0, 1.0, 0.1)}, {"points": (2, 2, 2)}]
)
def test_no_point_has_more_than_a_quarter_of_the_springs_around_a_particle(shape):
    numbers, body = law(Box(stiffness=1e5, **shape))  # its weight asks for nothing
    around = 2.0 * body.stiffness.sum() / len(body)  # each spring is around two particles
    assert 0.0 < numbers[0, 0] <= 0.25 * around * (1.0 + 1e-9)


@pytest.mark.parametrize(
    "jello",
    [
        Box(points=(3, 3, 3), stiffness=0.0),
        Box(points=(3, 3, 3), stiffness=0.0, damping=0.0),
        Box(points=(3, 3, 3), springs=()),
        Box(points=(1, 1, 1)),
        Box(points=(2, 1, 1)),
        Rope(),
        Sheet(),
        Ball(),
    ],
)
@pytest.mark.parametrize("gravity", [STILL, (0.0, -G, 0.0)])
def test_every_jello_has_contact_that_is_positive_and_finite(jello, gravity):
    numbers = law(jello, gravity=gravity)[0]
    assert np.isfinite(numbers).all() and (numbers[:, 0] > 0.0).all() and (numbers[:, 1] >= 0.0).all()
    if not np.any(jello.stiffness):  # nothing else damps them
        assert numbers[0, 1] > 0.0


@pytest.mark.parametrize(("n", "most"), [(4, 0.15), (5, 0.1), (8, 0.05)])
def test_contact_shortens_the_step_of_a_cube_on_the_ground_little(n, most):
    """What contact adds to the Λ of the springs: at 8³ points a twentieth; fewer points bear more each."""
    simulation = Simulation(Scene(jello=[Box(points=(n,) * 3, stiffness=1e4)], collider=[Plane()]), method="rk4")
    rates = {force.title: force.rates().squared_frequency for force in simulation.system.all_forces}
    assert 0.0 < rates["contact"] <= most * rates["springs"]


@pytest.mark.parametrize("word", ["soft", "AUTO", ""])
def test_a_word_that_is_no_stiffness_is_named(tmp_path, word):
    path = tmp_path / "scene.toml"
    for key, more in (("stiffness", ""), ("damping", "friction = 0.1\n")):
        path.write_text(f'[contact]\n{more}{key} = "{word}"\n[[jello]]\nshape = "box"\n')
        with pytest.raises(SceneError, match=f"contact.{key}: expected \"auto\" or a number, got '{word}'"):
            scenefiles.load(str(path))


DEPTH = 0.03  # m
LENGTH = 1.0  # m, of the cubes' edges


@pytest.fixture(scope="module")
def pair(taichi):
    """Two cubes, the first ten times as stiff as the second."""
    hard, soft = (Box(points=(4, 4, 4), stiffness=k, position=(0.0, y, 0.0)) for k, y in ((2000.0, 0.0), (200.0, 3.0)))
    return Simulation(Scene(gravity=STILL, jello=[hard, soft], contact=Contact(friction=0.5)), method="rk4")


def in_each_other(pair, yaw=0.0, tilt=0.0, depth=DEPTH, shift=(0.2, 0.1)):
    """(N, 3): the soft cube on the hard one, turned and `depth` within its top."""
    first = pair.body.jello == 0
    rest = pair.body.rest[first] - pair.body.rest[first].mean(0)
    turn = rotation(np.array([[0.0, yaw, tilt]]))[0]
    return np.concatenate([rest, rest @ turn.T + [shift[0], LENGTH - depth, shift[1]]])


def stored(pair, x):
    pair.restore(Snapshot(0.0, x, np.zeros_like(x)))
    return pair.energies()["contact"]


@pytest.fixture
def as_made(pair):
    """The pair's law, and afterwards what it was before."""
    law = touch(pair).law
    kept = law.numbers.copy()
    yield law
    law.numbers[:] = kept
    law.tune("friction", law.friction)


def test_the_softer_law_acts_between_two(pair, as_made):
    x = in_each_other(pair)
    assert as_made.stiffness[0] == pytest.approx(10.0 * as_made.stiffness[1])
    energy = stored(pair, x)
    each = 0.5 * as_made.stiffness[1] * DEPTH**2
    assert energy / each == pytest.approx(round(energy / each)) and 1 <= round(energy / each) <= 32  # whole points
    as_made.numbers[0] *= 3.0
    as_made.tune("friction", as_made.friction)
    assert stored(pair, x) == pytest.approx(energy)
    as_made.numbers[1] *= 2.0
    as_made.tune("friction", as_made.friction)
    assert stored(pair, x) == pytest.approx(2.0 * energy)


def test_tuning_leaves_jellos_as_different_as_they_are(pair, as_made):
    before, told = as_made.numbers.copy(), as_made.tuning()
    assert told["contact_stiffness"] == pytest.approx(before[:, 0].mean())
    x = in_each_other(pair)
    energy, safe = stored(pair, x), pair.safe_dt
    pair.tune(contact_stiffness=3.0 * told["contact_stiffness"], contact_damping=0.5 * told["contact_damping"])
    assert as_made.numbers == pytest.approx(before * [3.0, 0.5])
    assert stored(pair, x) == pytest.approx(3.0 * energy) and pair.safe_dt < safe
    pair.tune(**told)
    assert as_made.numbers == pytest.approx(before) and pair.safe_dt == pytest.approx(safe)


@pytest.mark.parametrize(("yaw", "tilt"), [(0.0, 0.0), (0.4, 0.0), (0.4, 0.05)])
@pytest.mark.parametrize("depth", [DEPTH, 0.1])
def test_friction_between_two_has_no_sum_and_makes_no_angular_momentum(pair, forces, yaw, tilt, depth):
    """Friction at a point `depth` below what it rubs on is a couple of up to depth · |F| there. Where points are within
    triangles it is taken back whole, to rounding."""
    x, soft = in_each_other(pair, yaw, tilt, depth), pair.body.jello == 1
    still = forces(pair, x, np.zeros_like(x))
    slides = forces(pair, x, np.where(soft[:, None], [1.0, 0.0, 0.3], 0.0))
    rubbed = np.linalg.norm((slides - still)[soft].sum(0)[[0, 2]])
    assert rubbed > 1.0  # N
    for f in (still, slides):
        size = np.abs(f).sum()
        assert np.abs(f.sum(0)).max() < 1e-12 * size
        assert np.linalg.norm(np.cross(x, f).sum(0)) < 1e-9 * depth * rubbed


def test_friction_at_edges_makes_less_angular_momentum_than_a_couple_would(pair, forces):
    """One spins on the other; a point that is beside a triangle's inside is pressed by its edge or corner."""
    x, soft = in_each_other(pair, depth=0.05, shift=(0.1, 0.0)), (pair.body.jello == 1)[:, None]
    still = forces(pair, x, np.zeros_like(x))
    spins = np.where(soft, np.cross([0.0, 3.0, 0.0], x - x[soft[:, 0]].mean(0)), 0.0)
    f = forces(pair, x, spins)
    couple = 0.05 * np.linalg.norm((f - still)[soft[:, 0]], axis=1).sum()
    assert np.abs(f.sum(0)).max() < 1e-12 * np.abs(f).sum()
    assert np.linalg.norm(np.cross(x, f).sum(0)) < couple / 3.0
