"""Extended position-based dynamics: what a step keeps exactly, what it may not make, and that nothing makes it fail."""

import numpy as np
import pytest
from reference import frame_energies, twisted

from taichi_jello import Box, Contact, Grab, Move, Pin, Plane, Scene, Simulation, Snapshot, Solver
from taichi_jello.physics.integrators.xpbd import MAX_AUTOMATIC_STEPS, colored
from taichi_jello.run.explain import facts

STILL = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module", autouse=True)
def taichi(best_precision):
    return best_precision


def turned(body, x):
    """The angle [degrees] of the rotation that takes the rest shape nearest to x."""
    u, _, vt = np.linalg.svd((x - x.mean(0)).T @ (body.rest - body.rest.mean(0)))
    trace = np.trace(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)
    return np.degrees(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)))


def at(simulation, dt):
    """The simulation with frames of as many steps as dt [s] asks for."""
    simulation.change_step(dt=dt)
    return simulation


def test_no_two_springs_of_a_color_share_a_particle():
    for points, kinds in (((8, 8, 8), 16), ((5, 1, 6), 6)):
        springs = Box(points=points).body().springs
        color = colored(springs, np.prod(points))
        assert color.max() + 1 == 2 * kinds  # two of each offset of the lattice
        for c in range(color.max() + 1):
            ends = springs[color == c].ravel()
            assert len(np.unique(ends)) == len(ends)


@pytest.fixture(scope="module")
def stiff():
    cube = Box(points=(4, 4, 4), stiffness=1e5, mass=0.125)
    return Simulation(Scene(gravity=STILL, jello=[cube], solver=Solver(frame_dt=0.02)), method="xpbd")


@pytest.mark.parametrize("dt", [4e-3, 1e-3, 5e-4, 2.5e-4])
def test_what_is_twisted_and_let_go_takes_its_shape_and_does_not_spin(stiff, dt):
    """A pass over the springs without more makes 28° at 1 ms, and more the shorter the step is."""
    simulation = at(stiff, dt)
    m, x = simulation.body.mass[:, None], twisted(simulation.body.x)
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    energy = frame_energies(simulation, 50)
    assert np.diff(energy).max() <= 1e-13 * energy[0] and energy[-1] < 1e-8 * energy[0]
    assert turned(simulation.body, simulation.x) < 0.1
    # Springs pull with 20 kN to begin with; 4000 steps of 1e-16 of their impulses come to less.
    assert np.abs((m * simulation.v).sum(0)).max() < 1e-12
    assert np.abs(np.cross(simulation.x, m * simulation.v).sum(0)).max() < 1e-12


def test_a_spinning_body_keeps_its_momenta(stiff):
    simulation, m = at(stiff, 1e-3), stiff.body.mass[:, None]
    x = simulation.body.x
    simulation.restore(Snapshot(0.0, x, np.cross([1.0, -2.0, 3.0], x) + [0.5, 0.2, -1.0]))

    def momenta():
        return np.concatenate([(m * simulation.v).sum(0), np.cross(simulation.x, m * simulation.v).sum(0)])

    before = momenta()
    simulation.advance(0.5)
    assert momenta() == pytest.approx(before, abs=1e-12)


def test_two_masses_swing_as_backward_euler_says():
    """One spring is solved exactly: its stretch and its rate go by the 2×2 matrix of an oscillator with ω² = 2k/m and
    ζ = c/(m ω), step after step; also after both have been tuned."""
    k, c, m, h = 50.0, 0.3, 0.5, 1e-2
    pair = Box(points=(2, 1, 1), mass=2 * m, stiffness=k, damping=c, springs=("structural",))
    simulation = Simulation(Scene(gravity=STILL, jello=[pair]), method="xpbd", dt=h)
    for scale in (1.0, 3.0):
        if scale > 1.0:
            simulation.tune(stiffness=scale, damping=scale)
        h, omega = simulation.dt, np.sqrt(2 * scale * k / m)
        a, zeta = omega * h, scale * c / (m * omega)
        matrix = simulation.system.integrator.amplification(np.array(a), np.array(zeta))
        simulation.restore(Snapshot(0.0, simulation.body.x * 1.1, np.zeros((2, 3))))
        state = np.array([0.1, 0.0])  # stretch, and its rate over ω
        for _ in range(60):
            simulation.step()
            state = matrix @ state
            d, w = np.diff(simulation.x, axis=0)[0, 0], np.diff(simulation.v, axis=0)[0, 0]
            assert [d - 1.0, w / omega] == pytest.approx(state, abs=1e-13)


