"""Mesh files as they are found: right shapes against volumes known in closed form, one clear line for the rest."""

import base64
import json
import os
import struct
import warnings

import numpy as np
import pytest

from taichi_jello import SceneError
from taichi_jello.shapes._meshfiles.polygons import triangulated
from taichi_jello.shapes._meshfiles.reading import flaws, read
from taichi_jello.shapes._meshfiles.stl import MeshWarning
from taichi_jello.shapes.mesh import volume

CORNERS = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]


def obj(points, polygons, base=1):
    lines = [f"v {x} {y} {z}" for x, y, z in points]
    return "\n".join([*lines, *("f " + " ".join(str(k + base) for k in polygon) for polygon in polygons)]) + "\n"


def ply_header(form, vertices, faces, extra=""):
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    element = f"element face {faces}\nproperty list uchar int vertex_indices\n" if faces else ""
    return f"ply\nformat {form} 1.0\n{extra}element vertex {vertices}\n{axes}{element}end_header\n"


def stl(count=None, triangles=FACES, points=TETRAHEDRON, tail=b""):
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *(float(v) for k in t for v in points[k]), 0) for t in triangles)
    return b"solid".ljust(80) + struct.pack("<I", len(triangles) if count is None else count) + body + tail


@pytest.fixture
def mesh(tmp_path):
    """mesh(content, name) -> points and triangles."""

    def load(content, name):
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        return read(str(tmp_path / name))

    return load


@pytest.fixture
def problem(mesh):
    """problem(content, name) -> the one line that refuses it."""

    def refused(content, name):
        with pytest.raises(SceneError) as caught:
            mesh(content, name)
        text = str(caught.value)
        assert name in text and text.isprintable() and len(text) < 400
        return text

    return refused


def is_closed_with(found, expected):
    assert flaws(*found) == (0, 0)
    assert volume(*found) == pytest.approx(expected, rel=1e-6)


CUBE = obj(CORNERS, QUADS)


@pytest.mark.parametrize(
    "text",
    [
        CUBE,
        CUBE.replace("\n", " # side\n"),
        CUBE.replace(" ", "\t"),
        CUBE.replace("\n", "\r\n"),
        CUBE.replace("\n", "\r"),
        "\ufeff" + CUBE,
        CUBE.replace("f 1 2", "f 1 \\\n 2"),
        "mtllib /dev/zero\nusemtl gone\nvt 0 0\nvn 0 0 1\n" + CUBE.replace("f 1 2 4 3", "f 1/1/1 2//1 4/1 3"),
        obj(CORNERS, QUADS, base=-8),
        "\n".join(sorted(CUBE.splitlines())),  # faces before their vertices
    ],
    ids=["plain", "comments", "tabs", "crlf", "cr", "mark", "continued", "materials", "relative", "faces first"],
)
def test_obj_cubes(mesh, text):
    is_closed_with(mesh(text, "cube.OBJ"), 1.0)


def test_relative_indices_count_from_their_own_line(mesh):
    parts = [obj(np.array(CORNERS) + [2 * k, 0, 0], QUADS, base=-8) for k in range(3)]
    is_closed_with(mesh("".join(parts), "three.obj"), 3.0)


def prism(outline):
    """A prism of height 1 over a counterclockwise outline, with one polygon for each end, and its volume."""
    n, flat = len(outline), np.array(outline, float)
    points = [(x, y, z) for z in (0, 1) for x, y in outline]
    sides = [(k, (k + 1) % n, (k + 1) % n + n, k + n) for k in range(n)]
    x, y = flat.T
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    return points, [tuple(range(n))[::-1], tuple(range(n, 2 * n)), *sides], area


U = [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]
ANGLES = np.arange(40) * np.pi / 20
STAR = [(np.cos(a) * r, np.sin(a) * r) for a, r in zip(ANGLES, [1.0, 0.4] * 20, strict=True)]
COMB = [(0, 0), (20, 0), *((20 - k, 1 + 4 * (k % 2 == 0)) for k in range(21))]
KEYHOLE = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]


@pytest.mark.parametrize("outline", [U, STAR, COMB, KEYHOLE, [(0, 0), (4, 0), (1, 1), (0, 4)]])
@pytest.mark.parametrize("first", [0, 3])
def test_concave_polygons_are_cut_into_ears(outline, first):
    """Every triangle of an end faces its way, and together they have its area: nothing is covered twice."""
    points, polygons, area = prism(outline[first:] + outline[:first])
    corners, counts = np.concatenate(polygons), np.array([len(polygon) for polygon in polygons])
    points = np.array(points, float) @ np.linalg.qr(np.arange(9.0).reshape(3, 3) ** 2 + np.eye(3))[0]
    triangles = triangulated(points, corners, counts)
    assert abs(volume(points, triangles)) == pytest.approx(area)
    a, b, c = (points[triangles[: len(outline) - 2, k]] for k in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert areas.sum() == pytest.approx(area)


def test_a_concave_prism_from_a_file(mesh):
    points, polygons, area = prism(U)
    is_closed_with(mesh(obj(points, polygons), "u.obj"), area)


@pytest.mark.parametrize(
    "text, words",
    [
        (obj(CORNERS, QUADS, base=0), "line 9: expected vertices counted from 1"),
        (CUBE + "f 1 2 9\n", "line 15: expected one of 8 vertices, got 9"),
        (CUBE + "f 1 2 -9\n", "line 15: expected one of the 8 vertices before this line"),
        (CUBE + "f 1 2\n", "line 15: expected at least three vertices"),
        (CUBE + "f 1 2 x\x1b[2J\n", r"line 15: expected vertices v, v/t, v//n or v/t/n, got 'f 1 2 x\x1b[2J'"),
        (CUBE + "v 1 2\n", "line 15: expected three numbers, got 'v 1 2'"),
        (CUBE + "f 1 2 " + "9" * 5000, "line 15: expected"),
        (CUBE + "f 1 2 " + "9" * 40, "line 15: expected smaller numbers"),
        (CUBE + "00000\n", "line 15: expected a statement of the OBJ format such as v or f, got '00000'"),
        ("v 0 0 0\nv 1e300 0 0\nv 0 1 0\nf 1 2 3\n", "expected finite numbers of at most 1e+12, point 1 is"),
        ("", "expected a mesh of triangles, it has none"),
    ],
)
def test_obj_mistakes_name_their_line(problem, text, words):
    assert words in problem(text, "bad.obj")


def test_ply_with_polygons_of_several_sizes(mesh):
    polygons = [QUADS[0][:3], (QUADS[0][0], *QUADS[0][2:]), *QUADS[1:]]
    text = ply_header("ascii", 8, 7, "comment TextureFile /dev/zero\n") + "\n".join(
        [*(f"{x} {y} {z}" for x, y, z in CORNERS), "", *(f"{len(p)} {' '.join(map(str, p))}" for p in polygons)]
    )
    is_closed_with(mesh(text, "cube.PLY"), 1.0)
    is_closed_with(mesh("\ufeff" + text.replace("\n", "\r\n"), "cube.ply"), 1.0)
    for order, form in (("<", "binary_little_endian"), (">", "binary_big_endian")):
        for faces in (polygons, QUADS):
            data = b"".join(struct.pack(f"{order}3f", *point) for point in CORNERS)
            data += b"".join(struct.pack(f"{order}B{len(p)}i", len(p), *p) for p in faces)
            is_closed_with(mesh(ply_header(form, 8, len(faces)).encode() + data, "cube.ply"), 1.0)


def test_ply_with_strips(mesh):
    """A tetrahedron in one strip, and in two; every second triangle of a strip is turned."""
    for rows in ("6 0 2 1 3 0 2", "10 0 2 1 3 -1 1 3 0 2 -1"):
        extra = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
        text = ply_header("ascii", 4, 0).replace("end_header\n", extra) + "0 0 0\n1 0 0\n0 1 0\n0 0 1\n" + rows
        is_closed_with(mesh(text, "strip.ply"), 1.0 / 6.0)


VERTICES = "0 0 0\n1 0 0\n0 1 0\n"


@pytest.mark.parametrize(
    "text, words",
    [
        (ply_header("ascii", 3, 1) + VERTICES + "3 0 1 3", "line 13: expected a vertex from 0 to 2, got 3"),
        (ply_header("ascii", 3, 1) + VERTICES + "2 0 1", "line 13: expected at least three vertices, got 2"),
        (ply_header("ascii", 3, 1) + "0 0 0\n1 zero 0\n0 1 0\n3 0 1 2", "line 11: expected x y z of 3 rows of vertex"),
        (ply_header("ascii", 10**12, 1) + VERTICES, "the end of the file: expected x y z of 1000000000000 rows"),
        (ply_header("binary_little_endian", 10**12, 1), "vertex 0: expected x y z of 1000000000000 rows of vertex"),
        (ply_header("binary_little_endian", 0, 10**12) + "\xff", "face 0: expected vertex_indices of 1000000000000"),
        (ply_header("utf-8", 3, 1), "line 2: expected a line of a PLY header, got 'format utf-8 1.0'"),
        (ply_header("ascii", -3, 1), "line 3: expected a line of a PLY header, got 'element vertex -3'"),
        (ply_header("ascii", 3, 1).replace("float y", "list uchar int y"), "expected"),
        (ply_header("ascii", 3, 1).replace("float y", "float w") + VERTICES + "3 0 1 2", "numbers x, y and z"),
        ("ply\n", "line 1: expected ply, and a header up to end_header"),
        ("", "line 1: expected ply"),
    ],
)
def test_ply_mistakes_name_their_place(problem, text, words):
    assert words in problem(text, "bad.ply")


@pytest.mark.parametrize(
    "data, words",
    [
        (stl(count=0), "its header counts 0 triangles, its 284 bytes hold 4 and 0 bytes more; read 4"),
        (stl(count=2**32 - 1), "its header counts 4294967295 triangles, its 284 bytes hold 4"),
        (stl(tail=b"\xbb" * 7), "its header counts 4 triangles, its 291 bytes hold 4 and 7 bytes more; read 4"),
        (stl(tail=b"\xbb" * 77), "hold 5 and 27 bytes more; read 4"),
    ],
)
def test_stl_whose_count_is_wrong_is_read_with_a_warning(mesh, data, words):
    with pytest.warns(MeshWarning) as told:
        is_closed_with(mesh(data, "odd.stl"), 1.0 / 6.0)
    assert len(told) == 1 and "odd.stl: byte 80: " in str(told[0].message) and words in str(told[0].message)


def stl_text():
    facet = "  facet normal 0 0 0\n    outer loop\n{}    endloop\n  endfacet\n"
    vertex = "      vertex {} {} {}\n"
    body = "".join(facet.format("".join(vertex.format(*TETRAHEDRON[k]) for k in face)) for face in FACES)
    return f"solid a solid\n{body}endsolid\n"


def test_stl_as_text(mesh, problem):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        is_closed_with(mesh(stl(), "binary.STL"), 1.0 / 6.0)  # which begins with the word solid
        for text in (stl_text(), stl_text().upper().replace("\n", "\r\n"), "\ufeff" + stl_text().replace(" ", "\t")):
            is_closed_with(mesh(text, "text.stl"), 1.0 / 6.0)
    assert "line 6: expected three vertices before it, got 2" in problem(
        stl_text().replace("      vertex 0 0 0\n", "", 1), "few.stl"
    )
    assert "line 4: expected vertex and three numbers" in problem(
        stl_text().replace("vertex 0 0 0", "vertex 0 0 nought", 1), "x.stl"
    )
    assert "the file is cut short" in problem(stl_text()[:150], "cut.stl")
    assert "it is cut short or of another kind" in problem(stl()[:-60], "cut.stl")


def glb(nodes=({"mesh": 0},), data=None, primitive=None, **changes):
    points = np.array(TETRAHEDRON, "<f4").tobytes() + np.array(FACES, "<u2").tobytes()
    document = {
        "asset": {"version": "2.0"},
        "nodes": list(nodes),
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0} | (primitive or {})]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 24},
        ],
        "buffers": [{"byteLength": 72}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "/dev/zero"}],
    } | changes
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text
    if data is None:
        chunks += struct.pack("<2I", len(points), 0x004E4942) + points
    return b"glTF" + struct.pack("<2I", 2, 12 + len(chunks)) + chunks


