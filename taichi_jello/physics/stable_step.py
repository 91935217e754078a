"""How large a step may be: Λ and Γ of a scene, and the limit of a method on a damped oscillator (NumPy only)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichi_jello.physics.forces._base import AddedMass, Rates

Amplification = Callable[[np.ndarray, np.ndarray], np.ndarray]


def largest_eigenvalue(springs: np.ndarray, weight: np.ndarray, inverse_mass: np.ndarray) -> float:
    """An upper bound, tight to about 1 %, of the largest eigenvalue of M^-½ L M^-½, where L is the graph Laplacian
    of the (S, 2) springs with the given weights [N/m or N·s/m]. Lanczos iteration, capped by Gershgorin's bound."""
    n = len(inverse_mass)
    if len(springs) == 0:
        return 0.0
    i, j = springs.T
    scale = np.sqrt(inverse_mass)
    degree = np.bincount(i, weight, n) + np.bincount(j, weight, n)

    def neighbours(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.bincount(i, weight * u[j], n), np.bincount(j, weight * u[i], n)

    def apply(u: np.ndarray) -> np.ndarray:
        u = scale * u
        ahead, behind = neighbours(u)
        return scale * (degree * u - ahead - behind)

    gershgorin = float(np.max(scale * (degree * scale + sum(neighbours(scale)))))
    return min(gershgorin, lanczos(apply, n))


def lanczos(apply: Callable[[np.ndarray], np.ndarray], n: int, steps: int = 80, tolerance: float = 1e-4) -> float:
    """The largest eigenvalue of a symmetric operator, at most 0.5 % too large. It stops when that grows by less
    than the tolerance."""
    q = np.random.default_rng(0).standard_normal(n)
    q /= np.linalg.norm(q)
    before, beta = np.zeros(n), 0.0
    alphas: list[float] = []
    betas: list[float] = []
    largest = 0.0
    for step in range(min(steps, n)):
        r = apply(q) - beta * before
        alphas.append(float(q @ r))
        r -= alphas[-1] * q
        beta = float(np.linalg.norm(r))
        exhausted = beta <= 1e-12 * abs(alphas[0])
        if step % 5 == 4 or step == min(steps, n) - 1 or exhausted:
            previous = largest
            largest = float(np.linalg.eigvalsh(np.diag(alphas) + np.diag(betas, 1) + np.diag(betas, -1))[-1])
            if largest - previous < tolerance * largest or exhausted:
                break
        before, q = q, r / beta
        betas.append(beta)
    return 1.005 * largest


def spectral_radius(matrices: np.ndarray) -> np.ndarray:
    """The largest |eigenvalue| of each (…, 2, 2) matrix, from trace and determinant."""
    half = 0.5 * (matrices[..., 0, 0] + matrices[..., 1, 1])
    det = matrices[..., 0, 0] * matrices[..., 1, 1] - matrices[..., 0, 1] * matrices[..., 1, 0]
    root = half**2 - det
    return np.where(root < 0.0, np.sqrt(np.abs(det)), np.abs(half) + np.sqrt(np.maximum(root, 0.0)))


def stable_limit(amplification: Amplification, zeta: np.ndarray) -> np.ndarray:
    """The largest a = ωh for which every smaller step keeps x'' = -ω²x - 2ζωx' bounded, for each damping ratio.

    amplification(a, ζ) gives the (…, 2, 2) matrices of one step of length a at ω = 1. Growth below 1e-9 a step
    counts as bounded; zero where even a = 1e-4 grows faster, infinity where no step on the ladder grows.
    """
    zeta = np.atleast_1d(np.asarray(zeta, float))

    def unstable(a: np.ndarray) -> np.ndarray:
        return spectral_radius(amplification(a, np.broadcast_to(zeta[:, None], a.shape))) > 1.0 + 1e-9

    # Scan from small to large, in steps relative to the scale 1/(1 + 2ζ) on which every limit lies, then bisect.
    ladder = np.linspace(0.02, 9.0, 450) / (1.0 + 2.0 * zeta[:, None])
    bad = unstable(ladder)
    first, rows = np.where(bad.any(1), bad.argmax(1), -1), np.arange(len(zeta))
    high = ladder[rows, first]
    low = np.where(first == 0, 0.0, ladder[rows, first - 1])
    for _ in range(30):
        middle = 0.5 * (low + high)
        worse = unstable(np.maximum(middle, 1e-12)[:, None])[:, 0]
        low, high = np.where(worse, low, middle), np.where(worse, middle, high)
    limit = np.where(low < 1e-4 / (1.0 + 2.0 * zeta), 0.0, low)
    return np.where(bad.any(1), limit, np.inf)


@dataclass(frozen=True)
class Bound:
    """The step a scene allows: stiffness Λ [1/s²], damping Γ [1/s] and the safety factor; dt [s] is infinite for a
    scene in which nothing oscillates, zero if no step is stable. damping_time [s]: every motion of frequency ω is
    damped by at least damping_time·ω². wild_dt [s]: the automatic step while a jello is wild (see heat.py)."""

    squared_frequency: float
    damping: float
    safety: float
    dt: float
    damping_time: float = np.inf
    wild_dt: float = np.inf


def with_added_mass(rate: float, added: list[tuple[float, AddedMass]]) -> float:
    """A bound K ≤ rate·M₀ after adding springs k on particles of mass m with a mass M of their own: (K + k)/(M₀ + M) is
    at most the larger of K/M₀ and k/M, and also at most K/M₀ + k/(m + M)."""
    for k, own in added:
        apart = k / own.mass if own.mass > 0.0 else np.inf
        rate = min(rate + k / (own.least + own.mass), max(rate, apart))
    return rate


def largest_dt(amplification: Amplification, safety: float, rates: list[Rates], drag: float) -> Bound:
    """The step below which every motion that the rates allow stays bounded: all frequencies ω up to √Λ, each with
    any damping from damping_time·ω² + drag up to Γ."""
    added = [r.added_mass for r in rates if r.added_mass]
    squared = with_added_mass(sum(r.squared_frequency for r in rates), [(own.stiffness, own) for own in added])
    damping = with_added_mass(sum(r.damping for r in rates), [(own.damping, own) for own in added])
    damping_time = min((r.damping_time for r in rates), default=np.inf)
    dt = np.inf
    if squared > 0.0:
        omega = np.sqrt(squared) * np.logspace(-3.0, 0.0, 13)[:, None]
        least = np.minimum(damping_time * omega**2 + drag, max(damping, 0.0))
        gamma = least + (damping - least) * np.linspace(0.0, 1.0, 9) ** 2
    elif damping > 0.0:
        omega, gamma = np.array([1e-3 * damping]), np.array([damping])
    if squared > 0.0 or damping > 0.0:
        omega, gamma = np.broadcast_to(omega, gamma.shape).ravel(), gamma.ravel()
        dt = float(np.min(stable_limit(amplification, gamma / (2.0 * omega)) / omega))
    return Bound(squared, damping, safety, safety * dt, damping_time)
