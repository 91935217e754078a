"""Motions whose answer is known in closed form, for every scheme that there is, in both precisions."""

from math import acos, atan2, cos, exp, hypot, pi, sin, sqrt

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import spsolve

from taichi_jello import Box, Contact, Pin, Plane, Scene, Simulation, Snapshot
from taichi_jello.physics.integrators import schemes

STILL = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module", autouse=True)
def taichi(precision):
    return precision


def rounding(epsilon, steps):
    """How far that many roundings of numbers near 1 may add up, one unit each in the worst direction."""
    return epsilon * (8 + steps)


def two_masses(method, k, c, m, stretch, dt):
    scene = Scene(
        gravity=STILL,
        jello=[Box(points=(2, 1, 1), mass=2 * m, stiffness=k, damping=c, springs=("structural",))],
    )
    simulation = Simulation(scene, method=method, dt=dt)
    start = simulation.snapshot()
    simulation.restore(Snapshot(0.0, start.x * (1.0 + stretch), start.v))
    return simulation


def test_two_masses_and_a_damped_spring(scheme, epsilon):
    """r(t) = R + A e^(-ct/m) [cos ωt + c/(mω) sin ωt], ω = √(2k/m - c²/m²), from rest at R + A."""
    k, c, m, stretch, seconds = 50.0, 0.3, 0.5, 0.1, 0.5
    simulation = two_masses(scheme, k, c, m, stretch, 1e-3)
    steps = round(seconds / simulation.dt)
    simulation.step(steps)
    t, decay = steps * simulation.dt, c / m
    omega = sqrt(2 * k / m - decay**2)
    exact = 1.0 + stretch * exp(-decay * t) * (cos(omega * t) + decay / omega * sin(omega * t))
    x = simulation.x
    # The local error of an order-p method is below (ω dt)^(p + 1) of the amplitude a step; it adds up over the steps.
    order = schemes()[scheme].order
    limit = stretch * steps * (omega * simulation.dt) ** (order + 1) + rounding(epsilon, steps)
    assert np.linalg.norm(x[1] - x[0]) == pytest.approx(exact, abs=limit)


def test_symplectic_euler_swings_at_its_own_exact_frequency(epsilon):
    """Undamped, r_n - R = A cos(θ(n + ½))/cos(θ/2) with cos θ = 1 - ω²h²/2: frequency (2/h) asin(ωh/2)."""
    k, m, stretch = 50.0, 0.5, 0.1
    simulation = two_masses("symplectic-euler", k, 0.0, m, stretch, 1.0 / 120.0)
    theta = acos(1.0 - 2 * k / m * simulation.dt**2 / 2)
    for n in range(1, 60):
        simulation.step()
        x = simulation.x
        exact = 1.0 + stretch * cos(theta * (n + 0.5)) / cos(theta / 2)
        # A rounding of the velocity grows linearly in the position: n²/2 of them.
        assert np.linalg.norm(x[1] - x[0]) == pytest.approx(exact, abs=epsilon * (8 + n * n / 2))


@pytest.fixture(scope="module")
def point(precision, scheme):
    """A point of 10 g beside a wall at x = 0. One simulation for two tests: it takes long to compile."""
    scene = Scene(
        jello=[Box(points=(1, 1, 1), mass=0.01)],
        collider=[Plane(normal=(1.0, 0.0, 0.0))],
        contact=Contact(stiffness=2000.0, damping=2.0, friction=0.0),
    )
    return Simulation(scene, method=scheme, dt=2e-5)


@pytest.mark.filterwarnings("ignore:dt = ")  # nothing is touched
def test_free_fall(point, scheme, epsilon):
    """Second order and above: exact. Symplectic and backward Euler fall -g h² n(n+1)/2, Euler -g h² n(n-1)/2. BDF2
    begins with a step of backward Euler, g h²/2 too far, from which 3 e(n+1) = 4 e(n) - e(n-1) leads to 3/4 g h²."""
    simulation = point
    simulation.tune(gravity=(0.0, -9.81, 0.0))
    simulation.change_step(substeps=4)
    simulation.restore(Snapshot(0.0, np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3))))
    n, h, g = 100, simulation.dt, 9.81
    simulation.step(n)
    late = g * h**2 * n * (n + 1) / 2
    fallen = {"euler": g * h**2 * n * (n - 1) / 2, "symplectic-euler": late, "backward-euler": late, "xpbd": late}
    fallen["bdf2"] = g * (n * h) ** 2 / 2 + 0.75 * g * h**2 * (1.0 - 3.0**-n)
    exact = fallen.get(scheme, g * (n * h) ** 2 / 2)
    assert simulation.x[0, 1] == pytest.approx(-exact, abs=rounding(epsilon, n) * exact)
    assert simulation.v[0, 1] == pytest.approx(-g * n * h, rel=rounding(epsilon, n))


