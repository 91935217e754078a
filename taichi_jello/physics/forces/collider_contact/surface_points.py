"""Extra contact points between particles (NumPy only).

A collider smaller than the particle spacing, or one with a thin rim, could slip between particles. For such colliders
the triangles of surfaces and the segments of ropes get a grid of extra contact points.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_jello.physics.forces.contact_law import shares
from taichi_jello.scene.body import CORNERS, Body
from taichi_jello.scene.description import Scene
from taichi_jello.shapes._skin import trilinear

SMALL = 2.0  # triangle sides: a collider thinner than this counts as small
# Of a collider's thickness: the point spacing at which a sphere's core, half as wide, cannot pass between four points.
HOLE = 0.5**1.5
MAX_PARTS = 5  # subdivisions of a side, at most
TOGETHER = 9.0  # cap on the combined contact stiffness of all points that share a particle, relative to one particle


@dataclass(frozen=True)
class SurfacePoints:
    """Each point is Σ weights · x[corners] (S, K) and has the contact stiffness of `share` (S,) particles. place (S, 3)
    determines the weights: its coordinates in its cell for K = 8, its barycentric weights in a triangle for K = 3."""

    corners: np.ndarray
    weights: np.ndarray
    share: np.ndarray
    place: np.ndarray

    def __len__(self) -> int:
        return len(self.corners)


@dataclass(frozen=True)
class Faces:
    """Triangles (T, 3) over points with rest positions (P, 3) [m]; a segment is a triangle with its second point
    repeated. jello (T,): the jello of each. length (T,) [m]: the second longest side of each, on a lattice the longest
    that is not a diagonal. side (J,) [m]: the largest such length in each jello, zero if it has no triangles."""

    rest: np.ndarray
    triangles: np.ndarray
    jello: np.ndarray
    length: np.ndarray
    side: np.ndarray

    @classmethod
    def of(cls, body: Body, rest: np.ndarray, triangles: np.ndarray, jello: np.ndarray) -> "Faces":
        corner = rest[triangles]
        length = np.sort(np.linalg.norm(corner - np.roll(corner, 1, 1), axis=2), 1)[:, 1]
        side = np.zeros(int(body.jello.max()) + 1)
        np.maximum.at(side, jello, length)
        return cls(rest, triangles, jello, length, side)

    @classmethod
    def bare(cls, body: Body) -> "Faces":
        """The faces between particles: surfaces without an embedded skin, and ropes."""
        faces = body.bare_surface
        faces = faces[np.unique(np.sort(faces, 1), axis=0, return_index=True)[1]]  # one of a sheet's two sides
        threads = body.springs[(body.family == 0) & np.isin(body.jello[body.springs[:, 0]], body.ropes)]
        triangles = np.concatenate([faces, np.repeat(threads, [1, 2], axis=1)])
        return cls.of(body, body.rest, triangles, body.jello[triangles[:, 0]])

    @classmethod
    def skins(cls, body: Body) -> "Faces":
        """The faces between the points of embedded skins."""
        return cls.of(body, body.skin_points(body.rest), body.skin, body.jello[body.skin_corners[body.skin[:, 0], 0]])

    def parts(self, collider: Sequence[Any]) -> np.ndarray:
        """(J, C): into how many parts each collider requires the sides of each jello to be cut; 1 if it is not
        small."""
        thickness = np.array([each.thickness for each in collider])
        wanted = np.ceil(self.side[:, None] / (HOLE * thickness) - 1e-6)
        return np.where(thickness < SMALL * self.side[:, None], wanted, 1.0).astype(int)

    def least_thickness(self) -> np.ndarray:
        """(J,) [m]: the least thickness of a collider that cannot slip between the points of the finest grid."""
        return self.side / (HOLE * MAX_PARTS)

    def grid(self, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The points of a regular grid with the sides cut into `parts` (T,): the triangle (S,) of each and its weights
        (S, 3) there. Shared points appear once; corners are left out."""
        of, weights, keys = [np.zeros(0, int)], [np.zeros((0, 3))], [np.zeros((0, 6), int)]
        thread = self.triangles[:, 1] == self.triangles[:, 2]
        for m in np.unique(parts[parts > 1]):
            steps = np.array([(m - j - k, j, k) for j in range(m + 1) for k in range(m + 1 - j)])
            steps = steps[steps.max(1) < m]
            for which, some in ((~thread, steps), (thread, steps[steps[:, 2] == 0])):
                triangles = np.flatnonzero(which & (parts == m))
                of.append(np.repeat(triangles, len(some)))
                step = np.tile(some, (len(triangles), 1))
                weights.append(step / m)
                who = np.where(step > 0, self.triangles[of[-1]], -1)
                order = np.argsort(who, axis=1)  # neighbours share the points on their sides
                keys.append(np.hstack([np.take_along_axis(a, order, 1) for a in (who, step)]))
        first = np.sort(np.unique(np.concatenate(keys), axis=0, return_index=True)[1])
        return np.concatenate(of)[first], np.concatenate(weights)[first]


