"""Material by Young's modulus and density: the same body, whatever its resolution."""

import numpy as np
import pytest
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import cg

from taichi_jello import Ball, Box, Pin, Region, Ring, Rope, SceneError, Sheet
from taichi_jello.run.assembly import built

STUFF = {"young": 2000.0, "density": 500.0}


def stiffness_matrix(body):
    """The linearised spring forces at rest, (3N, 3N)."""
    n = body.rest[body.springs[:, 1]] - body.rest[body.springs[:, 0]]
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    block = (body.stiffness[:, None, None] * n[:, :, None] * n[:, None, :]).ravel()
    ends = [(body.springs[:, p], body.springs[:, q], 1.0 if p == q else -1.0) for p in (0, 1) for q in (0, 1)]
    row = np.concatenate([np.repeat(3 * a, 9) + np.tile([0, 0, 0, 1, 1, 1, 2, 2, 2], len(a)) for a, _, _ in ends])
    column = np.concatenate([np.repeat(3 * b, 9) + np.tile([0, 1, 2] * 3, len(b)) for _, b, _ in ends])
    values = np.concatenate([sign * block for _, _, sign in ends])
    return coo_matrix((values, (row, column)), shape=(3 * len(body), 3 * len(body))).tocsc()


def hung(points, size=(1.0, 1.0, 1.0), **options):
    """The sag [m] of the lower end of a box that hangs by its top, and its lowest frequency [Hz]."""
    body = built(Box(points=points, size=size, pin=[Pin(min=(0, 1, 0))], **STUFF, **options))
    free = np.repeat(~body.pinned, 3)
    k, mass = stiffness_matrix(body)[free][:, free].tocsr(), np.repeat(body.mass, 3)[free]

    def solve(force):
        found, failed = cg(k, force, rtol=1e-6, M=diags(1.0 / k.diagonal()))
        assert not failed
        return found

    u = np.zeros(3 * len(body))
    u[free] = solve(-9.81 * mass * (np.flatnonzero(free) % 3 == 1))
    mode = np.repeat(0.5 * size[1] - body.rest[:, 1], 3) * (np.arange(3 * len(body)) % 3 == 0)
    mode = mode[free]
    for _ in range(3):  # inverse iteration from a swing to the side; the next such mode is above twice its frequency
        mode = solve(mass * mode)
        mode /= np.linalg.norm(mode)
    omega = np.sqrt(mode @ (k @ mode) / (mode @ (mass * mode)))
    lowest = body.rest[:, 1] < body.rest[:, 1].min() + 1e-9
    return -u[1::3][lowest].mean(), omega / (2 * np.pi)


def test_8_and_16_points_an_edge_sag_and_swing_alike():
    coarse, fine = hung((8, 8, 8)), hung((16, 16, 16))
    assert coarse == pytest.approx(fine, rel=0.05)
    assert coarse == pytest.approx(fine, rel=0.012)  # 0.8 % and 0.9 % as measured, which this holds


def test_a_long_bar_sags_and_swings_as_the_textbook_says():
    """ρgL²/2E, and of its bending β₁²/2π √(EI/ρA)/L², β₁ = 1.8751, which shear lowers by about 5 % at L = 8 d."""
    sag, frequency = hung((5, 33, 5), (0.25, 2.0, 0.25))
    assert sag == pytest.approx(500 * 9.81 * 2.0**2 / (2 * 2000), rel=0.02)
    euler = 1.8751**2 / (2 * np.pi) * np.sqrt(2000 * 0.25**2 / 12 / 500) / 2.0**2
    assert frequency == pytest.approx(euler, rel=0.06)


