"""Backward Euler steps of a stiff cube that lands, in NumPy, and ways to solve them: outer ones, which find the step,
and inner ones, which approximate the inverse of the constant matrix A = M/c² + L for them."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from taichi_jello.assembly import assembled
from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.physics.solve.inner import fitting_grid
from taichi_jello.scene import Contact, Scene
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies._report import INSTALL, Lacking

STEP = 1.0 / 60.0  # s
STIFFNESS, POINTS = 1e5, 8  # N/m of 8³ points; more points are as stiff as a whole
PAIRS = 5  # that L-BFGS remembers
GROUND, GRAVITY = 2000.0, 9.81  # N/m of a touching point, m/s²

Array = np.ndarray
Inner = Callable[[Array], Array]


def sparse() -> Any:
    try:
        import scipy.sparse
        import scipy.sparse.linalg
    except ImportError:
        raise Lacking(f"needs scipy: {INSTALL}") from None
    return scipy.sparse


class Landing:
    """One step after the other of x = z + c v, v = w + c M⁻¹ f for a cube that is thrown at ground without friction or
    dashpots. Counts the passes over its springs."""

    def __init__(self, points: int):
        stiffness = STIFFNESS * (POINTS - 1) / (points - 1)
        cube = Box(
            points=(points, points, points),
            stiffness=stiffness,
            position=(0.0, 0.75, 0.0),
            rotation=(10.0, 20.0, 5.0),
            velocity=(0.0, -5.0, 0.0),
        )
        touch = Contact(stiffness=GROUND, damping=0.0, friction=0.0)
        self.scene = Scene(jello=[cube], collider=[Plane()], contact=touch, gravity=(0.0, -GRAVITY, 0.0))
        self.body = body = assembled(self.scene)
        self.m, self.x, self.v = body.mass[:, None], body.x.copy(), body.v.copy()
        self.i, self.j = body.springs.T
        count = len(body.springs)
        ends, signs = np.concatenate([self.i, self.j]), np.repeat([1.0, -1.0], count)
        self.gather = sparse().csr_matrix((signs, (ends, np.tile(np.arange(count), 2))), (len(body), count))
        ties = sparse().diags(body.stiffness + body.damping / STEP)
        self.A = (sparse().diags(body.mass / STEP**2) + self.gather @ ties @ self.gather.T).tocsc()
        self.passes = 0

    def residual(self, x: Array) -> Array:
        """m (w - v)/c + f(x, v), (N, 3) [N]; what of it the springs are is kept."""
        self.passes += 1
        body, v = self.body, (x - self.x) / STEP
        d, apart = x[self.j] - x[self.i], v[self.j] - v[self.i]
        length = np.sqrt(np.einsum("sk,sk->s", d, d))
        pull = body.stiffness * (1.0 - body.rest_length / length)
        pull += body.damping * np.einsum("sk,sk->s", apart, d) / length**2
        self.elastic = self.gather @ (pull[:, None] * d)
        r = self.elastic + self.m * (self.v - v) / STEP
        r[:, 1] += GROUND * np.maximum(0.0, -x[:, 1]) - GRAVITY * self.m[:, 0]
        return r

    def own(self, x: Array) -> Array:
        """(N, 3) the diagonal of the blocks B: mass and contact."""
        B = np.repeat(self.m / STEP**2, 3, 1)
        B[:, 1] += np.where(x[:, 1] < 0.0, GROUND, 0.0)
        return B

    def stiffness(self, x: Array) -> tuple[Array, Array, Array]:
        """Across and along of every spring and its direction: H = across (I - nnᵀ) + along nnᵀ, made positive."""
        d = x[self.j] - x[self.i]
        length = np.sqrt(np.einsum("sk,sk->s", d, d))
        across = np.maximum(0.0, self.body.stiffness * (1.0 - self.body.rest_length / length))
        return across, self.body.stiffness + self.body.damping / STEP, d / length[:, None]

    def product(self, x: Array, B: Array) -> Inner:
        """p -> H p, H made positive as in the program."""
        across, along, n = self.stiffness(x)

        def times(p: Array) -> Array:
            self.passes += 1
            u = p[self.i] - p[self.j]
            return B * p + self.gather @ (
                across[:, None] * u + ((along - across) * np.einsum("sk,sk->s", n, u))[:, None] * n
            )

        return times

    def blocks(self, x: Array, B: Array) -> Inner:
        """r -> D⁻¹ r, D the 3×3 blocks on H's diagonal: the plain preconditioner."""
        across, along, n = self.stiffness(x)
        D = B[:, :, None] * np.eye(3)
        of_springs = across[:, None, None] * np.eye(3) + (along - across)[:, None, None] * n[:, :, None] * n[:, None]
        D += (abs(self.gather) @ of_springs.reshape(-1, 9)).reshape(-1, 3, 3)
        inverse = np.linalg.inv(D)
        return lambda r: np.einsum("nij,nj->ni", inverse, r)


