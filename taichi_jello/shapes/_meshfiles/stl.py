"""STL, as text and binary."""

import warnings

import numpy as np

from taichi_jello.scene.validation import shown
from taichi_jello.shapes._meshfiles.polygons import MeshProblem

HEADER = 84  # bytes: 80 of any text, then the number of triangles
TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


class MeshWarning(UserWarning):
    """A mesh with flaws that can still be used."""


def read(data: bytes, file: str) -> tuple[np.ndarray, np.ndarray]:
    """Points (3T, 3) and triangles (T, 3). Raises MeshProblem naming the place and what was expected; a binary file
    whose count is wrong but whose triangles are whole gets a MeshWarning."""
    count = int.from_bytes(data[HEADER - 4 : HEADER], "little")
    binary = len(data) == HEADER + count * TRIANGLE.itemsize
    # Some programs begin binary files with the word solid, too; only these have zeros.
    text = data[:6].lower().startswith(b"solid") and b"\0" not in data[:1000]
    corners = _text(data) if text and not binary else _binary(data, count, file)
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def _binary(data: bytes, count: int, file: str) -> np.ndarray:
    """(T, 3, 3) corners."""
    if len(data) < HEADER:
        raise MeshProblem(f"expected STL, as text or at least {HEADER} bytes, got {len(data)} bytes")
    there, rest = divmod(len(data) - HEADER, TRIANGLE.itemsize)
    problem = f"byte 80: its header counts {count} triangles, its {len(data)} bytes hold {there}"
    if count > there and rest:
        raise MeshProblem(f"{problem}; expected whole triangles, it is cut short or of another kind")
    taken = min(count or there, there)
    if count != there or rest:
        warnings.warn(f"{file}: {problem} and {rest} bytes more; read {taken}", MeshWarning, stacklevel=2)
    return np.frombuffer(data, TRIANGLE, taken, HEADER)["corners"].astype(float)


def _text(data: bytes) -> np.ndarray:
    """(T, 3, 3) corners."""
    corners: list[tuple[float, ...]] = []
    number, begun, facets = 0, 0, 0  # begun: corners before this triangle
    for number, line in enumerate(data.splitlines(), 1):
        keyword, *words = line.lower().split() or [b""]
        if keyword == b"vertex":
            try:
                x, y, z = (float(word) for word in words)
            except ValueError:
                got = shown(line.decode(errors="replace"))
                raise MeshProblem(f"line {number}: expected vertex and three numbers, got {got}") from None
            corners.append((x, y, z))
        elif keyword == b"facet":
            facets += 1
        elif keyword == b"endloop":
            if len(corners) != begun + 3:
                raise MeshProblem(f"line {number}: expected three vertices before it, got {len(corners) - begun}")
            begun += 3
    if len(corners) != begun or begun < 3 * facets:
        raise MeshProblem(f"line {number}: expected endloop after three vertices, the file is cut short")
    return np.array(corners, float).reshape(-1, 3, 3)