def test_glb_nodes_move_turn_and_mirror(mesh, tmp_path):
    is_closed_with(mesh(glb(), "one.GLB"), 1.0 / 6.0)
    parent = {"children": [1], "scale": [2, 1, 1], "translation": [5, 0, 0]}
    child = {"mesh": 0, "rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)], "scale": [1, 1, -1]}
    points, triangles = mesh(glb([parent, child]), "moved.glb")
    is_closed_with((points, triangles), 2.0 / 6.0)  # a mirrored one still faces outwards
    assert points.min(0) == pytest.approx([3.0, 0.0, -1.0]) and points.max(0) == pytest.approx([5.0, 1.0, 0.0])
    uri = (
        "data:application/octet-stream;base64,"
        + base64.b64encode(np.array(TETRAHEDRON, "<f4").tobytes() + np.array(FACES, "<u2").tobytes()).decode()
    )
    is_closed_with(mesh(glb(buffers=[{"uri": uri}]), "inside.glb"), 1.0 / 6.0)
    (tmp_path / "points.bin").write_bytes(base64.b64decode(uri.partition(",")[2]))
    is_closed_with(mesh(glb(buffers=[{"uri": "points.bin"}]), "beside.glb"), 1.0 / 6.0)


def test_glb_that_claims_more_than_it_holds_is_refused(problem, tmp_path):
    huge = {"componentType": 5126, "count": 300_000_000, "type": "VEC3"}
    indices = {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"}
    assert "accessors.0: expected VEC3 in a bufferView" in problem(glb(accessors=[huge, indices]), "huge.glb")
    words = problem(glb(accessors=[huge | {"bufferView": 0}, indices]), "huge.glb")
    assert "accessors.0: expected at most what its 48 bytes hold, got 300000000" in words
    assert "nodes.0: expected a node with one parent" in problem(
        glb([{"children": [0]}], scenes=[{"nodes": [0]}]), "ring.glb"
    )
    os.mkfifo(tmp_path / "pipe.bin")
    for uri in ("pipe.bin", "/dev/zero", "../x.bin"):
        words = problem(glb(buffers=[{"uri": uri}]), "pipe.glb")
        assert "buffers.0: expected a regular file beside the mesh" in words
    assert "without KHR_draco" in problem(glb(extensionsRequired=["KHR_draco_mesh_compression"]), "small.glb")
    assert "the file is cut short" in problem(glb()[:-30], "cut.glb")
    assert "byte 0: expected glTF" in problem(b"glTF", "cut.glb")
    assert "expected glTF 2.0, it is of another kind or broken" in problem(glb(meshes=3), "odd.glb")


def test_a_pipe_is_no_mesh(tmp_path):
    os.mkfifo(tmp_path / "pipe.obj")
    with pytest.raises(SceneError, match=r"pipe.obj: expected a regular file"):
        read(str(tmp_path / "pipe.obj"))