def row_sums(mass: np.ndarray, corners: np.ndarray, weights: np.ndarray, share: np.ndarray) -> np.ndarray:
    """(N,): the row sums [1/kg] of M^-½ Wᵀ S W M^-½ for unit springs at the points Σ weight · x[corner], with weights
    W (S, K) and shares S (S,)."""
    root = 1.0 / np.sqrt(mass)
    row = share[:, None] * weights * (weights * root[corners]).sum(1, keepdims=True)
    sums: np.ndarray = root * np.bincount(corners.ravel(), row.ravel(), len(mass))
    return sums


def steepest(mass: np.ndarray, corners: np.ndarray, weights: np.ndarray, share: np.ndarray) -> float:
    """A bound on the eigenvalues of that matrix [1/kg]: it has no negative entry, so none exceeds the largest row
    sum."""
    return float(row_sums(mass, corners, weights, share).max())


def of_skin(body: Body) -> SurfacePoints:
    """The points of embedded skins, each in its cell."""
    return SurfacePoints(body.skin_corners, body.skin_weights, shares(body), body.skin_weights @ CORNERS)


def between_particles(body: Body, faces: Faces, parts: np.ndarray) -> SurfacePoints:
    """The grid points on faces between particles."""
    triangle, weights = faces.grid(parts)
    share = np.minimum(1.0, TOGETHER / parts[triangle] ** 2.0)
    return SurfacePoints(faces.triangles[triangle].astype(np.int32), weights, share, weights)


def between_skin_points(body: Body, faces: Faces, parts: np.ndarray) -> SurfacePoints:
    """The grid points on embedded skins. Each is embedded in the cell of one of its triangle's corners: the one that
    contains it, or that it lies least outside of."""
    triangle, weights = faces.grid(parts)
    cells = body.skin_corners[faces.triangles[triangle]]  # (S, 3, 8)
    low, size = body.rest[cells[..., 0]], body.rest[cells[..., 7]] - body.rest[cells[..., 0]]
    place = (np.einsum("sk,skd->sd", weights, faces.rest[faces.triangles[triangle]])[:, None] - low) / size
    inside = np.clip(place, 0.0, 1.0)
    best = np.arange(len(cells)), np.abs(place - inside).sum(2).argmin(1)
    apart = faces.length[triangle] / parts[triangle]
    share = np.minimum(1.0, TOGETHER * apart**2 / np.prod(size[best], 1) ** (2.0 / 3.0))
    corners, found = cells[best], trilinear(inside[best])
    most = TOGETHER * steepest(body.mass, body.skin_corners, body.skin_weights, shares(body))
    sums = np.maximum(row_sums(body.mass, corners, found, share), most)[corners]  # softer on light particles
    share = share * np.where(found > 0.0, most / sums, 1.0).min(1, initial=1.0)
    return SurfacePoints(corners, found, share, inside[best])


def any_finite(collider: Sequence[Any]) -> bool:
    """Whether any collider may be small: a plane and a room never are."""
    return any(np.isfinite(each.thickness) for each in collider)


def parts_wanted(scene: Scene, faces: Faces) -> tuple[np.ndarray, list[Any]]:
    """(T,): into how many parts to cut the sides of each triangle; and the colliders that are small for some jello.
    Triangles that are already small compared to these are not cut."""
    parts = faces.parts(scene.collider)
    small = [each for each, most in zip(scene.collider, parts.max(0), strict=True) if most > 1]
    least = min((each.thickness for each in small), default=np.inf)
    of_jello = np.minimum(parts.max(1, initial=1), MAX_PARTS)
    return np.where(faces.length > HOLE * least, of_jello[faces.jello], 1), small
