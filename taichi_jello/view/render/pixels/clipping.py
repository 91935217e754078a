"""Cutting off what of a mesh lies behind the eye."""

import numpy as np

from taichi_jello.view.drawing.shading import MIN_DEPTH


def clipped(depth: np.ndarray, faces: np.ndarray, *rows: np.ndarray) -> tuple[np.ndarray, ...]:
    """faces (T', 3) and rows (V', k), such as positions and normals, of the part of a mesh deeper than MIN_DEPTH.
    depth (V,) [m], faces (T, 3), each of rows (V, k)."""
    before = depth[faces] > MIN_DEPTH
    cut = before.any(1) & ~before.all(1)
    kept, parts = [faces[before.all(1)]], [[row] for row in rows]
    count = len(depth)
    for face, inside in zip(faces[cut], before[cut], strict=True):
        ring = []  # corner pairs and how far from the first to the second
        for k in range(3):
            a, b = face[k], face[(k + 1) % 3]
            if inside[k]:
                ring.append((a, a, 0.0))
            if inside[k] != inside[(k + 1) % 3]:
                ring.append((a, b, (MIN_DEPTH - depth[a]) / (depth[b] - depth[a])))
        first, second, share = (np.array(column) for column in zip(*ring, strict=True))
        for part, row in zip(parts, rows, strict=True):
            part.append(row[first] + (row[second] - row[first]) * share[:, None].astype(np.float32))
        kept.append(count + np.array([[0, k, k + 1] for k in range(1, len(ring) - 1)]))
        count += len(ring)
    return (np.concatenate(kept).astype(np.int32), *(np.concatenate(part) for part in parts))
