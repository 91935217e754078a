"""PNG files."""

import os
import struct
import tempfile
import zlib
from itertools import chain, count
from pathlib import Path

import numpy as np

ZLIB_LEVEL = 1  # a seventh of the time of the default, for a file a quarter larger


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def encode_png(image: np.ndarray) -> bytes:
    """The bytes of a PNG file of a picture (height, width, 3) uint8. Raises ValueError for another array."""
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or 0 in image.shape:
        raise ValueError(f"expected a picture (height, width, 3) uint8, got {image.shape} {image.dtype}")
    height, width, _ = image.shape
    rows = np.zeros((height, 1 + 3 * width), np.uint8)  # each row begins with filter type 1: left neighbour
    rows[:, 0] = 1
    flat = image.reshape(height, 3 * width)
    rows[:, 1:4] = flat[:, :3]
    rows[:, 4:] = flat[:, 3:] - flat[:, :-3]
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = _chunk(b"IDAT", zlib.compress(rows.data, ZLIB_LEVEL))
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", header) + data + _chunk(b"IEND", b"")


def write_png(path: str | os.PathLike[str], image: np.ndarray) -> None:
    """Write a picture (height, width, 3) uint8 to `path`, as a whole or, with an OSError, not at all."""
    path = Path(path)
    data = encode_png(image)
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a directory")
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def unused(path: Path) -> Path:
    """The first of x.png, x-2.png, x-3.png … that does not exist."""
    names = chain([path.name], (f"{path.stem}-{again}{path.suffix}" for again in count(2)))
    return next(path.with_name(name) for name in names if not path.with_name(name).exists())
