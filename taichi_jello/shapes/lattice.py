"""The workshop's jello: a regular grid of particles with structural, shear and bend springs."""

from dataclasses import dataclass
from math import prod
from typing import Any, ClassVar

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Jello
from taichi_jello.scene.region import places
from taichi_jello.scene.validation import FAMILIES, SceneError, Vector, shown, vector, whole

MAX_PARTICLES = 4_000_000

# One offset of each opposite pair, so each spring is made once (workshop, "interconnected springs").
OFFSETS = {
    "structural": [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "shear": [(1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)]
    + [(1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1)],
    "bend": [(2, 0, 0), (0, 2, 0), (0, 0, 2)],
}
QUAD = np.array([[0, 1, 3], [0, 3, 2]])


def ends(shape: tuple[int, ...], offset: tuple[int, ...]) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slices of a grid of this shape: its points with a neighbour `offset` away, and these neighbours."""
    near = tuple(slice(max(0, -o), max(0, n - max(0, o))) for o, n in zip(offset, shape, strict=True))
    far = tuple(slice(max(0, o), max(0, n - max(0, -o))) for o, n in zip(offset, shape, strict=True))
    return near, far


def connect(index: np.ndarray, offset: tuple[int, int, int], filled: np.ndarray | None = None) -> np.ndarray:
    """(S, 2) pairs of neighbours `offset` apart in the grid `index` (n, m, l).

    filled (n-1, m-1, l-1) bool: only pairs in one filled cell or, two steps apart, in two filled cells in a row.
    """
    near, far = ends(index.shape, offset)
    pairs = np.stack([index[near].ravel(), index[far].ravel()], 1).astype(np.int32)
    if filled is None:
        return pairs
    if max(map(abs, offset)) < 2:
        return pairs[_joined(filled, offset).ravel()]
    step = (offset[0] // 2, offset[1] // 2, offset[2] // 2)
    joined = _joined(filled, step)
    first, second = ends(joined.shape, step)
    return pairs[(joined[first] & joined[second]).ravel()]


def _joined(filled: np.ndarray, offset: tuple[int, int, int]) -> np.ndarray:
    """For each pair of neighbours `offset` apart, whether both are corners of one filled cell."""
    around = np.pad(filled, 1)  # cell c lies between the points c and c + 1, here at c + 1
    n = np.array(filled.shape) + 1 - np.abs(offset)
    held = np.zeros(n, bool)
    for sides in np.ndindex(*(1 if o else 2 for o in offset)):
        start = [side if o == 0 else 1 for side, o in zip(sides, offset, strict=True)]
        held |= around[tuple(slice(a, a + k) for a, k in zip(start, n, strict=True))]
    return held


def corners(filled: np.ndarray) -> np.ndarray:
    """Particle indices (n, m, l) of the corners of the filled cells, the last axis fastest; -1 elsewhere."""
    used = np.zeros(np.array(filled.shape) + 1, bool)
    for side in np.ndindex(2, 2, 2):
        used[tuple(slice(a, a + n) for a, n in zip(side, filled.shape, strict=True))] |= filled
    return np.where(used, np.cumsum(used).reshape(used.shape) - 1, -1).astype(np.int32)


def surface(index: np.ndarray) -> np.ndarray:
    """(T, 3) outward triangles on the six sides of the grid; both sides of a grid one point thick."""
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        if index.shape[u] < 2 or index.shape[v] < 2:
            continue
        for side in (0, -1):
            face = np.moveaxis(index, (axis, u, v), (0, 1, 2))[side]
            corners = np.stack([face[:-1, :-1], face[1:, :-1], face[:-1, 1:], face[1:, 1:]], -1).reshape(-1, 4)
            outward = QUAD if side == -1 else QUAD[:, ::-1]
            triangles.append(corners[:, outward].reshape(-1, 3))
    return np.concatenate(triangles).astype(np.int32) if triangles else np.zeros((0, 3), np.int32)


def boundary(index: np.ndarray, filled: np.ndarray) -> np.ndarray:
    """(T, 3) outward triangles between the filled cells and the empty ones."""
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        cells, points = (np.moveaxis(a, (axis, u, v), (0, 1, 2)) for a in (np.pad(filled, 1), index))
        cells = cells[:, 1:-1, 1:-1]
        for side in (0, -1):
            open_ = cells[:-1] & ~cells[1:] if side == -1 else cells[1:] & ~cells[:-1]
            quads = np.stack([points[:, a : -1 + a or None, b : -1 + b or None] for b in (0, 1) for a in (0, 1)], -1)
            outward = QUAD if side == -1 else QUAD[:, ::-1]
            triangles.append(quads[open_][:, outward].reshape(-1, 3))
    return np.concatenate(triangles).astype(np.int32)


def hexahedra(index: np.ndarray, filled: np.ndarray | None = None) -> np.ndarray:
    """(C, 8) corners of all or the filled cells of the grid, the last axis fastest; see Body.cells."""
    if min(index.shape) < 2:
        return np.zeros((0, 8), np.int32)
    sides = [tuple(slice(a, n - 1 + a) for a, n in zip(c, index.shape, strict=True)) for c in np.ndindex(2, 2, 2)]
    found = np.stack([index[side].ravel() for side in sides], 1).astype(np.int32)
    return found if filled is None else found[filled.ravel()]


def rotation(degrees: Vector) -> np.ndarray:
    """The rotation matrix about x, then y, then z."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def body_of(
    jello: Jello,
    index: np.ndarray,
    spacing: np.ndarray,
    filled: np.ndarray | None = None,
    shares: np.ndarray | None = None,
) -> Body:
    """The Body of a jello whose particles are the points of the grid `index` (n, m, l), `spacing` (3,) [m] apart and
    centred on the grid's middle.

    filled (n-1, m-1, l-1) bool: only these cells belong to it, and index is -1 where no particle is; shares (N,) of the
    jello's mass, by default equal.
    """
    steps = np.stack(np.nonzero(index >= 0), 1)
    rest = (steps - 0.5 * (np.array(index.shape) - 1)) * spacing
    offsets = [(FAMILIES.index(name), offset) for name in dict.fromkeys(jello.springs) for offset in OFFSETS[name]]
    pairs = [connect(index, offset, filled) for _, offset in offsets]
    counts = np.array([len(found) for found in pairs], int)
    return spring_body(
        jello,
        rest,
        springs=np.concatenate([np.zeros((0, 2), np.int32), *pairs]),
        vectors=np.repeat(np.array([o for _, o in offsets]).reshape(-1, 3) * spacing, counts, axis=0),
        family=np.repeat(np.array([family for family, _ in offsets], np.int8), counts),
        mass=jello.mass * (np.full(len(rest), 1.0 / len(rest)) if shares is None else shares),
        surface=surface(index) if filled is None else boundary(index, filled),
        cells=hexahedra(index, filled),
    )


