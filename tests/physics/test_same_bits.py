"""The same run gives the same bits: twice, by one thread, a team of two or in parallel tasks."""

import numpy as np
import pytest
import taichi as ti

from taichi_jello import Box, Contact, Move, Pin, Plane, Room, Scene, Simulation, Snapshot, Sphere
from taichi_jello.physics import system
from taichi_jello.physics.forces._base import ParticleForce
from taichi_jello.physics.integrators import schemes
from taichi_jello.physics.stable_step import stable_limit
from taichi_jello.support import runtime

FULL = Scene(
    jello=[
        Box(points=(5, 6, 7), position=(0.0, 0.9, 0.0), rotation=(10.0, 20.0, 30.0)),
        Box(points=(5, 5, 5), position=(0.5, 1.9, 0.1)),
    ],
    collider=[
        Plane(),
        Sphere(center=(0.2, 0.0, 0.0), radius=0.3, swing=(0.1, 0.0, 0.0)),
        Room(min=(-3, -1, -3), max=(3, 6, 3)),
    ],
    drag=0.1,
)
PAIR = Scene(jello=FULL.jello)
PLAIN = Scene(jello=FULL.jello[:1], collider=FULL.collider[1:2])  # compiles in a third of the time


def final_state(arch, precision, threads, method, scene=PLAIN, **form):
    """After a frame and a half, for the colliders' motion is set anew at each frame."""
    runtime.start(arch, precision, threads)
    substeps = 2 if np.isinf(stable_limit(schemes()[method].amplification, [0.0])[0]) else 16
    simulation = Simulation(scene, method=method, substeps=substeps, **form)
    simulation.step(substeps * 3 // 2)
    # Where jellos touch, contacts are found anew for the energies, outside the loop that a team shares.
    energies = simulation.energies().values() if scene is FULL else ()
    return np.array([*simulation.x.ravel(), *simulation.v.ravel(), *energies])


CASES = [(method, "f32", PLAIN) for method in sorted(schemes())] + [
    ("rk4", "f64", FULL),
    ("backward-euler", "f32", PAIR),
]


@pytest.mark.filterwarnings("ignore:dt = ")
@pytest.mark.parametrize("method, number, scene", CASES)
def test_same_bits_in_every_form(method, number, scene, request):
    arch = request.config.getoption("--arch")
    number = "f32" if arch in ("vulkan", "metal") else number
    one = final_state(arch, number, 1, method, scene)
    assert np.isfinite(one).all()
    forms = [{"team": 2}, {"team": 0}] if arch == "cpu" else [{}]
    # Backward Euler alone shows it of the solver, and RK4 of contact.
    for form in forms[:1] if method in ("bdf2", "sdirk2") or scene is PAIR else forms:
        assert np.array_equal(one, final_state(arch, number, 2, method, scene, **form))


def test_same_bits_twice_from_the_same_simulation(best_precision):
    simulation = Simulation(PLAIN)
    simulation.advance(0.2)
    once = simulation.snapshot()
    simulation.reset()
    simulation.advance(0.2)
    assert np.array_equal(once.x, simulation.x) and np.array_equal(once.v, simulation.v)


@ti.data_oriented
class Herd(ParticleForce):
    """Every particle is drawn to one of 37 points, which are means of particles far from each other."""

    title, prepares, points = "herd", True, 37

    def __init__(self, particles):
        self.count = particles.count
        self.middle = particles.memory.table(self.title, "middle", np.zeros((self.points, 3)))

    @classmethod
    def made_for(cls, scene, particles):
        return [cls(particles)]

    @ti.func
    def prepare(self, first, last, x, v, t):
        for k in range(first, last):
            total = ti.Vector([0.0, 0.0, 0.0])
            for other in range(8):
                total += x[(k * 131 + other * 97) % self.count]
            self.middle[k] = total / 8.0

    @ti.func
    def on(self, i, x, v, t):
        return 0.05 * (self.middle[i % self.points] - x[i])


@pytest.mark.filterwarnings("ignore:dt = ")
def test_same_bits_where_a_force_prepares(monkeypatch, request):
    arch, kinds = request.config.getoption("--arch"), system.force_kinds()
    monkeypatch.setattr(system, "force_kinds", lambda: [*kinds, Herd])
    teams = (1, 2, 0) if arch == "cpu" else (0, 0)
    runs = [final_state(arch, "f32", 2, "symplectic-euler", team=team) for team in teams]
    assert all(np.array_equal(runs[0], run) for run in runs[1:])
    monkeypatch.undo()
    assert not np.array_equal(runs[0], final_state(arch, "f32", 2, "symplectic-euler"))


def test_same_bits_in_every_form_where_springs_change_one_by_one(request):
    """Yielding, tearing and pulled by a handle."""
    arch = request.config.getoption("--arch")
    path = [Move(time=0.0, offset=(0.0, 0.0, 0.0)), Move(time=0.2, offset=(0.8, 0.0, 0.0))]
    pins = [Pin(max=(0.0, 1.0, 1.0)), Pin(min=(1.0, 0.0, 0.0), keyframe=path)]
    slab = Box(points=(5, 4, 7), creep=1.0, yield_strain=0.2, tear_strain=0.7, pin=pins)
    states = []
    for threads, form in ((1, {}), (2, {"team": 2}), (2, {"team": 0})) if arch == "cpu" else ((1, {}),) * 2:
        runtime.start(arch, "f32", threads)
        simulation = Simulation(Scene(jello=[slab]), **form)
        simulation.advance(0.25)
        assert not simulation.snapshot().memory["whole"].all()
        states.append((simulation.x, simulation.v))
    assert all(np.array_equal(states[0], other) for other in states[1:])


def test_same_bits_in_every_form_where_energy_is_limited(request):
    """A crushed jello, one that is held and one at rest."""
    arch, stiff = request.config.getoption("--arch"), {"stiffness": 1e5, "damping": 0.25}
    free = Box(points=(5, 6, 9), **stiff)
    held = Box(points=(4, 4, 4), position=(3.0, 0.0, 0.0), pin=[Pin(max=(0.0, 1.0, 1.0))], **stiff)
    rest, apart = Box(points=(3, 3, 3), position=(6.0, 0.0, 0.0)), Contact(touch=False)
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[free, held, rest], contact=apart)
    states = []
    for threads, form in ((1, {}), (2, {"team": 2}), (2, {"team": 0})) if arch == "cpu" else ((1, {}),) * 2:
        runtime.start(arch, "f32", threads)
        simulation = Simulation(scene, method="xpbd", substeps=10, **form)
        flat = np.where(simulation.body.jello[:, None] < 2, [1.0, 0.3, 1.0], 1.0)
        simulation.restore(Snapshot(0.0, simulation.body.x * flat, simulation.body.v))
        before = sum(simulation.energies().values())
        simulation.step(15)
        assert sum(simulation.energies().values()) < before  # else it has 1.4 times as much
        states.append((simulation.x, simulation.v))
    assert all(np.array_equal(states[0], other) for other in states[1:])
