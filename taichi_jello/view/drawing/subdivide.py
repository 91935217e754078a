"""Subdivision of a coarse surface into finer triangles, with smooth normals and bevelled edges."""

from dataclasses import dataclass

import numpy as np

SMOOTH = np.cos(np.radians(50.0))  # faces that meet at a sharper angle at rest belong to different patches
FINE_TRIANGLES = 5000  # aimed at; more cost more than they show
MAX_CUTS = 3  # pieces of a coarse edge


@dataclass(frozen=True)
class FineMesh:
    """A fine vertex is the mean of the particles parent (V, 3) with the weights share (V, 3); index (F, 3).
    The normal of fine vertex i is the sum of weight[k] times the normal of corner item[k], for k from start[i] up to
    start[i + 1]. Corner c is the (c % 3)-th of coarse face c // 3; its normal is that of the faces corner_face[k], for
    k from corner_start[c] up to corner_start[c + 1], which are smooth neighbours."""

    parent: np.ndarray
    share: np.ndarray
    index: np.ndarray
    start: np.ndarray
    item: np.ndarray
    weight: np.ndarray
    corner_start: np.ndarray
    corner_face: np.ndarray


def _starts(owner: np.ndarray, count: int) -> np.ndarray:
    """(count + 1,) where each owner's items begin in a list sorted by owner."""
    return np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=count))]).astype(np.int32)


def _normals(rest: np.ndarray, surface: np.ndarray) -> np.ndarray:
    a, b, c = (rest[surface[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    return n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-30)


def smooth_patches(rest: np.ndarray, surface: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Starts (3T + 1,) and faces (K,): for each face corner, the faces around it that meet its face smoothly."""
    normal = _normals(rest, surface)
    particle = surface.ravel()
    by_particle = np.argsort(particle, kind="stable")
    first = _starts(particle, len(rest))
    count = np.diff(first)[particle]
    corner = np.repeat(np.arange(len(particle)), count)
    within = np.arange(len(corner)) - np.repeat(np.cumsum(count) - count, count)
    face = by_particle[first[particle[corner]] + within] // 3
    near = np.einsum("ij,ij->i", normal[face], normal[corner // 3]) > SMOOTH
    return _starts(corner[near], len(particle)), face[near].astype(np.int32)


def _pattern(n: int) -> tuple[np.ndarray, np.ndarray]:
    """One triangle with each side cut into n: (P, 3) integer weights that sum to n, and (n², 3) triangles."""
    number: dict[tuple[int, int], int] = {}
    for i in range(n + 1):
        for j in range(n + 1 - i):
            number[i, j] = len(number)
    up = [(number[i, j], number[i + 1, j], number[i, j + 1]) for i, j in number if i + j < n]
    down = [(number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]) for i, j in number if i + j < n - 1]
    return np.array([(n - i - j, i, j) for i, j in number]), np.array(up + down)


def _weld(parent: np.ndarray, share: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(P,) the vertex of each point: equal weights share one, except on the two sides of a sheet."""
    used = np.where(share > 0, parent, -1)
    order = np.argsort(used, axis=1)
    key = np.concatenate([np.take_along_axis(a, order, 1) for a in (used, share)], 1)
    same = np.unique(key, axis=0, return_inverse=True)[1].ravel()
    total = np.stack([np.bincount(same, weights=part) for part in normal.T], 1)
    flat = np.linalg.norm(total, axis=1) < 0.3 * np.bincount(same)
    side = np.where(flat[same], normal @ np.array([0.5, 0.8, 0.3]) > 0.0, False)
    return np.unique(2 * same + side, return_inverse=True)[1].ravel()


def subdivide(rest: np.ndarray, surface: np.ndarray) -> FineMesh:
    """Cut the triangles surface (T, 3) over particles rest (N, 3) into about FINE_TRIANGLES.
    Fine vertices stay on the coarse triangles, where the springs are. On an edge between two smooth patches they get
    the mean of both normals, so that the edge looks bevelled by one fine triangle."""
    n = int(np.clip(np.sqrt(FINE_TRIANGLES / len(surface)), 1, MAX_CUTS))
    weights, cut = _pattern(n)
    parent = np.repeat(surface, len(weights), axis=0)
    share = np.tile(weights, (len(surface), 1))
    face = np.repeat(np.arange(len(surface)), len(weights))
    vertex = _weld(parent, share, _normals(rest, surface)[face])
    index = vertex[(np.arange(len(surface)) * len(weights))[:, None, None] + cut].reshape(-1, 3)
    first = np.unique(vertex, return_index=True)[1]

    used = share.ravel() > 0
    owner = np.repeat(vertex, 3)[used]
    item = (3 * face[:, None] + np.arange(3)).ravel()[used]
    order = np.argsort(owner, kind="stable")
    corner_start, corner_face = smooth_patches(rest, surface)
    return FineMesh(
        parent=parent[first].astype(np.int32),
        share=(share[first] / n).astype(np.float32),
        index=index.astype(np.int32),
        start=_starts(owner, len(first)),
        item=item[order].astype(np.int32),
        weight=(share.ravel()[used][order] / n).astype(np.float32),
        corner_start=corner_start,
        corner_face=corner_face,
    )
