"""Wavefront OBJ: the statements v and f. Everything else is skipped; materials and textures are never opened."""

from array import array
from typing import NoReturn

import numpy as np

from taichi_jello.scene.validation import shown
from taichi_jello.shapes._meshfiles.polygons import MeshProblem, triangulated


def read(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Points (V, 3) and triangles (T, 3). Raises MeshProblem naming the line and what was expected."""
    points, corners, counts, lines = array("d"), array("q"), array("q"), array("q")
    before = b""  # of a statement that goes on in the next line
    for number, line in enumerate(data.splitlines(), 1):
        line, before = before + line.partition(b"#")[0], b""
        if line.endswith(b"\\"):
            before = line[:-1] + b" "
            continue
        keyword, *words = line.split() or [b"#"]
        if keyword == b"v":
            try:
                x, y, z = (float(word) for word in words[:3])
            except ValueError:
                _refuse(number, "expected three numbers", line)
            points.extend((x, y, z))
        elif keyword == b"f":
            try:
                polygon = [int(word.partition(b"/")[0]) for word in words]
            except ValueError:
                _refuse(number, "expected vertices v, v/t, v//n or v/t/n", line)
            if len(polygon) < 3:
                _refuse(number, "expected at least three vertices", line)
            have = len(points) // 3
            if min(polygon) < 0:  # relative to this line
                polygon = [vertex + have if vertex < 0 else vertex - 1 for vertex in polygon]
                if min(polygon) < 0:
                    _refuse(number, f"expected one of the {have} vertices before this line", line)
            elif 0 in polygon:
                _refuse(number, "expected vertices counted from 1, or from -1 backwards", line)
            else:
                polygon = [vertex - 1 for vertex in polygon]
            if max(polygon) >= 2**62:
                _refuse(number, "expected smaller numbers", line)
            corners.extend(polygon)
            counts.append(len(polygon))
            lines.append(number)
        elif not keyword[:1].isalpha() and keyword != b"#":
            _refuse(number, "expected a statement of the OBJ format such as v or f", line)
    return _mesh(np.array(points).reshape(-1, 3), np.array(corners), np.array(counts), np.array(lines))


def _mesh(
    points: np.ndarray, corners: np.ndarray, counts: np.ndarray, lines: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The points and the triangles of polygons that stand on these lines."""
    bad = np.flatnonzero(corners >= len(points))
    if len(bad):
        line = lines[np.searchsorted(np.cumsum(counts), bad[0], side="right")]
        raise MeshProblem(f"line {line}: expected one of {len(points)} vertices, got {corners[bad[0]] + 1}")
    return points, triangulated(points, corners.astype(np.int64), counts.astype(np.int64))


def _refuse(number: int, expected: str, line: bytes) -> NoReturn:
    raise MeshProblem(f"line {number}: {expected}, got {shown(line.decode(errors='replace'))}")
