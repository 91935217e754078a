"""Binary glTF 2.0: the triangles of a scene, each moved as its node says. Materials and textures are never opened."""

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from taichi_jello.scene.validation import shown
from taichi_jello.shapes._meshfiles.polygons import MAX_TRIANGLES, MeshProblem

JSON, BINARY = 0x4E4F534A, 0x004E4942  # kinds of chunks
COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
SIZES = {"SCALAR": 1, "VEC3": 3}
TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of primitives; the others are points and lines


def read(data: bytes, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Points (3T, 3) and triangles (T, 3). Raises MeshProblem naming the place and what was expected."""
    try:
        document, binary = _chunks(data)
        corners = _Document(document, binary, folder).corners()
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, RecursionError) as error:
        if isinstance(error, MeshProblem):
            raise
        raise MeshProblem(f"expected glTF 2.0, it is of another kind or broken: {shown(error)}") from None
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def _chunks(data: bytes) -> tuple[Any, bytes]:
    """The JSON document and the binary chunk."""
    if data[:4] != b"glTF" or int.from_bytes(data[4:8], "little") != 2:
        raise MeshProblem("byte 0: expected glTF, version 2")
    found, at = {BINARY: b""}, 12
    while at < len(data):
        size, kind = np.frombuffer(data[at : at + 8].ljust(8, b"\0"), "<u4").tolist()
        if at + 8 + size > len(data):
            raise MeshProblem(f"byte {at}: expected a chunk of {size} bytes, the file is cut short")
        found.setdefault(kind, b"")
        found[kind] = found[kind] or data[at + 8 : at + 8 + size]
        at += 8 + size
    return json.loads(found[JSON]), found[BINARY]


class _Document:
    def __init__(self, document: Any, binary: bytes, folder: Path):
        self.document, self.binary, self.folder = document, binary, folder
        compressions = [name for name in document.get("extensionsRequired", ()) if "compression" in name]
        if compressions:
            raise MeshProblem(f"expected a mesh without {', '.join(compressions)}; export it uncompressed")

    def corners(self) -> np.ndarray:
        """(T, 3, 3) of all triangles in the scene."""
        found, count = [np.empty((0, 3, 3))], 0
        for mesh, matrix in self._placed():
            for primitive in self.document["meshes"][mesh]["primitives"]:
                triangles = self._triangles(primitive)
                count += len(triangles)
                if count > MAX_TRIANGLES:
                    raise MeshProblem(f"expected at most {MAX_TRIANGLES:,} triangles, got more; simplify it")
                points = self._accessor(primitive["attributes"]["POSITION"], "VEC3")
                if triangles.size and triangles.max() >= len(points):
                    raise MeshProblem(f"meshes.{mesh}: expected one of {len(points)} points, got {triangles.max()}")
                turned = triangles[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0.0 else triangles
                found.append(points[turned] @ matrix[:3, :3].T + matrix[:3, 3])
        return np.concatenate(found)

    def _placed(self) -> Iterator[tuple[int, np.ndarray]]:
        """The meshes of the scene, with the matrix (4, 4) of each."""
        nodes = self.document.get("nodes", [])
        children = {child for node in nodes for child in node.get("children", ())}
        roots = [k for k in range(len(nodes)) if k not in children]
        if "scenes" in self.document:
            roots = self.document["scenes"][self.document.get("scene", 0)].get("nodes", [])
        left, seen = [(root, np.eye(4)) for root in roots], set()
        while left:
            k, matrix = left.pop()
            if k in seen:
                raise MeshProblem(f"nodes.{k}: expected a node with one parent")
            seen.add(k)
            matrix = matrix @ _matrix(nodes[k])
            left += [(child, matrix) for child in nodes[k].get("children", ())]
            if "mesh" in nodes[k]:
                yield nodes[k]["mesh"], matrix

    def _triangles(self, primitive: Any) -> np.ndarray:
        """(T, 3) indices of points."""
        mode = primitive.get("mode", TRIANGLES)
        if "indices" in primitive:
            row = self._accessor(primitive["indices"], "SCALAR")[:, 0].astype(np.int64)
        else:
            row = np.arange(len(self._accessor(primitive["attributes"]["POSITION"], "VEC3")))
        if mode == TRIANGLES:
            return row[: len(row) // 3 * 3].reshape(-1, 3)
        if mode == FAN:
            return np.stack([np.broadcast_to(row[:1], len(row[2:])), row[1:-1], row[2:]], axis=1)
        if mode == STRIP:
            strip = np.stack([row[:-2], row[1:-1], row[2:]], axis=1)
            strip[1::2] = strip[1::2, [1, 0, 2]]
            return strip
        return np.empty((0, 3), np.int64)

    def _accessor(self, k: int, kind: str) -> np.ndarray:
        """(N, 1 or 3) numbers, a view of a buffer."""
        accessor = self.document["accessors"][k]
        count, size = accessor["count"], SIZES[kind]
        if accessor["type"] != kind or "sparse" in accessor or "bufferView" not in accessor:
            raise MeshProblem(f"accessors.{k}: expected {kind} in a bufferView, not sparse")
        view, number = (
            self.document["bufferViews"][accessor["bufferView"]],
            np.dtype(COMPONENTS[accessor["componentType"]]),
        )
        stride = view.get("byteStride", size * number.itemsize)
        start, length = view.get("byteOffset", 0), view["byteLength"]
        piece = memoryview(self._buffer(view["buffer"]))[start : start + length][accessor.get("byteOffset", 0) :]
        if min(start, length, count, stride - 1) < 0 or len(piece) < stride * (count - 1) + size * number.itemsize:
            raise MeshProblem(f"accessors.{k}: expected at most what its {len(piece)} bytes hold, got {shown(count)}")
        values = np.ndarray((count, size), number, piece, strides=(stride, number.itemsize))
        whole = np.iinfo(number).max if accessor.get("normalized") else 1.0
        return values if whole == 1.0 else values / whole

    def _buffer(self, k: int) -> bytes:
        uri = self.document["buffers"][k].get("uri")
        if uri is None:
            return self.binary
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        path = self.folder / unquote(uri)
        if path.parent != self.folder or not path.is_file():
            raise MeshProblem(f"buffers.{k}: expected a regular file beside the mesh, got {shown(uri)}")
        return path.read_bytes()


def _matrix(node: Any) -> np.ndarray:
    """(4, 4) from a node to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = (float(part) for part in node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
    matrix = np.eye(4)
    turn = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    matrix[:3, :3] = np.array(turn) * np.array(node.get("scale", (1.0, 1.0, 1.0)), float)
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix
