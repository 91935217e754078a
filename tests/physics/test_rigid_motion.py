"""How jellos move as wholes: sums over their particles, turning, and the motion of a free one."""

import numpy as np
import pytest

from taichi_jello.physics.adaptive import rigid_motion
from taichi_jello.physics.adaptive.rigid_motion import RigidMotion, rotation, turned

DRAW = np.random.default_rng(5)


def box(points=(4, 4, 4), size=(1.0, 1.0, 1.0)):
    """(N, 3) a lattice about the origin."""
    axes = [s * (np.arange(n) / (n - 1) - 0.5) for n, s in zip(points, size, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def alone(x, mass=1.0):
    """Of one jello with a mass in all, evenly divided."""
    return RigidMotion.of_one(np.full((len(x), 1), mass / len(x)))


def test_centre_velocity_spin_and_momentum_of_two_that_move_as_wholes():
    """Particles of unequal masses; a cube of n³ points has I = m (n + 1)/(n - 1)/6 about any axis."""
    rest, mass = box(), 2.0
    turn = rotation(np.array([[0.3, -0.5, 0.8]]))[0]
    centre = np.array([[1.0, 2.0, 3.0], [-4.0, 0.5, 0.0]])
    velocity, spin = np.array([[1.0, 0.0, -2.0], [0.0, 3.0, 0.0]]), np.array([[3.0, -1.0, 2.0], [0.0, 0.0, 5.0]])
    arms = [rest @ turn.T, rest[:40] - rest[:40].mean(0)]  # a part is a box of unequal moments of inertia
    x = np.concatenate([arm + c for arm, c in zip(arms, centre, strict=True)])
    v = np.concatenate([u + np.cross(w, arm) for arm, u, w in zip(arms, velocity, spin, strict=True)])
    owner = np.repeat([0, 1], [64, 40])
    each = np.full((104, 1), mass / 64)
    whole = RigidMotion(owner, each)
    found = whole.of(x, v)
    assert whole.mass[:, 0] == pytest.approx([mass, mass * 40 / 64])
    for told, known in ((found.centre, centre), (found.velocity, velocity), (found.spin, spin)):
        assert np.abs(told - known).max() < 1e-8  # MIN_INERTIA: a billionth of the inertia
    assert found.momentum[0] == pytest.approx(mass * 5.0 / 3.0 / 6.0 * spin[0])
    assert np.abs(whole.field(found, x) - v).max() < 1e-8
    kinetic = 0.5 * np.array([(each * v**2)[owner == j].sum() for j in (0, 1)])
    assert whole.speed(found) == pytest.approx(np.sqrt(2.0 * kinetic / whole.mass[:, 0]))


def test_uneven_masses_move_the_centre_and_what_deforms_has_no_spin():
    rest = box()
    each = DRAW.uniform(0.1, 1.0, (64, 1))
    whole = RigidMotion.of_one(each)
    noise = DRAW.standard_normal((64, 3))
    found = whole.of(rest, noise)
    assert found.centre[0] == pytest.approx((each * rest).sum(0) / each.sum())
    left = whole.of(rest, noise - whole.field(found, rest))
    assert np.abs(left.velocity).max() < 1e-12 and np.abs(left.momentum).max() < 1e-8


def test_a_point_and_a_rope_have_finite_spins():
    for x in (np.zeros((1, 3)), np.linspace([0, 0, 0], [1, 0, 0], 7)):
        found = alone(x).of(x, DRAW.standard_normal(x.shape))
        assert np.isfinite(found.spin).all()


def test_rotation_is_orthogonal_and_turns_by_the_angle_about_the_axis():
    vectors = np.concatenate([DRAW.standard_normal((20, 3)) * 3.0, [[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0], [0, 0, np.pi]]])
    found = rotation(vectors)
    assert np.abs(found @ np.swapaxes(found, 1, 2) - np.eye(3)).max() < 1e-14
    assert np.linalg.det(found) == pytest.approx(np.ones(len(vectors)))
    assert np.einsum("jik,jk->ji", found, vectors) == pytest.approx(vectors, abs=1e-14)  # the axis stays
    assert np.trace(found, axis1=1, axis2=2) == pytest.approx(1.0 + 2.0 * np.cos(np.linalg.norm(vectors, axis=1)))
    quarter = rotation(np.array([[0.0, 0.0, np.pi / 2]]))[0]
    assert quarter @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)  # counter-clockwise


def test_a_cube_turns_by_exactly_its_spin():
    rest, spin = box(), np.array([20.0, -40.0, 40.0])
    motion = alone(rest).of(rest, np.cross(spin, rest))
    for seconds in (1e-3, 0.05, 1.0):
        assert turned(motion, seconds)[0] == pytest.approx(rotation(seconds * spin[None])[0], abs=1e-7)


def after(rest, spin, seconds, steps):
    """How a free rigid box has turned, and its spin, by that many turns by `turned`."""
    whole, turn = alone(rest), np.eye(3)
    momentum = whole.of(rest, np.cross(spin, rest)).momentum
    for _ in range(steps):
        x = rest @ turn.T
        inertia = whole.of(x, np.zeros_like(x)).inertia
        now = np.linalg.solve(inertia, momentum[..., None])[..., 0]
        motion = whole.of(x, np.cross(now[0], x))
        assert motion.momentum == pytest.approx(momentum, rel=1e-7)
        turn = turned(motion, seconds / steps)[0] @ turn
    return turn, now[0]


def test_a_box_that_tumbles_keeps_its_angular_momentum_as_the_midpoint_rule_does(monkeypatch):
    """Where the moments of inertia differ, the direction of the spin wanders and that of L in the body with it. The
    rule is of second order: half the step, a quarter of the error; it is within (ω dt)³/10 a step."""
    rest, spin, seconds = box(size=(1.0, 0.6, 0.3)), np.array([2.0, 3.0, 1.0]), 1.0
    monkeypatch.setattr(rigid_motion, "MAX_PARTS", 1)  # no parts
    exact = after(rest, spin, seconds, 800)[0]
    errors = [np.abs(after(rest, spin, seconds, steps)[0] - exact).max() for steps in (10, 20, 40)]
    assert errors[0] < 10 * (np.linalg.norm(spin) * 0.1) ** 3 / 10.0
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.15)


def test_what_turns_by_that_has_its_angular_momentum_on_the_way():
    """ω of the turn, with the moments of inertia half-way, is L, in size and direction, to (ω dt)²/8."""
    rest, spin = box(size=(1.0, 0.6, 0.3)), np.array([2.0, 3.0, 1.0])
    before = alone(rest).of(rest, np.cross(spin, rest))
    off = []
    for dt in (0.2, 0.1, 0.05):
        turn = turned(before, dt)[0]
        axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2.0  # sin of it
        vector = axis / np.linalg.norm(axis) * np.arcsin(np.linalg.norm(axis))
        half = rotation(0.5 * vector[None])[0]
        momentum = half @ before.inertia[0] @ half.T @ vector / dt
        off.append(np.linalg.norm(momentum - before.momentum[0]) / np.linalg.norm(before.momentum[0]))
        assert off[-1] < (np.linalg.norm(spin) * dt) ** 2 / 8.0
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.2) and off[1] / off[2] == pytest.approx(4.0, rel=0.2)
