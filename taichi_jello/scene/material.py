"""Springs of a lattice that behaves like a material of given stiffness, whatever its resolution (NumPy only).

Springs with constant k and length L that point along n, with w of them in a cell of volume V, make a solid with
C_ijkl = Σ w k L² n_i n_j n_k n_l / V (Born and Huang, *Dynamical Theory of Crystal Lattices*). Central forces make
C_xxyy = C_xyxy, so its Poisson ratio is 1/4 and, isotropic, C_xyxy = μ = 2E/5 and C_xxxx = 3μ. On a cubic lattice of
spacing h that gives k = 6Eh/35 for the diagonals and k_structural + 4 k_bend = 22Eh/35.

Every cell brings its own share of its springs, a quarter of an edge and half of a face's diagonal: a spring on a face
of the body is half as stiff as one inside, one at an edge a quarter. With whole ones a body of n points an edge would
be too stiff by about (n/(n-1))². Likewise every cell gives an eighth of its mass to each of its corners.
"""

from itertools import combinations
from typing import Any

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.validation import SceneError

BEND = 0.2  # the part of the stiffness along an axis that bend springs have
BODY_DIAGONALS = 9.0 / 7.0  # of μ, in C: where face and body diagonals of a cubic cell have the same k
CORNERS = np.array([[a, b, c] for a in (0, 1) for b in (0, 1) for c in (0, 1)])


def moduli(sides: np.ndarray, young: float) -> dict[tuple[int, ...], float]:
    """k [N/m] of a spring inside along each direction of a cell with these sides (3,) [m]: {(1, 0, 0): …, …}; those
    along the axes together with bend springs. Raises SceneError for cells too far from a cube."""
    mu, volume, square = 0.4 * young, sides.prod(), sides**2
    q = square / square.sum()
    diagonal = min(BODY_DIAGONALS * mu, 0.9 * mu / (4.0 * max(q[a] * q[b] for a, b in combinations(range(3), 2))))
    made: dict[tuple[int, ...], float] = {(1, 1, 1): diagonal * volume / square.sum()}
    along = 3.0 * mu - 4.0 * diagonal * q**2
    for a, b in combinations(range(3), 2):
        p = square[[a, b]] / (square[a] + square[b])
        face = (mu - 4.0 * diagonal * q[a] * q[b]) / (2.0 * p[0] * p[1])
        along[[a, b]] -= 2.0 * face * p**2
        made[tuple(int(axis in (a, b)) for axis in range(3))] = face * volume / (square[a] + square[b])
    if along.min() < 0.0:
        raise SceneError(
            "young",
            "expected points about as far apart along every axis, at most 1.25 times, "
            f"got {', '.join(f'{side:.3g}' for side in sides)} m",
        )
    return made | {tuple(int(axis == a) for axis in range(3)): along[a] * volume / square[a] for a in range(3)}


def stiffnesses(body: Body, young: float) -> np.ndarray:
    """(S,) [N/m] of the springs of a solid of Young's modulus `young` [Pa]."""
    if not {0, 1} <= set(body.family.tolist()):
        raise SceneError("young", "expected structural and shear springs among the jello's springs")
    kinds, kind = np.unique(_sides(body).round(9), axis=0, return_inverse=True)
    inside = [moduli(sides, young) for sides in kinds]
    made = np.zeros(len(body.springs))
    for near, far in combinations(range(8), 2):
        step = np.abs(CORNERS[far] - CORNERS[near])
        share = np.array([each[tuple(step.tolist())] for each in inside]) * (0.25, 0.5, 1.0)[step.sum() - 1]
        np.add.at(made, _find(body, body.cells[:, [near, far]]), share[kind.ravel()])
    return _with_bend(body, made)


def _find(body: Body, pairs: np.ndarray) -> np.ndarray:
    """(n,) the springs between pairs (n, 2) of particles, all of which have one."""
    count = len(body)
    keys = body.springs[:, 0].astype(np.int64) * count + body.springs[:, 1]
    order = np.argsort(keys, kind="stable")
    low, high = np.sort(pairs, axis=1).astype(np.int64).T
    return order[np.searchsorted(keys, low * count + high, sorter=order)]


def _with_bend(body: Body, made: np.ndarray) -> np.ndarray:
    """Give bend springs their part of the structural ones (S,): each lies over two edges of a line and takes as much of
    both as the weaker one allows. Where an edge has one over it or none it keeps the more itself."""
    edges, bends = np.flatnonzero(body.family == 0), np.flatnonzero(body.family == 2)
    following = np.full((3, len(body)), -1)  # the next particle along each axis
    axis, start, end = _along(body, edges)
    following[axis, start] = end
    axis, start, end = _along(body, bends)
    middle = following[axis, start]
    both = np.stack([_find(body, np.stack(pair, 1)) for pair in ((start, middle), (middle, end))], 1)
    left = made.copy()
    left[bends] = 0.25 * BEND * made[both].min(1)
    np.subtract.at(left, both, 2.0 * left[bends, None])
    return left


def _along(body: Body, springs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) each: the axis that springs lie along, and the particles that they lead from and to along it."""
    i, j = body.springs[springs].T
    step = body.rest[j] - body.rest[i]
    axis = np.abs(step).argmax(1)
    forward = step[np.arange(len(axis)), axis] > 0.0
    return axis, np.where(forward, i, j), np.where(forward, j, i)


def _sides(body: Body) -> np.ndarray:
    """(C, 3) of the cells [m]: along each axis the mean of four edges."""
    corner = body.rest[body.cells].reshape(-1, 2, 2, 2, 3)
    edges = [np.diff(corner, axis=axis) for axis in (1, 2, 3)]
    return np.stack([np.linalg.norm(edge, axis=-1).mean((1, 2, 3)) for edge in edges], 1)


def masses(body: Body, density: float) -> np.ndarray:
    """(N,) [kg] of a solid of `density` [kg/m³]: what its cells hold or, with an embedded skin, what is inside that,
    divided as the shape divides its mass."""
    if len(body.skin):
        a, b, c = (body.skin_points(body.rest)[body.skin[:, k]] for k in range(3))
        volume = abs(float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum())) / 6.0
        return density * volume * body.mass / body.mass.sum()
    each = density * _sides(body).prod(1) / 8.0
    return np.bincount(body.cells.ravel(), np.repeat(each, 8), minlength=len(body))


def material(jello: Any, body: Body) -> dict[str, np.ndarray]:
    """The arrays of `body` that young, density and damping_ratio of its jello decide.

    damping_ratio ζ is that of the slowest stretching of a free bar as long as the body, ω = (π/L) √(E/ρ), from dashpots
    proportional to the springs, c = (2ζ/ω) k. Raises SceneError naming the key."""
    asked = [name for name in ("young", "density", "damping_ratio") if getattr(jello, name) is not None]
    if asked and not len(body.cells):
        raise SceneError(asked[0], "expected a solid with cells; this shape takes stiffness, mass and damping")
    made: dict[str, np.ndarray] = {}
    if jello.density is not None:
        made["mass"] = masses(body, jello.density)
    if jello.young is not None:
        made["stiffness"] = stiffnesses(body, jello.young)
    if jello.damping_ratio is not None:
        if jello.young is None or jello.density is None:
            raise SceneError("damping_ratio", "expected young and density beside it")
        length = float(np.ptp(body.rest, axis=0).max())
        omega = np.pi / length * np.sqrt(jello.young / jello.density)
        made["damping"] = 2.0 * jello.damping_ratio / omega * made["stiffness"]
    return made
