"""Ways to solve backward Euler steps of a stiff cube that lands, in NumPy beside each other: passes over the springs
and time until a step is as near to the converged one as asked for. What wins here is worth writing for a processor."""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.assembly import assembled
from taichi_jello.physics.solve.inner import fitting_grid
from taichi_jello.scene import Scene
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies._report import INSTALL, Lacking, headline, machine, new_figure, save_figure, table, take

STEP = 1.0 / 60.0  # s
STIFFNESS, POINTS = 1e5, 8  # N/m of 8³ points; more points are as stiff as a whole
SIZES = {False: (8, 16, 32), True: (7,)}  # by --quick
FRAMES = {False: (2, 3), True: (2,)}  # which are measured, of a fall that touches the ground in the second
GOALS = (0.1, 0.01, 0.001)  # of the distance from the first guess to the converged step
CONVERGED = 1e-6  # of the first Newton step
MOST = 300  # passes
LARGEST = {"inverse": 4100, "sparse factors": 4100}  # particles; beyond, 8.6 GB and minutes at 32³
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
        self.body = body = assembled(Scene(jello=[cube]))
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

    def product(self, x: Array, B: Array) -> Inner:
        """p -> H p, H made positive as in the program."""
        d = x[self.j] - x[self.i]
        length = np.sqrt(np.einsum("sk,sk->s", d, d))
        across = np.maximum(0.0, self.body.stiffness * (1.0 - self.body.rest_length / length))
        along = self.body.stiffness + self.body.damping / STEP - across
        n = d / length[:, None]

        def times(p: Array) -> Array:
            self.passes += 1
            u = p[self.i] - p[self.j]
            return B * p + self.gather @ (across[:, None] * u + (along * np.einsum("sk,sk->s", n, u))[:, None] * n)

        return times


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


def newton(problem: Landing, inner: Inner, x: Array, forcing: float = 0.1) -> Iterator[Array]:
    """Newton's method with conjugate gradients, the program's."""
    r = problem.residual(x)
    while True:
        B = problem.own(x)
        H, solve = problem.product(x, B), with_modes(inner, x, problem.m, B)
        start, d, s = r, np.zeros_like(x), solve(r)
        p, rho = s, float((r * s).sum())
        stop = forcing**2 * rho
        while rho > stop and problem.passes < MOST:
            q = H(p)
            alpha = rho / float((p * q).sum())
            d, r = d + alpha * p, r - alpha * q
            s = solve(r)
            rho, before = float((r * s).sum()), rho
            p = s + rho / before * p
        x, r, *_ = along(problem, x, d, float((d * start).sum()))
        yield x


def lbfgs(problem: Landing, inner: Inner, x: Array) -> Iterator[Array]:
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


@dataclass
class Way:
    """One way, and what it took in all frames until each of GOALS; infinity: it never came there."""

    outer: str
    inner: str
    apply: Inner
    prepared: float
    numbers: int
    passes: Array = field(default_factory=lambda: np.zeros(len(GOALS)))
    seconds: Array = field(default_factory=lambda: np.zeros(len(GOALS)))

    def solve(self, problem: Landing, guess: Array, converged: Array) -> None:
        first, spent, reached = rms(guess - converged), 0.0, 0
        problem.passes = 0
        steps = OUTER[self.outer](problem, self.apply, guess)
        while reached < len(GOALS) and problem.passes < MOST:
            began = time.perf_counter()
            x = next(steps)
            spent += time.perf_counter() - began
            while reached < len(GOALS) and rms(x - converged) <= GOALS[reached] * first:
                self.passes[reached] += problem.passes
                self.seconds[reached] += spent
                reached += 1
        self.passes[reached:] = self.seconds[reached:] = np.inf


def rms(d: Array) -> float:
    return float(np.sqrt(np.mean(np.einsum("nk,nk->n", d, d))))


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """A row for each size, outer and inner way."""
    told: dict[str, Any] = machine() | {"rows": [], "frames": FRAMES[chosen.quick]}
    take(chosen, told, pieces(chosen.quick, told), "solvers", len(SIZES[chosen.quick]))
    return told


