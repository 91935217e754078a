"""Sheets and ropes in one plane, and ropes that lie on solids."""

from dataclasses import replace

import numpy as np
import pytest
from touching_pairs import placed

from taichi_jello import Box, Contact, Pin, Plane, Ring, Rope, Scene, Sheet, Simulation
from taichi_jello.physics.forces.soft_contact.surface.shapes import THICKNESS
from taichi_jello.physics.forces.soft_contact.thin_contacts import COPLANAR
from taichi_jello.run.checks.start_warnings import SceneWarning
from taichi_jello.shapes.lattice import rotation
from taichi_jello.support import runtime

WEIGHTLESS = {"gravity": (0.0, 0.0, 0.0)}
SHEET = Sheet(points=(9, 9), size=(1.0, 1.0))
HARD = Contact(stiffness=2000.0, damping=0.5)


@pytest.fixture(scope="module", autouse=True)
def taichi(request):
    runtime.start(request.config.getoption("--arch"), "f32")


@pytest.fixture(scope="module")
def sheets():
    return Simulation(Scene(**WEIGHTLESS, jello=[SHEET, replace(SHEET, position=(0.0, 2.0, 0.0))]), method="rk4")


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.3, 0.0, 0.17)])
def test_sheets_in_one_plane_leave_it_by_two_sides(sheets, shift):
    for turn in (np.eye(3), rotation((180.0, 0.0, 0.0)), rotation((0.0, 33.0, 0.0))):
        placed(sheets, (np.eye(3), turn), np.array(shift))
        sheets.advance(0.5)
        first = sheets.body.jello == 0
        assert sheets.energies()["contact"] == 0.0
        assert sheets.x[first, 1].mean() > sheets.x[~first, 1].mean() + 0.1


def test_ropes_in_one_line_leave_it_by_two_sides():
    ropes = [Rope(points=8, length=1.0), Rope(points=8, length=1.0, position=(0.5, 0.0, 0.0))]
    simulation = Simulation(Scene(**WEIGHTLESS, jello=ropes), method="rk4")
    with pytest.warns(SceneWarning, match="closer to a sheet or rope than its thickness"):
        simulation.advance(0.5)
    first = simulation.body.jello == 0
    assert simulation.energies()["contact"] == 0.0
    assert np.linalg.norm(simulation.x[first].mean(0) - simulation.x[~first].mean(0) + [0.5, 0.0, 0.0]) > 0.1


@pytest.fixture(scope="module")
def ropes():
    return Simulation(Scene(**WEIGHTLESS, jello=[Rope(points=9, length=1.0)] * 2), method="rk4")


@pytest.mark.parametrize(
    ("angle", "shift"),
    [(90.0, (0.0, 0.0, 0.0)), (30.0, (0.0, 0.0, 0.0)), (70.0, (0.2, 0.0, 0.1)), (90.0, (0, 0, 0.45))],
)
def test_ropes_that_cross_in_one_plane_leave_it_by_two_sides(angle, shift, ropes):
    """Pressed to both sides of each other all of these stayed."""
    apart, energy = 2.0 * THICKNESS["rope"] / 8.0, []
    for height in (2.0 * COPLANAR * apart, 0.0):
        placed(ropes, (np.eye(3), rotation((0.0, angle, 0.0))), np.add(shift, (0.0, -height, 0.0)))
        energy.append(sum(ropes.energies().values()))
    assert energy[1] == pytest.approx(energy[0], rel=0.01)
    ropes.advance(0.5)
    assert ropes.energies()["contact"] == 0.0 and sum(ropes.energies().values()) < energy[1]
    first, second = (ropes.x[ropes.body.jello == j, 1].mean() for j in (0, 1))
    assert first > second + 0.1


def test_a_rope_that_comes_end_first_stays_in_the_plane(ropes):
    """Its line goes through the other rope; itself it does not."""
    v = np.where((ropes.body.jello == 1)[:, None], [0.0, 0.0, -0.5], 0.0)
    placed(ropes, (np.eye(3), rotation((0.0, 90.0, 0.0))), (0.02, 0.0, 0.7), v)
    energy = sum(ropes.energies().values())
    for _ in range(60):
        ropes.frame()
        assert sum(ropes.energies().values()) < energy * (1.0 + 1e-5)
    assert np.abs(ropes.x[:18, 1]).max() < 1e-6
    assert ropes.v[ropes.body.jello == 0, 2].mean() < -0.1  # it was hit


def test_a_rope_hangs_over_a_bar():
    rope = Rope(points=24, length=2.0, mass=3.0, damping=0.1, stiffness=3000.0, position=(0.0, 0.4, 0.0))
    bar = Box(points=(3, 3, 10), size=(0.2, 0.2, 1.0), position=(0.0, 0.2, 0.0), pin=[Pin()])
    simulation = Simulation(Scene(jello=[rope, bar], contact=HARD), method="rk4")
    simulation.advance(2.0)
    low, high = np.sort(simulation.x[:24, 1])[[0, -1]]
    assert low < 0.0 and 0.3 <= high < 0.45  # over the upper face, at 0.3


def test_a_rope_that_comes_to_lie_on_a_ring_feeds_no_energy():
    """Where its points came between two of the ring's they were pressed deeper and out again: 0.36 J at 0.7 s, 14 J
    at 3 s, of 1.4 J that there are."""
    ring = Ring(radius=0.3, thickness=0.15, points=(20, 3), rotation=(90.0, 0.0, 0.0), position=(0.0, 0.076, 0.0))
    ring = replace(ring, mass=0.5, stiffness=150.0, damping=0.1)
    rope = Rope(points=25, length=1.6, position=(0.0, 0.35, 0.02), rotation=(0.0, 30.0, 0.0), mass=0.3, stiffness=200.0)
    scene = Scene(jello=[ring, replace(rope, damping=0.1)], collider=[Plane()])
    simulation = Simulation(scene, method="rk4", ledger=True)
    energy = sum(simulation.energies().values())
    simulation.advance(0.7)
    assert simulation.energies()["contact"] > 0.0 and simulation.energy_residual < 0.01 * energy


def test_a_rope_that_falls_on_a_ring_feeds_no_energy():
    """The ring's points pushed its segments as well, as long as that was not farther in: 1.7 J in the first second, of
    3.8 J that there are. What there is now is from the ring, which begins off the ground."""
    ring = Ring(radius=0.5, thickness=0.2, points=(24, 3), rotation=(90.0, 0.0, 0.0), position=(0.0, 0.15, 0.0))
    rope = Rope(points=24, length=2.0, position=(0.3, 0.8, 0.1), rotation=(0.0, 20.0, 0.0), mass=0.3)
    jello = [replace(one, stiffness=300.0, damping=0.2) for one in (ring, rope)]
    scene = Scene(jello=jello, collider=[Plane()], contact=HARD)
    simulation, fed = Simulation(scene, method="rk4", ledger=True), 0.0
    energy = sum(simulation.energies().values())
    for _ in range(60):
        simulation.frame()
        fed = max(fed, simulation.energy_residual)
    assert fed < 0.01 * energy
    lies = simulation.x[simulation.body.jello == 1]
    assert np.any((np.abs(np.hypot(lies[:, 0], lies[:, 2]) - 0.5) < 0.1) & (lies[:, 1] > 0.19))