def spring_body(
    jello: Jello, rest: np.ndarray, springs: np.ndarray, vectors: np.ndarray, family: np.ndarray, **arrays: np.ndarray
) -> Body:
    """The Body of a jello from its points, springs (S, 2) with rest vectors (S, 3) [m] from their first to their second
    point, and the other arrays of Body."""
    coefficients = {}
    for name in ("stiffness", "damping"):
        value = getattr(jello, name)
        each = [value.get(f, 0.0) for f in FAMILIES] if isinstance(value, dict) else [value] * len(FAMILIES)
        coefficients[name] = np.array(each)[family]
    length, turned = np.linalg.norm(vectors, axis=1), rest @ rotation(jello.rotation).T
    lower_first = np.where(springs[:, :1] < springs[:, 1:], 1.0, -1.0)
    return Body(
        rest=rest,
        x=turned + (jello.position or (0.0, 0.0, 0.0)),
        v=np.array(jello.velocity) + np.cross(jello.spin, turned),
        pinned=np.any([np.zeros(len(rest), bool)] + [p.holds(places(rest, rest)) for p in jello.pin], axis=0),
        jello=np.zeros(len(rest), np.int32),
        springs=np.sort(springs, axis=1),
        rest_length=length,
        family=family,
        direction=lower_first * vectors / length[:, None],
        **coefficients,
        **arrays,
    )


def grid_body(jello: Jello, points: tuple[int, int, int], size: Vector) -> Body:
    """The Body of a whole grid: `points` along each axis of a box of `size` [m]; one point has no thickness."""
    n = np.array(points)
    index = np.arange(n.prod(), dtype=np.int32).reshape(n)
    return body_of(jello, index, np.where(n > 1, np.array(size) / np.maximum(n - 1, 1), 0.0))


def counts(key: str, value: Any, axes: int) -> tuple[int, ...]:
    """`value` as numbers of points along each of 2 or 3 `axes`, at most MAX_PARTICLES together."""
    if isinstance(value, (str, int, float)) or len(value) != axes:
        raise SceneError(key, f"expected {('two', 'three')[axes - 2]} whole numbers, got {shown(value)}")
    points = tuple(whole(f"{key}.{axis}", n, low=1) for axis, n in enumerate(value))
    if prod(points) > MAX_PARTICLES:
        raise SceneError(key, f"expected at most {MAX_PARTICLES:,} particles, got {prod(points):,}")
    return points


@dataclass(frozen=True, kw_only=True)
class Box(Jello):
    """`points` along each axis of a box of `size` [m]; an axis with one point has no thickness."""

    shape: ClassVar[str] = "box"
    points: tuple[int, int, int] = (8, 8, 8)
    size: Vector = (1.0, 1.0, 1.0)

    def check(self) -> dict[str, Any]:
        own = {"points": counts("points", self.points, 3), "size": vector("size", self.size, above=0.0)}
        return super().check() | own

    def body(self) -> Body:
        return grid_body(self, self.points, self.size)