@pytest.fixture(scope="module")
def odd():
    """Zero lengths, springs of 0 to 1e8 N/m, masses 1:1e4, a pinned side, the ground and a hand."""
    k = {"structural": 1e8, "shear": 0.0, "bend": 1e-6}
    box = Box(points=(3, 3, 3), stiffness=k, damping=1.0, position=(0.0, 0.7, 0.0), pin=[Pin(max=(0.0, 1.0, 1.0))])
    light = Box(points=(2, 2, 2), mass=1e-4, position=(1.5, 0.6, 0.0), stiffness=1e8)
    contact = Contact(stiffness=1e6, touch=False)
    return Simulation(Scene(jello=[box, light], collider=[Plane()], contact=contact, force=[Grab()]), method="xpbd")


@pytest.mark.parametrize("collapse", [0.0, 1e-12, 1.0])
def test_nothing_makes_it_fail(odd, collapse):
    start = (odd.body.x - [0.0, 0.2, 0.0]) * collapse
    odd.restore(Snapshot(0.0, start, odd.body.v))
    odd.grab([20], [1.0], (1.0, 2.0, 0.0))
    for _ in range(30):
        odd.frame()
    odd.release()
    assert np.isfinite(odd.x).all() and odd.x[:, 1].min() > -0.2
    assert np.array_equal(odd.x[odd.body.pinned], start[odd.body.pinned])


def test_the_hand_holds_a_jello_up():
    jello = Box(points=(4, 4, 4), position=(0.0, 0.8, 0.0), damping=1.0)
    simulation = Simulation(Scene(jello=[jello], collider=[Plane()], force=[Grab()]), method="xpbd")
    assert "x ahead" in facts(simulation)["fields"]["xpbd"]
    simulation.grab([63], [1.0], (0.0, 2.5, 0.0))
    for _ in range(180):
        simulation.frame()
    held = simulation.held
    assert held.force[1] == pytest.approx(9.81, rel=0.01) and np.abs(simulation.v).max() < 0.02


def test_a_point_slides_down_a_plane_as_coulomb_says():
    """g(sin α - μ cos α), with contact so stiff that a step does not resolve it."""
    alpha, mu = np.radians(30.0), 0.3
    plane = Plane(normal=(np.sin(alpha), np.cos(alpha), 0.0))
    scene = Scene(
        jello=[Box(points=(1, 1, 1), mass=0.01, position=(0.0, 0.0, 0.0))],
        collider=[plane],
        contact=Contact(stiffness=1e5, damping=2.0, friction=mu),
    )
    simulation = Simulation(scene, method="xpbd")
    assert simulation.substeps == MAX_AUTOMATIC_STEPS  # k dt²/m is 1.7
    simulation.advance(0.5)
    before = np.linalg.norm(simulation.v)
    simulation.advance(0.5)
    gained = (np.linalg.norm(simulation.v) - before) / 0.5
    assert gained == pytest.approx(9.81 * (np.sin(alpha) - mu * np.cos(alpha)), rel=0.01)


def test_jellos_that_collide_keep_their_momentum_and_a_run_cut_in_two_its_bits():
    def box(x, speed, n):
        return Box(points=(n, n, n), position=(x, 0.1 * x, 0.0), velocity=(speed, 0.0, 0.0), stiffness=2e3)

    simulation = Simulation(Scene(gravity=STILL, jello=[box(-0.53, 2.0, 3), box(0.53, -1.0, 2)]), method="xpbd")
    assert simulation.dt <= simulation.safe_dt < np.inf  # contact between jellos is taken explicitly
    simulation.change_step(substeps=simulation.substeps | 1)  # an odd number: the next frame sweeps the other way
    m = simulation.body.mass[:, None]
    before = (m * simulation.v).sum(0)
    simulation.step(5 * simulation.substeps)
    half = simulation.snapshot()
    simulation.step(8 * simulation.substeps)
    end = simulation.snapshot()
    assert (m * end.v).sum(0) == pytest.approx(before, abs=1e-12)
    assert end.v[:27, 0].mean() < 1.5 and end.v[27:, 0].mean() > 0.0  # both were stopped
    assert end.x[:27, 0].mean() < end.x[27:, 0].mean() - 0.8
    simulation.restore(half)
    simulation.step(8 * simulation.substeps)
    assert np.array_equal(end.x, simulation.x) and np.array_equal(end.v, simulation.v)


def test_other_methods_make_no_list_of_springs_by_color():
    for method in ("rk4", "symplectic-euler"):
        told = facts(Simulation(Scene(jello=[Box(points=(2, 2, 2))]), method=method))
        assert not {"xpbd", "spin", "budget"} & told["fields"].keys()