def test_hanging_chain_sags_as_its_weight_says(scheme, epsilon):
    """n equal masses under one another: the spring above the j-th carries n - j + 1 of them, in all n(n+1)mg/2k."""
    n, k, m = 5, 400.0, 0.02
    scene = Scene(
        drag=15.0,
        jello=[
            Box(
                points=(1, n + 1, 1),
                mass=(n + 1) * m,
                stiffness=k,
                damping=1.0,
                springs=("structural",),
                pin=[Pin(min=(0.0, 1.0, 0.0))],
            )
        ],
    )
    dt = 2e-4 if scheme == "xpbd" else "auto"
    simulation = Simulation(scene, method=scheme, dt=dt)
    simulation.advance(4.0)
    assert simulation.x[-1, 1] == pytest.approx(0.5, abs=1e-12 + epsilon)  # the pinned end stays
    sag = -0.5 - simulation.x[0, 1]
    # The slowest mode of the chain decays by e^-15 or more in 4 s at this drag and damping. One pass over the springs
    # takes as many steps as there are springs to pass a load on: it sags by up to n² k dt²/2m more.
    softer = n * n / 2 * k / m * simulation.dt**2 if scheme == "xpbd" else 0.0
    assert sag == pytest.approx(n * (n + 1) * m * 9.81 / (2 * k), rel=1e-5 + softer, abs=1e3 * epsilon)


def test_bounce_of_one_point_on_a_penalty_wall(point, scheme, epsilon):
    """Restitution e = exp[-(β/ω)(π - atan2(2βω, ω² - β²))] with β = c/2m, ω = √(k/m - β²): the force never pulls,
    so the point leaves when kx + cv = 0, not when x = 0."""
    k, c, m, speed = 2000.0, 2.0, 0.01, 1.0
    dt, simulation = 2e-5, point
    simulation.tune(gravity=STILL)
    simulation.change_step(dt=dt)
    simulation.restore(Snapshot(0.0, np.array([[1e-9, 0.0, 0.0]]), np.array([[-speed, 0.3, 0.0]])))
    beta = c / (2 * m)
    omega = sqrt(k / m - beta**2)
    simulation.advance(1.5 * pi / omega)
    exact = exp(-beta / omega * (pi - atan2(2 * beta * omega, omega**2 - beta**2)))
    # The force jumps at touch-down and the moment of leaving is known to one step: first order for every method.
    assert simulation.v[0, 0] == pytest.approx(exact * speed, abs=2 * hypot(beta, omega) * dt + 100 * epsilon)
    assert simulation.v[0, 1] == pytest.approx(0.3, abs=rounding(epsilon, 1000))


def test_pinned_lattice_sags_as_the_linear_solution(epsilon):
    """Under a hundredth of gravity the lattice answers linearly: K u = m g, K from its springs at rest."""
    g = 0.0981
    box = Box(points=(4, 3, 4), size=(1.0, 0.6, 1.0), damping=1.0, pin=[Pin(max=(0.0, 1.0, 1.0))])
    simulation = Simulation(Scene(gravity=(0.0, -g, 0.0), drag=4.0, jello=[box]), method="rk4")
    body = simulation.body
    simulation.advance(6.0)

    i, j = body.springs.T
    block = body.stiffness[:, None, None] * np.einsum("si,sj->sij", body.direction, body.direction)
    rows, cols, values = [], [], []
    for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
        for p in range(3):
            for q in range(3):
                rows.append(3 * a + p), cols.append(3 * b + q), values.append(sign * block[:, p, q])
    K = csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(cols))))
    free = np.repeat(~body.pinned, 3)
    load = (body.mass[:, None] * [0.0, -g, 0.0]).ravel()
    u = np.zeros(len(free))
    u[free] = spsolve(K[free][:, free].tocsc(), load[free])
    moved = (simulation.x - body.x).ravel()
    assert np.abs(moved - u).max() <= 0.01 * np.abs(u).max() + 100 * epsilon
