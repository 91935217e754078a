"""The workshop's jello: a regular grid of particles with structural, shear and bend springs."""

from dataclasses import dataclass
from math import prod
from typing import Any, ClassVar

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import FAMILIES, Jello, SceneError, Vector, vector, whole

LARGEST = 4_000_000  # particles; beyond it a scene is taken for a mistyped one

# One offset of each opposite pair, so that every spring is made once (workshop, "interconnected springs").
OFFSETS = {
    "structural": [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "shear": [(1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)]
    + [(1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1)],
    "bend": [(2, 0, 0), (0, 2, 0), (0, 0, 2)],
}
QUAD = np.array([[0, 1, 3], [0, 3, 2]])


def ends(shape: tuple[int, ...], offset: tuple[int, ...]) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Where in a grid of this shape the points with a neighbour `offset` away are, and where these neighbours."""
    near = tuple(slice(max(0, -o), max(0, n - max(0, o))) for o, n in zip(offset, shape, strict=True))
    far = tuple(slice(max(0, o), max(0, n - max(0, -o))) for o, n in zip(offset, shape, strict=True))
    return near, far


def connect(index: np.ndarray, offset: tuple[int, int, int], filled: np.ndarray | None = None) -> np.ndarray:
    """(S, 2) pairs of neighbours `offset` apart in the grid `index` (n, m, l).

    filled (n-1, m-1, l-1) bool: only pairs that one filled cell holds; two steps apart: that two cells in a row do.
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
    """Whether a filled cell holds both ends, for each pair of neighbours `offset` apart."""
    around = np.pad(filled, 1)  # cell c lies between the points c and c + 1, here at c + 1
    n = np.array(filled.shape) + 1 - np.abs(offset)
    held = np.zeros(n, bool)
    for sides in np.ndindex(*(1 if o else 2 for o in offset)):
        start = [side if o == 0 else 1 for side, o in zip(sides, offset, strict=True)]
        held |= around[tuple(slice(a, a + k) for a, k in zip(start, n, strict=True))]
    return held


def corners(filled: np.ndarray) -> np.ndarray:
    """The grid `index` of the points of the filled cells, -1 elsewhere, numbered with the last axis fastest."""
    used = np.zeros(np.array(filled.shape) + 1, bool)
    for side in np.ndindex(2, 2, 2):
        used[tuple(slice(a, a + n) for a, n in zip(side, filled.shape, strict=True))] |= filled
    return np.where(used, np.cumsum(used).reshape(used.shape) - 1, -1).astype(np.int32)


def surface(index: np.ndarray) -> np.ndarray:
    """(T, 3) outward triangles on the six sides of the grid; a grid one point thick has both its sides."""
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
    """(C, 8) corners of the cells between the points of the grid, all or the filled ones, the last axis fastest; see
    Body.cells."""
    if min(index.shape) < 2:
        return np.zeros((0, 8), np.int32)
    ends = (slice(None, -1), slice(1, None))
    found = np.stack([index[a, b, c].ravel() for a in ends for b in ends for c in ends], 1).astype(np.int32)
    return found if filled is None else found[filled.ravel()]


def rotation(degrees: Vector) -> np.ndarray:
    """The matrix that turns about x, then y, then z."""
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
    mass: np.ndarray | None = None,
) -> Body:
    """The Body of a jello whose particles are the points of the grid `index` (n, m, l), `spacing` (3,) [m] apart and
    centred on the grid's middle.

    filled (n-1, m-1, l-1) bool: only these cells belong to it, and index is -1 where no particle is; mass (N,): shares
    of the jello's, by default equal.
    """
    n = np.array(index.shape)
    steps = np.stack(np.nonzero(index >= 0), 1)
    rest = (steps - 0.5 * (n - 1)) * spacing
    low, extent = steps.min(0), np.ptp(steps, axis=0)
    unit = (steps - low) / np.maximum(extent, 1)
    pairs, ways, families = [np.zeros((0, 2), np.int32)], [np.zeros((0, 3))], [np.zeros(0, np.int8)]
    for family in dict.fromkeys(jello.springs):
        for offset in OFFSETS[family]:
            found = connect(index, offset, filled)
            pairs.append(found)
            ways.append(np.tile(np.array(offset) * spacing, (len(found), 1)))
            families.append(np.full(len(found), FAMILIES.index(family), np.int8))
    springs, way, kind = np.concatenate(pairs), np.concatenate(ways), np.concatenate(families)
    length = np.linalg.norm(way, axis=1)

    turned = rest @ rotation(jello.rotation).T
    held = [pin.holds(unit) for pin in jello.pin]
    lower_first = np.where(springs[:, :1] < springs[:, 1:], 1.0, -1.0)
    return Body(
        rest=rest,
        x=turned + jello.position,
        v=np.array(jello.velocity) + np.cross(jello.spin, turned),
        mass=jello.mass * (np.full(len(rest), 1.0 / len(rest)) if mass is None else mass),
        pinned=np.any(held, axis=0) if held else np.zeros(len(rest), bool),
        jello=np.zeros(len(rest), np.int32),
        springs=np.sort(springs, axis=1),
        rest_length=length,
        stiffness=np.array([jello.coefficient("stiffness", f) for f in FAMILIES])[kind],
        damping=np.array([jello.coefficient("damping", f) for f in FAMILIES])[kind],
        family=kind,
        direction=lower_first * way / length[:, None],
        surface=surface(index) if filled is None else boundary(index, filled),
        cells=hexahedra(index, filled),
    )


def grid_body(jello: Jello, points: tuple[int, int, int], size: Vector) -> Body:
    """The Body of a whole grid: `points` along each axis of a box of `size` [m]; one point has no thickness."""
    n = np.array(points)
    index = np.arange(n.prod(), dtype=np.int32).reshape(n)
    return body_of(jello, index, np.where(n > 1, np.array(size) / np.maximum(n - 1, 1), 0.0))


def counts(key: str, value: Any, axes: int) -> tuple[int, ...]:
    """`value` as whole numbers of points along each of 2 or 3 `axes`, not more than LARGEST together."""
    if isinstance(value, (str, int, float)) or len(value) != axes:
        raise SceneError(key, f"expected {('two', 'three')[axes - 2]} whole numbers, got {value!r}")
    points = tuple(whole(f"{key}.{axis}", n, low=1) for axis, n in enumerate(value))
    if prod(points) > LARGEST:
        raise SceneError(key, f"expected at most {LARGEST:,} particles, got {prod(points):,}")
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
