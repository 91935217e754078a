"""What stays of a deformation: creep, yield and tearing, by handles that pull on single springs."""

import numpy as np
import pytest

from taichi_jello import Box, Move, Pin, Region, Scene, SceneError, Simulation
from taichi_jello.physics.integrators import schemes

WEIGHTLESS = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def rack(path, points=(2, 1, 1), **options):
    """A spring of 1 m and 100 N/m, or several in a line, whose one end is pinned and whose other end is pulled along
    x: path gives (time, offset)."""
    moves = [Move(time=time, offset=(x, 0.0, 0.0)) for time, x in path]
    pins = [Pin(max=(0.0, 1.0, 1.0)), Pin(min=(1.0, 0.0, 0.0), keyframe=moves)]
    line = Box(points=points, springs=["structural"], stiffness=100.0, damping=0.5, pin=pins, **options)
    return Simulation(Scene(gravity=WEIGHTLESS, jello=[line]))


@pytest.mark.parametrize("method", sorted(schemes()))
def test_handles_follow_their_path_with_every_scheme(method, epsilon):
    """Straight within each frame; the middle of a line of three is pulled along."""
    path = [Move(time=0.1, offset=(0.0, 0.0, 0.0)), Move(time=0.3, offset=(0.4, 0.2, 0.0))]
    pins = [Pin(max=(0.0, 1.0, 1.0)), Pin(min=(1.0, 0.0, 0.0), keyframe=path)]
    line = Box(points=(3, 1, 1), stiffness=50.0, damping=2.0, pin=pins)
    simulation = Simulation(Scene(gravity=WEIGHTLESS, jello=[line]), method=method)
    start = simulation.x
    simulation.step(12 * simulation.substeps + simulation.substeps // 2)
    t = simulation.time - 0.1
    assert simulation.x[2] - start[2] == pytest.approx([2.0 * t, t, 0.0], abs=100 * epsilon)
    assert simulation.v[2] == pytest.approx([2.0, 1.0, 0.0], rel=100 * epsilon)
    assert np.array_equal(simulation.x[0], start[0])
    simulation.advance(1.0)
    assert simulation.x[2] - start[2] == pytest.approx([0.4, 0.2, 0.0], abs=10 * epsilon)
    assert not simulation.v[2].any()
    assert simulation.x[1, 0] == pytest.approx(0.2, abs=0.05)  # it still swings to the side


def test_beyond_its_yield_strain_a_spring_keeps_what_is_more():
    simulation = rack([(0.0, 0.0), (0.5, 0.6), (1.0, 0.6), (1.5, 0.0)], yield_strain=0.1)
    simulation.advance(0.95)
    # Strained by 10 % of its new rest length R at 1.6 m: R = 1.6/1.1.
    assert simulation.snapshot().memory["rest_length"] == pytest.approx([1.6 / 1.1])
    assert simulation.energies()["elastic"] == pytest.approx(50 * (1.6 - 1.6 / 1.1) ** 2, rel=1e-6)
    assert simulation.work["yield"] < 0.0
    simulation.advance(1.0)  # pushed back to 1 m it yields again, the other way: R - 1 = R/10
    assert simulation.snapshot().memory["rest_length"] == pytest.approx([1.0 / 0.9])


def test_creep_is_maxwells(epsilon):
    """Held at a stretch of 0.5 m the stress falls as exp(-rate t), however long the frames."""
    simulation = rack([(0.0, 0.5)], creep=3.0)
    simulation.advance(0.5)
    simulation.energies()
    rest = simulation.snapshot().memory["rest_length"]
    assert 1.5 - rest == pytest.approx([0.5 * np.exp(-1.5)], rel=1e-9 + 100 * epsilon)
    before = 50 * 0.5**2
    assert simulation.work["creep"] == pytest.approx(simulation.energies()["elastic"] - before, rel=1e-5)


def test_a_spring_stretched_too_far_tears_and_its_energy_is_booked():
    """Of two springs the softer one breaks; the other one then hangs from its pin without load."""
    soft = Region(max=(0.5, 1.0, 1.0), stiffness=50.0)
    simulation = rack([(0.0, 0.0), (1.0, 1.0)], points=(3, 1, 1), tear_strain=0.6, region=[soft])
    simulation.advance(1.0)
    whole = simulation.snapshot().memory["whole"]
    assert whole.tolist() == [False, True]
    # It broke at the first frame beyond 0.3 m; in a frame its ends part by less than 0.04 m.
    assert -0.5 * 50 * 0.34**2 < simulation.work["tearing"] <= -0.5 * 50 * 0.3**2
    simulation.advance(2.0)
    assert np.linalg.norm(simulation.x[2] - simulation.x[1]) == pytest.approx(0.5, abs=0.05)
    simulation.reset()
    assert simulation.work == {"tearing": 0.0} and not simulation.snapshot().memory


def test_a_run_cut_in_two_remembers_what_lasts(anew):
    path = [Move(time=0.0, offset=(0.0, 0.0, 0.0)), Move(time=0.5, offset=(1.0, 0.0, 0.0))]
    pins = [Pin(max=(0.0, 1.0, 1.0)), Pin(min=(1.0, 0.0, 0.0), keyframe=path)]
    slab = Box(points=(5, 3, 3), damping=1.0, creep=1.0, yield_strain=0.3, tear_strain=0.8, pin=pins)
    anew()
    whole = Simulation(Scene(jello=[slab]))
    whole.step(40 * whole.substeps)
    end = whole.snapshot()
    assert not end.memory["whole"].all()
    whole.reset()
    whole.step(25 * whole.substeps + 2)
    half = whole.snapshot()
    anew()
    other = Simulation(Scene(jello=[slab]))
    other.restore(half)
    other.energies()
    other.restore(other.snapshot())
    other.step(15 * whole.substeps - 2)
    assert np.array_equal(end.x, other.x) and np.array_equal(end.v, other.v)
    assert {"tearing", "yield", "creep"} == set(other.work)


def test_mistakes_name_the_key():
    for name in ("creep", "yield_strain", "tear_strain"):
        with pytest.raises(SceneError, match=f"{name}: expected a finite number of at least 0, got -1"):
            Box(**{name: -1.0})
    with pytest.raises(SceneError, match=r"keyframe.1.time: expected more than 1"):
        Pin(keyframe=[Move(time=1.0, offset=(0, 0, 0)), Move(time=1.0, offset=(0, 0, 0))])


def test_the_work_of_handles_is_booked(epsilon):
    """A slab that is pulled, yields and tears: what its energy gains is what was put in, as exactly as RK4 steps."""
    offsets = ((0.0, 0.1, 0.0), (0.3, 0.7, 0.2), (0.4, 0.0, 0.0))
    path = [Move(time=time, offset=(x, y, 0.0)) for time, x, y in offsets]
    pins = [Pin(max=(0.0, 1.0, 1.0)), Pin(min=(1.0, 0.0, 0.0), keyframe=path)]
    slab = Box(points=(4, 3, 3), damping=0.5, yield_strain=0.3, tear_strain=0.55, pin=pins)
    simulation = Simulation(Scene(jello=[slab]), ledger=True, substeps=40)
    before = sum(simulation.energies().values())
    simulation.advance(0.5)
    assert simulation.work["handles"] > 10.0 and simulation.work["tearing"] < 0.0 and simulation.work["yield"] < 0.0
    gained = sum(simulation.energies().values()) - before
    assert simulation.energy_residual == pytest.approx(gained - sum(simulation.work.values()), abs=1e5 * epsilon)
    # 7e-7 as measured in f64; twice the substeps, a sixteenth of it.
    assert abs(simulation.energy_residual) < (3e-6 + 1000 * epsilon) * simulation.work["handles"]