STARTS = {
    "flat": lambda x: x * [1.0, 0.0, 1.0],
    "line": lambda x: x * [0.0, 1.0, 0.0],
    "point": lambda x: 0.0 * x,
    "within 1 mm": lambda x: np.random.default_rng(1).uniform(-5e-4, 5e-4, x.shape),
    "random": lambda x: np.random.default_rng(2).uniform(-0.5, 0.5, x.shape),
    "mirrored and twisted": lambda x: twisted(x) * [-1.0, 1.0, 1.0],
    "squashed": lambda x: x * [1.0, 0.4, 1.0],
    "half of it squashed": lambda x: np.where(x[:, 1:2] > 0.0, x * [1.0, 0.05, 1.0], x),
    "shrunk": lambda x: 0.5 * x,
    "stretched": lambda x: x * [1.0, 3.0, 1.0],
    "twisted": lambda x: twisted(x, 360.0),
}


def most_energy(simulation, x, frames):
    """The most kinetic + elastic energy at the end of a frame, over what there was when all were let go at x."""
    simulation.restore(Snapshot(0.0, x, np.zeros_like(x)))
    energy = frame_energies(simulation, frames)
    return energy[1:].max() / energy[0]


@pytest.fixture(scope="module", params=[0.25, 0.0], ids=["damped", "undamped"])
def loose(request):
    cube = Box(points=(5, 5, 5), stiffness=1.0, damping=request.param)
    return Simulation(Scene(gravity=STILL, jello=[cube]), method="xpbd")


@pytest.mark.parametrize("substeps", [1, 4, 40, 400, "auto"])
@pytest.mark.parametrize("k", [1.0, 1e3, 1e5, 1e8])
def test_no_start_feeds_energy(loose, k, substeps):
    """Without a budget a stiff cube that starts squashed has up to five times its energy after a frame."""
    loose.tune(stiffness=k)
    loose.change_step(**{"dt": "auto"} if substeps == "auto" else {"substeps": substeps})
    m, x = loose.body.mass[:, None], loose.body.x
    for name, begin in STARTS.items():
        assert most_energy(loose, begin(x), max(2, 60 // loose.substeps)) <= 1.0 + 1e-9, name
        fastest = np.sqrt(k)  # m/s, of what begins like that
        assert np.abs((m * loose.v).sum(0)).max() < 1e-12 * fastest, name
        assert np.abs(np.cross(loose.x, m * loose.v).sum(0)).max() < 1e-12 * fastest, name


def test_a_large_cube_that_starts_flat_feeds_no_energy():
    cube = Box(stiffness=1e5, damping=0.25)
    simulation = Simulation(Scene(gravity=STILL, jello=[cube]), method="xpbd")
    assert len(simulation.body) == 512
    assert most_energy(simulation, simulation.body.x * [1.0, 0.0, 1.0], 10) <= 1.0


def test_what_is_pinned_feeds_no_energy_and_stays_where_it_is():
    cube = Box(points=(4, 4, 4), stiffness=1e5, damping=0.25, pin=[Pin(max=(0.0, 1.0, 1.0))])
    simulation = Simulation(Scene(gravity=STILL, jello=[cube]), method="xpbd")
    pinned = simulation.body.pinned
    for substeps in (1, 40):
        simulation.change_step(substeps=substeps)
        for name in ("flat", "squashed", "random", "shrunk"):
            start = STARTS[name](simulation.body.x)
            assert most_energy(simulation, start, 10) <= 1.0 + 1e-9, name
            assert np.array_equal(simulation.x[pinned], start[pinned])


def test_a_handle_pulls_a_crushed_jello_along():
    path = [Move(time=0.0, offset=STILL), Move(time=0.5, offset=(1.0, 0.0, 0.0))]
    cube = Box(points=(4, 4, 4), stiffness=1e5, damping=0.25, pin=[Pin(max=(0.0, 1.0, 1.0), keyframe=path)])
    simulation = Simulation(Scene(gravity=STILL, jello=[cube]), method="xpbd")
    x = simulation.body.x
    simulation.restore(Snapshot(0.0, x * [1.0, 0.4, 1.0], np.zeros_like(x)))
    for _ in range(60):
        simulation.frame()
    assert simulation.x[:, 0].mean() == pytest.approx(1.0, abs=0.1)


def test_of_two_jellos_only_that_which_is_crushed_is_limited():
    """The other one, a cube that swings, goes on to the bits."""
    cubes = [Box(points=(4, 4, 4), position=(3.0 * n, 0.0, 0.0), stiffness=1e5, damping=0.25) for n in range(2)]
    simulation = Simulation(Scene(gravity=STILL, jello=cubes, contact=Contact(touch=False)), method="xpbd")
    x, ends = simulation.body.x.copy(), []
    x[:64] = x[:64] * [1.0, 1.1, 1.0]
    for height in (1.0, 0.4):
        x[64:] = simulation.body.x[64:] * [1.0, height, 1.0]
        assert most_energy(simulation, x, 5) <= 1.0
        ends.append(simulation.x)
    assert np.array_equal(ends[0][:64], ends[1][:64]) and not np.array_equal(ends[0][64:], ends[1][64:])
