"""How many threads share the work: by the time that it takes, which is told here; the same bits whatever it is."""

import numpy as np
import pytest

from taichi_jello import Box, Plane, Scene, Simulation
from taichi_jello.physics import team_size
from taichi_jello.physics.team_size import TeamSize, sizes
from taichi_jello.support import runtime

STEP = 1e-3  # s that one thread takes for a substep


def go_on(size, seconds, slowed):
    """Work for so long on a machine where more than one thread take `slowed` times as long as they should. Returns the
    seconds that a substep took."""
    end, done = size.time + seconds, 0
    start = size.time
    while size.time < end:
        substeps = size.portion(10**9)
        pace = STEP if size.members == 1 else STEP / size.members * slowed
        size.took(substeps, substeps, substeps * pace)
        done += substeps
    return (size.time - start) / done


def test_threads_that_are_slow_become_fewer_and_come_back():
    size = TeamSize(2)
    go_on(size, 1.0, 1.0)
    assert size.home == 2
    assert go_on(size, 10.0, 10.0) < 1.1 * STEP and size.home == 1
    go_on(size, 2.0 * team_size.LATEST, 1.0)
    assert size.home == 2
    assert go_on(size, 5.0, 1.0) == pytest.approx(0.5 * STEP)


def test_a_machine_that_is_busy_from_the_start():
    size = TeamSize(2)
    assert go_on(size, 5.0, 10.0) < 1.1 * STEP and size.home == 1


def test_trials_in_vain_become_rarer():
    size, times = TeamSize(2), []
    go_on(size, 1.0, 10.0)
    for _ in range(20_000):
        before = size.members
        go_on(size, 1e-9, 10.0)
        if size.members > before:
            times.append(size.time)
    waits = np.diff(times)
    assert len(waits) > 3 and waits[0] < waits[1] < waits[2]
    assert waits.max() == pytest.approx(team_size.LATEST, rel=0.1)


def test_where_nothing_else_runs_fewer_are_tried_only_once():
    size, tried = TeamSize(2), 0
    for _ in range(5000):
        tried += size.members < 2
        go_on(size, 1e-9, 1.0)
    assert size.time > 50.0 and 0 < tried < 10


def test_work_that_takes_longer_for_all_changes_nothing():
    size = TeamSize(2)
    go_on(size, 1.0, 1.0)
    for _ in range(1000):
        substeps = size.portion(1000)
        size.took(substeps, substeps, substeps * (3.0 if size.members == 2 else 6.0) * STEP)
    assert size.home == 2


@pytest.mark.parametrize("home", [1, 2])
def test_after_a_halt_it_is_as_before(home):
    size = TeamSize(2)
    go_on(size, 1.0, 10.0 if home == 1 else 1.0)
    size.took(1, 1, 3600.0)
    go_on(size, 2.0, 10.0 if home == 1 else 1.0)
    assert size.home == home
    while size.members == size.home:
        go_on(size, 1e-9, 10.0)
    size.took(1, 1, 3600.0)  # in a trial
    go_on(size, 2.0 * team_size.RAREST, 1.0)
    assert size.home == 2


def test_never_more_than_asked_for_and_all_between():
    assert sizes(1) == [1] and sizes(2) == [1, 2] and sizes(16) == [1, 2, 4, 8, 15, 16]
    size = TeamSize(6)
    go_on(size, 10.0, 8.0)
    assert size.home == 1
    size.hold(9)
    assert size.members == 6 and size.portion(12345) == 12345


LOW = Scene(jello=[Box(points=(4, 5, 6), position=(0.0, 0.5, 0.0))], collider=[Plane()], drag=0.1)
PAIR = Scene(jello=[*LOW.jello, Box(points=(3, 3, 3), position=(0.3, 1.48, 0.1))], collider=[Plane()])
RNG = np.random.default_rng(7)


def changing(size, rng):
    """Make it a team that changes for every portion, of any length."""

    def portion(left):
        size.members = int(rng.integers(1, 3))
        return int(rng.integers(1, left + 1))

    size.portion = portion


@pytest.mark.parametrize(("method", "scene"), [("verlet", PAIR), ("backward-euler", LOW)])
def test_same_bits_when_the_number_changes(method, scene, request):
    """In the middle of frames too, and so does the work."""
    arch = request.config.getoption("--arch")
    if arch != "cpu" or len(runtime.usable_cores()) < 2:
        pytest.skip("teams are for several cores")
    runtime.start(arch, "f32", 2)
    steps = 3 if scene is LOW else 32
    simulation = Simulation(scene, method=method, team=2, ledger=True, substeps=steps)
    states = []
    for change in (lambda: simulation.system.size.hold(1), lambda: changing(simulation.system.size, RNG)):
        change()
        simulation.reset()
        simulation.advance(0.12)
        states.append([simulation.x, simulation.v, np.array(list(simulation.work.values()))])
    assert all(np.array_equal(one, other) for one, other in zip(*states, strict=True))
    assert simulation.energies()["contact"] > 0.0
