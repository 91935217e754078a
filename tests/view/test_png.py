import struct
import zlib

import numpy as np
import pytest

from taichi_jello.support.png_file import encode_png, write_png


def decode(data: bytes) -> np.ndarray:
    """The picture in a PNG of 8-bit RGB with no filter or the filter Sub, straight from the format's
    definition."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, packed, size = 8, b"", (0, 0)
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + length]
        assert struct.unpack(">I", data[at + 8 + length : at + 12 + length])[0] == zlib.crc32(kind + body)
        if kind == b"IHDR":
            size = struct.unpack(">II", body[:8])
            assert body[8:] == bytes([8, 2, 0, 0, 0])
        packed += body if kind == b"IDAT" else b""
        at += 12 + length
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(size[1], 1 + 3 * size[0])
    pixels = rows[:, 1:].reshape(size[1], size[0], 3)
    return np.where(rows[:, :1, None] == 1, np.cumsum(pixels, axis=1, dtype=np.uint8), pixels)


@pytest.mark.parametrize("shape", [(1, 1), (7, 5), (90, 160)])
def test_a_written_picture_reads_back(tmp_path, shape):
    image = np.random.default_rng(3).integers(0, 256, (*shape, 3), dtype=np.uint8)
    write_png(tmp_path / "a.png", image)
    assert np.array_equal(decode((tmp_path / "a.png").read_bytes()), image)
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


def test_an_old_picture_is_replaced(tmp_path):
    path = tmp_path / "a.png"
    for value in (10, 200):
        write_png(path, np.full((4, 4, 3), value, np.uint8))
    assert decode(path.read_bytes())[0, 0, 0] == 200


def test_an_unwritable_place_leaves_nothing(tmp_path):
    image = np.zeros((4, 4, 3), np.uint8)
    with pytest.raises(OSError):
        write_png(tmp_path / "missing" / "a.png", image)
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(OSError, match="directory"):
        write_png(tmp_path / "folder.png", image)
    assert [p.name for p in tmp_path.iterdir()] == ["folder.png"]


@pytest.mark.parametrize("image", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3)), np.zeros((0, 4, 3), np.uint8)])
def test_other_arrays_are_refused(image):
    with pytest.raises(ValueError, match="picture"):
        encode_png(image)
