"""Spring constants and masses that give a lattice the Young's modulus and density of a material (NumPy only).

Springs with constant k and length L along the unit vector n, w of them in a cell of volume V, make a solid with
C_ijkl = Σ w k L² n_i n_j n_k n_l / V (Born and Huang, *Dynamical Theory of Crystal Lattices*). Central forces make
C_xxyy = C_xyxy, so its Poisson ratio is 1/4 and, isotropic, C_xyxy = μ = 2E/5 and C_xxxx = 3μ. On a cubic lattice of
spacing h that gives k = 6Eh/35 for the diagonals and k_structural + 4 k_bend = 22Eh/35.

Each cell contributes a quarter of an edge spring and half of a face diagonal: a spring on a face of the body is half as
stiff as one inside, one at an edge a quarter. With whole springs a body of n points an edge would be too stiff by about
(n/(n-1))². Likewise each cell gives an eighth of its mass to each corner.
"""

from itertools import combinations

import numpy as np

from taichi_jello.scene.body import CORNERS, Body
from taichi_jello.scene.description import Jello
from taichi_jello.scene.validation import SceneError

BEND_SHARE = 0.2  # of the stiffness along an axis
BODY_DIAGONALS = 9.0 / 7.0  # of μ, in C: makes k of face and body diagonals of a cubic cell equal


def spring_constants(sides: np.ndarray, young: float) -> dict[tuple[int, ...], float]:
    """k [N/m] of an inner spring by its direction in a cell with these sides (3,) [m]: {(1, 0, 0): …, …}; those along
    the axes include the bend springs. Raises SceneError for cells too far from a cube."""
    mu, volume, square = 0.4 * young, sides.prod(), sides**2
    q = square / square.sum()
    diagonal = min(BODY_DIAGONALS * mu, 0.9 * mu / (4.0 * max(q[a] * q[b] for a, b in combinations(range(3), 2))))
    k: dict[tuple[int, ...], float] = {(1, 1, 1): diagonal * volume / square.sum()}
    along = 3.0 * mu - 4.0 * diagonal * q**2
    for a, b in combinations(range(3), 2):
        p = square[[a, b]] / (square[a] + square[b])
        face = (mu - 4.0 * diagonal * q[a] * q[b]) / (2.0 * p[0] * p[1])
        along[[a, b]] -= 2.0 * face * p**2
        k[tuple(int(axis in (a, b)) for axis in range(3))] = face * volume / (square[a] + square[b])
    if along.min() < 0.0:
        raise SceneError(
            "young",
            "expected points about as far apart along every axis, at most 1.25 times, "
            f"got {', '.join(f'{side:.3g}' for side in sides)} m",
        )
    return k | {tuple(int(axis == a) for axis in range(3)): along[a] * volume / square[a] for a in range(3)}


def stiffnesses(body: Body, young: float) -> np.ndarray:
    """(S,) [N/m] of the springs of a solid of Young's modulus `young` [Pa]."""
    if not {0, 1} <= set(body.family.tolist()):
        raise SceneError("young", "expected structural and shear springs among the jello's springs")
    kinds, kind = np.unique(_sides(body).round(9), axis=0, return_inverse=True)
    inside = [spring_constants(sides, young) for sides in kinds]
    stiffness = np.zeros(len(body.springs))
    for near, far in combinations(range(8), 2):
        step = np.abs(CORNERS[far] - CORNERS[near])
        share = np.array([each[tuple(step.tolist())] for each in inside]) * (0.25, 0.5, 1.0)[step.sum() - 1]
        np.add.at(stiffness, _find(body, body.cells[:, [near, far]]), share[kind.ravel()])
    return _with_bend(body, stiffness)


def _find(body: Body, pairs: np.ndarray) -> np.ndarray:
    """(n,) indices of the springs between pairs (n, 2) of particles."""
    keys = body.springs[:, 0].astype(np.int64) * len(body) + body.springs[:, 1]
    order = np.argsort(keys, kind="stable")
    low, high = np.sort(pairs, axis=1).astype(np.int64).T
    return order[np.searchsorted(keys, low * len(body) + high, sorter=order)]


def _with_bend(body: Body, structural: np.ndarray) -> np.ndarray:
    """Move a part of the stiffness (S,) of structural springs to the bend springs: each spans two edges in line and
    takes as much from both as the weaker one allows. An edge with fewer bend springs over it keeps more."""
    edges, bends = np.flatnonzero(body.family == 0), np.flatnonzero(body.family == 2)
    following = np.full((3, len(body)), -1)  # the next particle along each axis
    axis, start, end = _along(body, edges)
    following[axis, start] = end
    axis, start, end = _along(body, bends)
    middle = following[axis, start]
    both = np.stack([_find(body, np.stack(pair, 1)) for pair in ((start, middle), (middle, end))], 1)
    stiffness = structural.copy()
    stiffness[bends] = 0.25 * BEND_SHARE * structural[both].min(1)
    np.subtract.at(stiffness, both, 2.0 * stiffness[bends, None])
    return stiffness


def _along(body: Body, springs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) each: the axis of each spring, and its first and last particle along it."""
    i, j = body.springs[springs].T
    step = body.rest[j] - body.rest[i]
    axis = np.abs(step).argmax(1)
    forward = step[np.arange(len(axis)), axis] > 0.0
    return axis, np.where(forward, i, j), np.where(forward, j, i)


def _sides(body: Body) -> np.ndarray:
    """(C, 3) sides of the cells [m], each the mean of four edges."""
    corner = body.rest[body.cells].reshape(-1, 2, 2, 2, 3)
    edges = [np.diff(corner, axis=axis) for axis in (1, 2, 3)]
    return np.stack([np.linalg.norm(edge, axis=-1).mean((1, 2, 3)) for edge in edges], 1)


def masses(body: Body, density: float) -> np.ndarray:
    """(N,) [kg] of a solid of `density` [kg/m³], from its cells or, with an embedded skin, from the volume inside that,
    distributed in proportion to `body.mass`."""
    if len(body.skin):
        a, b, c = (body.skin_points(body.rest)[body.skin[:, k]] for k in range(3))
        volume = abs(float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum())) / 6.0
        return density * volume * body.mass / body.mass.sum()
    each = density * _sides(body).prod(1) / 8.0
    return np.bincount(body.cells.ravel(), np.repeat(each, 8), minlength=len(body))


def material(jello: Jello, body: Body) -> dict[str, np.ndarray]:
    """The arrays of `body` that young, density and damping_ratio of its jello replace.

    damping_ratio ζ is that of the slowest longitudinal mode of a free bar as long as the body, ω = (π/L) √(E/ρ), with
    dashpots proportional to the springs, c = (2ζ/ω) k. Raises SceneError naming the key."""
    given = [name for name in ("young", "density", "damping_ratio") if getattr(jello, name) is not None]
    if given and not len(body.cells):
        raise SceneError(given[0], "expected a solid with cells; this shape takes stiffness, mass and damping")
    arrays: dict[str, np.ndarray] = {}
    if jello.density is not None:
        arrays["mass"] = masses(body, jello.density)
    if jello.young is not None:
        arrays["stiffness"] = stiffnesses(body, jello.young)
    if jello.damping_ratio is not None:
        if jello.young is None or jello.density is None:
            raise SceneError("damping_ratio", "expected young and density beside it")
        length = float(np.ptp(body.rest, axis=0).max())
        omega = np.pi / length * np.sqrt(jello.young / jello.density)
        arrays["damping"] = 2.0 * jello.damping_ratio / omega * arrays["stiffness"]
    return arrays