def pieces(quick: bool, told: dict[str, Any]) -> Iterator[None]:
    for points in SIZES[quick]:
        told["rows"] += compared(points, FRAMES[quick])
        yield


def compared(points: int, frames: tuple[int, ...]) -> list[dict[str, Any]]:
    problem, ways = Landing(points), []
    for name, make in INNER.items():
        if len(problem.body) <= LARGEST.get(name, np.inf):
            began = time.perf_counter()
            apply, numbers = make(problem)
            took = time.perf_counter() - began
            ways += [Way(outer, name, apply, took, numbers) for outer in OUTER]
    best = two_levels_added(problem)[0]
    for frame in range(max(frames) + 1):
        guess, _, _ = turned(problem.x, problem.m, STEP * problem.v, 1.0)
        problem.passes, last, moved, first = -(10**9), guess, 1.0, None  # the reference may take what it needs
        for x in newton(problem, best, guess, forcing=1e-2):
            last, moved = x, rms(x - last)
            first = first or moved
            if moved <= CONVERGED * first:
                break
        if frame in frames:
            for way in ways:
                way.solve(problem, guess, last)
        problem.v, problem.x = (last - problem.x) / STEP, last
    return [row(points, len(frames), way) for way in ways]


def row(points: int, frames: int, way: Way) -> dict[str, Any]:
    goals = [f"{100 * goal:g} %" for goal in GOALS]
    return {
        "points": points,
        "outer": way.outer,
        "inner": way.inner,
        "prepare": way.prepared,
        "megabytes": 8e-6 * way.numbers,
        "passes": dict(zip(goals, (way.passes / frames).tolist(), strict=True)),
        "ms": dict(zip(goals, (1e3 * way.seconds / frames).tolist(), strict=True)),
    }


def rows(told: dict[str, Any]) -> list[dict[str, Any]]:
    return list(told["rows"])


def text(told: dict[str, Any]) -> str:
    goals = [f"{100 * goal:g} %" for goal in GOALS]
    heads = ("points", "outer", "inner", "prepare s", "MB", *[f"passes to {goal}" for goal in goals], "ms to 1 %")
    lines = [
        (f"{r['points']}³", r["outer"], r["inner"], r["prepare"], r["megabytes"], *r["passes"].values(), r["ms"]["1 %"])
        for r in told["rows"]
    ]
    said = [headline(told), table(heads, lines)]
    for points in dict.fromkeys(r["points"] for r in told["rows"]):
        here = [r for r in told["rows"] if r["points"] == points]
        best = {outer: min((r["ms"]["1 %"], r["inner"]) for r in here if r["outer"] == outer) for outer in OUTER}
        told_best = ", ".join(f"{outer} with {inner} {ms:.3g} ms" for outer, (ms, inner) in best.items())
        said.append(f"{points}³, quickest to 1 %: {told_best}")
    return "\n".join([*said, *(["interrupted"] if told["interrupted"] else [])])


def plot(told: dict[str, Any], path: Path) -> None:
    """Time to 1 % over the number of points, a line for each way."""
    figure = new_figure(7.0, 4.5)
    axes = figure.add_subplot()
    for number, (outer, inner) in enumerate((o, i) for o in OUTER for i in INNER):
        own = [r for r in told["rows"] if (r["outer"], r["inner"]) == (outer, inner)]
        axes.loglog(
            [r["points"] ** 3 for r in own],
            [r["ms"]["1 %"] for r in own],
            marker="o",
            linestyle="-" if outer == "newton" else "--",
            color=f"C{number % len(INNER)}",
            label=f"{outer}, {inner}",
        )
    axes.set_xlabel("particles")
    axes.set_ylabel("ms until 1 % of the converged step")
    axes.legend(fontsize=7)
    axes.grid(alpha=0.3)
    save_figure(figure, path)
