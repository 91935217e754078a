"""Surface meshes from files, read with trimesh, checked and welded."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from taichi_jello.scene.validation import SceneError

SUFFIXES = (".obj", ".stl", ".ply", ".glb")
MAX_TRIANGLES = 2_000_000
WELD = 1e-6  # of the mesh's size: closer points are merged
INSTALL = "pip install 'taichi_jello[mesh]'"


class MeshWarning(UserWarning):
    """A mesh with flaws that can still be used."""


def read(file: str) -> tuple[np.ndarray, np.ndarray]:
    """Welded points (V, 3) and triangles (T, 3) of a mesh file.

    Raises SceneError naming the file and what was expected.
    """
    path = Path(file)
    if path.suffix.lower() not in SUFFIXES:
        raise SceneError("file", f"{file}: expected a name ending in {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise SceneError("file", f"{file}: there is no such file")
    try:
        import trimesh
    except ModuleNotFoundError:
        raise SceneError("file", f"meshes need trimesh: {INSTALL}") from None
    kind = path.suffix.lower()[1:]
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            loaded: Any = trimesh.load(str(path), file_type=kind, force="mesh", process=False)
        points, triangles = np.array(loaded.vertices, float), np.array(loaded.faces, np.int64)
    except OSError as error:
        raise SceneError("file", f"{file}: cannot be read: {error.strerror}") from None
    except Exception as error:  # a parser may raise anything
        reason = f" ({(str(error).splitlines() or [type(error).__name__])[0]})"
        if isinstance(error, ImportError):  # trimesh asks for more packages if it does not recognise a text
            reason = ""
        elif isinstance(error, IndexError):
            reason = " (a triangle has a point that is not there)"
        problem = f"expected a mesh in {kind.upper()} format, it is cut short or of another kind{reason}"
        raise SceneError("file", f"{file}: {problem}") from None
    return weld(file, points, triangles)


def weld(file: str, points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mesh without duplicate points and degenerate triangles. Raises SceneError if it is empty, not finite or too
    large."""
    if not len(triangles) or not len(points):
        raise SceneError("file", f"{file}: expected a mesh of triangles, it has none")
    if len(triangles) > MAX_TRIANGLES:
        problem = f"expected at most {MAX_TRIANGLES:,} triangles, got {len(triangles):,}; simplify it"
        raise SceneError("file", f"{file}: {problem}")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise SceneError("file", f"{file}: expected triangles over its {len(points)} points, got {triangles.max()}")
    used = np.flatnonzero(np.bincount(triangles.ravel(), minlength=len(points)))
    bad = used[~np.isfinite(points[used]).all(1)]
    if len(bad):
        raise SceneError("file", f"{file}: expected finite numbers, point {bad[0]} is {points[bad[0]].tolist()}")
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
