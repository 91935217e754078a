"""One binary PLY a frame: the skin with its colours, y up, in metres."""

import numpy as np

from taichi_jello.film.writer import Mesh, Writer

VERTEX = np.dtype([("x", "<f4", 3), ("rgb", "u1", 3)])
FACE = np.dtype([("corners", "u1"), ("index", "<i4", 3)])
HEADER = """ply
format binary_little_endian 1.0
element vertex {vertices}
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
element face {faces}
property list uchar int vertex_indices
end_header
"""


class Ply(Writer):
    suffix = ".ply"
    frame = Mesh
    sequence = True

    def add(self, number: int, frame: Mesh) -> None:
        vertices, faces = np.zeros(len(frame.x), VERTEX), np.zeros(len(frame.index), FACE)
        vertices["x"], vertices["rgb"] = frame.x, frame.rgb
        faces["corners"], faces["index"] = 3, frame.index
        header = HEADER.format(vertices=len(vertices), faces=len(faces)).encode("ascii")
        self.path(number).write_bytes(header + vertices.tobytes() + faces.tobytes())