# Ways to approximate A⁻¹: from a landing to a function of r, and the numbers that it keeps.


def diagonal(problem: Landing) -> tuple[Inner, int]:
    D = problem.A.diagonal()[:, None]
    return (lambda r: r / D), D.size


def whole_inverse(problem: Landing) -> tuple[Inner, int]:
    inverse = np.linalg.inv(problem.A.toarray())
    return (lambda r: inverse @ r), inverse.size


def factors(problem: Landing) -> tuple[Inner, int]:
    """SuperLU's, for SciPy has no Cholesky factors; these would be half as many numbers."""
    lu = sparse().linalg.splu(problem.A, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0)
    return lu.solve, lu.L.nnz + lu.U.nnz


def coarse(problem: Landing) -> tuple[Any, Array]:
    nodes, weights, count = fitting_grid(problem.body)
    particle = np.repeat(np.arange(len(nodes)), 8)
    P = sparse().csr_matrix((weights.ravel(), (particle, nodes.ravel())), (len(nodes), count))
    return P, np.linalg.inv((P.T @ problem.A @ P).toarray())


def two_levels_added(problem: Landing) -> tuple[Inner, int]:
    """What the program does, and adds the modes too."""
    D, (P, inverse) = problem.A.diagonal()[:, None], coarse(problem)
    return (lambda r: r / D + P @ (inverse @ (P.T @ r))), inverse.size + P.nnz + D.size


def two_levels_in_turn(problem: Landing) -> tuple[Inner, int]:
    """A V-cycle: relaxed, corrected from the coarse grid, relaxed again."""
    A, D, (P, inverse) = problem.A.tocsr(), problem.A.diagonal()[:, None], coarse(problem)
    relaxed = 0.6 / D  # A's largest eigenvalue over its diagonal is below 2

    def cycle(r: Array) -> Array:
        s = relaxed * r
        s = s + P @ (inverse @ (P.T @ (r - A @ s)))
        return s + relaxed * (r - A @ s)

    return cycle, inverse.size + P.nnz + D.size + A.nnz


INNER = {
    "diagonal": diagonal,
    "inverse": whole_inverse,
    "sparse factors": factors,
    "two levels added": two_levels_added,
    "two levels in turn": two_levels_in_turn,
}


def modes(x: Array, m: Array) -> tuple[Array, Array]:
    """The centre and the six motions as a whole, (6, N, 3)."""
    center = (m * x).sum(0) / m.sum()
    unit = np.eye(3)
    return center, np.array([e + 0.0 * x for e in unit] + [np.cross(e, x - center) for e in unit])


def with_modes(inner: Inner, x: Array, m: Array, B: Array) -> Inner:
    """s = Q r + (I - QB) A⁻¹ (I - BQ) r, see physics/solve/rigid.py: L-BFGS goes too far with the sum of the two."""
    _, Z = modes(x, m)
    BZ = B * Z
    inverse = np.linalg.inv(np.einsum("and,bnd->ab", Z, BZ))

    def solve(r: Array) -> Array:
        q = inverse @ np.einsum("and,nd->a", Z, r)
        s = inner(r - np.einsum("a,and->nd", q, BZ))
        q = q - inverse @ np.einsum("and,nd->a", BZ, s)
        return s + np.einsum("a,and->nd", q, Z)

    return solve


def turned(x: Array, m: Array, d: Array, part: float) -> tuple[Array, Array, Array]:
    """Where that part of the step d leads, what moves as a whole really turned; the direction there, the rotation."""
    center, Z = modes(x, m)
    q = np.linalg.solve(np.einsum("and,bnd->ab", Z, m * Z), np.einsum("and,nd->a", Z, m * d))
    e = d - np.einsum("a,and->nd", q, Z)
    tau, omega = q[:3], q[3:]
    angle = float(np.linalg.norm(omega)) or 1.0
    W = np.cross(omega / angle, np.eye(3)).T  # W u = ω × u / |ω|
    R = np.eye(3) + np.sin(part * angle) * W + (1.0 - np.cos(part * angle)) * (W @ W)
    arm = (x - center + part * e) @ R.T
    return center + part * tau + arm, tau + np.cross(omega, arm) + e @ R.T, R


def along(problem: Landing, x: Array, d: Array, slope: float) -> tuple[Array, Array, Array, Array, bool]:
    """A step along d, shortened while it goes too far; the residual there, what was gone, the rotation, and whether
    that was the whole step."""
    part = 1.0
    for _ in range(8):
        there, direction, R = turned(x, problem.m, d, part)
        r = problem.residual(there)
        here = float((direction * r).sum())
        if here >= -0.5 * slope:
            break
        part *= min(0.6, max(0.1, slope / (slope - here)))
    return there, r, part * direction, R, part == 1.0


def newton(
    problem: Landing, inner: Inner | None, x: Array, forcing: float = 0.1, most: float = np.inf
) -> Iterator[Array]:
    """Newton's method with conjugate gradients, the program's; without an `inner` way, the plain one: by the blocks on
    H's diagonal. most: passes, beyond which no new product is begun."""
    r = problem.residual(x)
    while True:
        B = problem.own(x)
        H = problem.product(x, B)
        solve = with_modes(inner, x, problem.m, B) if inner else problem.blocks(x, B)
        start, d, s = r, np.zeros_like(x), solve(r)
        p, rho = s, float((r * s).sum())
        stop = forcing**2 * rho
        while rho > stop and problem.passes < most:
            q = H(p)
            alpha = rho / float((p * q).sum())
            d, r = d + alpha * p, r - alpha * q
            s = solve(r)
            rho, before = float((r * s).sum()), rho
            p = s + rho / before * p
        x, r, *_ = along(problem, x, d, float((d * start).sum()))
        yield x


def lbfgs(problem: Landing, inner: Inner, x: Array, most: float = np.inf) -> Iterator[Array]:
    """Liu, Bouaziz and Kavan 2017: L-BFGS from the constant matrix. What it remembers is of the springs alone and turns
    with the body; B is known. After a step that had to be shortened it begins anew."""
    r = problem.residual(x)
    kept: list[tuple[Array, Array]] = []
    while True:
        B = problem.own(x)
        pairs = [(s, y + B * s) for s, y in kept]
        solve = with_modes(inner, x, problem.m, B)
        q, weights = r, []
        for s, y in reversed(pairs):
            weights.append(float((s * q).sum() / (s * y).sum()))
            q = q - weights[-1] * y
        d = solve(q)
        for (s, y), weight in zip(pairs, reversed(weights), strict=True):
            d = d + s * (weight - float((y * d).sum() / (s * y).sum()))
        before = problem.elastic
        x, r, gone, R, whole = along(problem, x, d, float((d * r).sum()))
        kept = [(s @ R.T, y @ R.T) for s, y in kept] if whole else []
        y = before @ R.T - problem.elastic
        if float((gone * (y + problem.own(x) * gone)).sum()) > 0.0:
            kept = [*kept, (gone, y)][-PAIRS:]
        yield x


OUTER: dict[str, Callable[..., Iterator[Array]]] = {"newton": newton, "l-bfgs": lbfgs}
