"""Surface meshes from files, checked and welded."""

from pathlib import Path

import numpy as np

from taichi_jello.scene.validation import LARGEST, SceneError
from taichi_jello.shapes._meshfiles import glb, obj, ply, stl
from taichi_jello.shapes._meshfiles.polygons import MAX_TRIANGLES, MeshProblem

READERS = {
    ".obj": lambda data, path: obj.read(data),
    ".stl": lambda data, path: stl.read(data, str(path)),
    ".ply": lambda data, path: ply.read(data),
    ".glb": lambda data, path: glb.read(data, path.parent),
}
WELD = 1e-6  # of the mesh's size: closer points are merged
BYTE_ORDER_MARK = b"\xef\xbb\xbf"


def read(file: str) -> tuple[np.ndarray, np.ndarray]:
    """Welded points (V, 3) and triangles (T, 3) of a mesh file.

    Raises SceneError naming the file, the place in it and what was expected.
    """
    path = Path(file)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise SceneError("file", f"{file}: expected a name ending in {', '.join(READERS)}")
    try:
        if not path.is_file():
            there = path.exists()
            raise SceneError("file", f"{file}: {'expected a regular file' if there else 'there is no such file'}")
        with np.errstate(all="ignore"):
            points, triangles = reader(path.read_bytes().removeprefix(BYTE_ORDER_MARK), path)
    except OSError as error:
        raise SceneError("file", f"{file}: cannot be read: {error.strerror}") from None
    except MeshProblem as error:
        raise SceneError("file", f"{file}: {error}") from None
    return weld(file, points, triangles)


def weld(file: str, points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mesh without duplicate points and degenerate triangles. Raises SceneError if it is empty, not finite or too
    large."""
    if not len(triangles) or not len(points):
        raise SceneError("file", f"{file}: expected a mesh of triangles, it has none")
    if len(triangles) > MAX_TRIANGLES:
        problem = f"expected at most {MAX_TRIANGLES:,} triangles, got {len(triangles):,}; simplify it"
        raise SceneError("file", f"{file}: {problem}")
    used = np.flatnonzero(np.bincount(triangles.ravel(), minlength=len(points)))
    bad = used[~(np.abs(points[used]) <= LARGEST).all(1)]
    if len(bad):
        problem = f"expected finite numbers of at most {LARGEST:g}, point {bad[0]} is {points[bad[0]].tolist()}"
        raise SceneError("file", f"{file}: {problem}")
    extent = float(np.ptp(points[used], axis=0).max())
    if extent == 0.0:
        raise SceneError("file", f"{file}: expected a mesh with a size, all its points are in one place")
    places = np.round((points[used] - points[used].min(0)) / (WELD * extent)).astype(np.int64)
    x, y, z = places.T  # at most 1 / WELD: 20 bits each
    _, first, which = np.unique(x << 40 | y << 20 | z, return_index=True, return_inverse=True)
    renamed = np.zeros(len(points), np.int64)
    renamed[used] = which
    triangles = renamed[triangles]
    a, b, c = triangles.T
    return points[used][first], triangles[(a != b) & (b != c) & (c != a)]


def flaws(points: np.ndarray, triangles: np.ndarray) -> tuple[int, int]:
    """The number of open edges (with one triangle) and of edges that two triangles run through in the same direction:
    these face different sides."""
    ways = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    forth, back = ways[:, 0] * len(points) + ways[:, 1], ways[:, 1] * len(points) + ways[:, 0]
    key, count = np.unique(forth, return_counts=True)
    return int(np.count_nonzero(~np.isin(key, back) & (count == 1))), int(np.count_nonzero(count > 1))