@pytest.mark.parametrize("springs", [("structural", "shear"), ("structural", "shear", "bend")])
@pytest.mark.parametrize("size", [(1.0, 1.0, 1.0), (1.0, 1.15, 0.95)])
def test_any_uniform_strain_takes_the_energy_of_an_isotropic_solid(size, springs):
    """½ (λ tr² + 2μ ε:ε) per volume with λ = μ = 2E/5, exactly, with few points and many."""
    strain = np.random.default_rng(2).normal(size=(3, 3))
    strain = strain + strain.T
    for points in ((2, 2, 2), (3, 4, 5)):
        scaled = tuple(s * (p - 1) / 4 for s, p in zip(size, points, strict=True))
        body = built(Box(points=points, size=scaled, springs=springs, **STUFF))
        u = (body.rest @ strain).ravel()
        mu, volume = 0.4 * 2000, np.prod(scaled)
        expected = 0.5 * volume * mu * (np.trace(strain) ** 2 + 2 * np.sum(strain**2))
        assert 0.5 * u @ stiffness_matrix(body) @ u == pytest.approx(expected, rel=1e-9)


def test_a_ring_has_the_stiffness_of_its_material_cell_by_cell():
    """Stretched by a strain ε along its axis, as a bar would be, it takes ½ E ε² V if it may grow thinner."""
    ring = Ring(points=(48, 5), radius=0.5, thickness=0.25, **STUFF)
    body = built(ring)
    strain = np.diag([-0.25, -0.25, 1.0]) * 1e-4  # its Poisson ratio is 1/4
    d = body.rest[body.springs[:, 1]] - body.rest[body.springs[:, 0]]
    n = d / body.rest_length[:, None]
    stretch = np.einsum("si,ij,sj->s", n, strain, d)
    volume = 2.0 * np.pi * 0.5 * 0.25**2
    assert body.mass.sum() == pytest.approx(STUFF["density"] * volume, rel=0.01)
    energy = 0.5 * np.sum(body.stiffness * stretch**2)
    assert energy == pytest.approx(0.5 * STUFF["young"] * 1e-8 * volume, rel=0.03)  # cells are wedges


def test_mass_follows_volume():
    body = built(Box(points=(4, 5, 6), size=(1.0, 2.0, 3.0), density=500.0))
    assert body.mass.sum() == pytest.approx(3000.0)
    assert np.unique(np.round(body.mass / body.mass.min())) == pytest.approx([1, 2, 4, 8])
    ball = built(Ball(resolution=8, radius=0.5, density=500.0))
    assert ball.mass.sum() == pytest.approx(500 * 4 / 3 * np.pi / 8, rel=0.02)


def test_damping_is_proportional_and_regions_still_change_it():
    body = built(
        Box(points=(4, 4, 4), damping_ratio=0.1, region=[Region(max=(1, 0.5, 1), stiffness_factor=3.0)], **STUFF)
    )
    plain = built(Box(points=(4, 4, 4), damping_ratio=0.1, **STUFF))
    assert plain.damping / plain.stiffness == pytest.approx(2 * 0.1 / (np.pi * np.sqrt(2000 / 500)))
    assert set(np.round(body.stiffness / plain.stiffness, 9)) == {1.0, 3.0}


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Box(young=0.0), "young: expected a finite number greater than 0, got 0"),
        (lambda: Box(density=-1), "density: expected a finite number greater than 0"),
        (lambda: Box(damping_ratio=-0.1), "damping_ratio: expected a finite number of at least 0"),
        (lambda: built(Box(damping_ratio=0.1)), "damping_ratio: expected young and density beside it"),
        (lambda: built(Box(young=1.0, springs=("structural",))), "young: expected structural and shear springs"),
        (lambda: built(Box(young=1.0, size=(1, 3, 1))), "young: expected points about as far apart along every axis"),
        (lambda: built(Ring(young=1.0)), "young: expected points about as far apart along every axis, at most 1.25"),
        (lambda: built(Sheet(young=1.0)), "young: expected a solid with cells"),
        (lambda: built(Rope(density=1.0)), "density: expected a solid with cells"),
    ],
)
def test_mistakes_name_the_key(make, words):
    with pytest.raises(SceneError) as caught:
        make()
    assert str(caught.value).startswith(words)
