"""PLY, as text and binary: vertices x, y, z and the polygons or triangle strips over them; the rest is skipped."""

import re
import struct
from array import array
from dataclasses import dataclass, field

import numpy as np

from taichi_jello.scene.validation import cut, shown
from taichi_jello.shapes._meshfiles.polygons import MeshProblem, triangulated

TYPES = {"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f"}
TYPES |= {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f"}
TYPES |= {"float64": "d", "double": "d"}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}  # of bytes
INDICES = ("vertex_indices", "vertex_index")
WANTED = {"vertex": ("x", "y", "z"), "face": INDICES, "tristrips": INDICES}
HEADER = re.compile(rb"ply\s(.*?[\r\n])end_header[ \t]*(\r\n|\r|\n|$)", re.DOTALL)
MAX_HEADER = 1_000_000  # bytes
Columns = dict[str, tuple[np.ndarray, np.ndarray]]  # by property: the values of all rows, and how many each row has


@dataclass
class Element:
    """A table of the file. Each property has a name, the type of its values and, for a list, the type of its length."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)


class Text:
    """The rows of a text file, one a line."""

    def __init__(self, data: bytes, at: int):
        first = len(data[:at].splitlines()) + 1
        self.rows = [row for row in enumerate(data[at:].splitlines(), first) if row[1].strip()]
        self.next, self.words, self.taken = 0, [b""], 0

    def begin_row(self) -> None:
        self.words = self.rows[self.next][1].split() if self.next < len(self.rows) else []
        self.next, self.taken = self.next + 1, 0

    def take(self, kind: str, count: int) -> list[float]:
        """The next numbers of the row. Raises ValueError or IndexError."""
        words = self.words[self.taken : self.taken + count]
        self.taken += count
        if len(words) < count or count < 0:
            raise IndexError
        return list(map(float if kind in "fd" else int, words))

    def place(self, element: Element, first: int, row: int) -> str:
        """Of a row of an element that begins with row `first` of the file."""
        return f"line {self.rows[first + row][0]}" if first + row < len(self.rows) else "the end of the file"


class Binary:
    """The rows of a binary file."""

    def __init__(self, data: bytes, at: int, order: str):
        self.data, self.at, self.order, self.next = data, at, order, 0

    def begin_row(self) -> None:
        self.next += 1

    def take(self, kind: str, count: int) -> tuple[float, ...]:
        """The next numbers of the row. Raises struct.error."""
        values = struct.unpack_from(f"{self.order}{count}{kind}", self.data, self.at)
        self.at += count * struct.calcsize(f"={kind}")
        return values

    def place(self, element: Element, first: int, row: int) -> str:
        return f"{element.name} {row}"

    def uniform(self, element: Element) -> Columns | None:
        """The columns of an element whose lists are of the same length in all rows, read at once; else None."""
        start, columns = self.at, []
        for name, kind, length in element.properties:
            count = int(self.take(length, 1)[0]) if length else 1
            columns += [("", self.order + length, 1, count)] * bool(length) + [(name, self.order + kind, count, 0)]
            self.take(kind, count)
        self.at = start
        row = np.dtype([(str(k), kind, (count,)) for k, (_, kind, count, _) in enumerate(columns)])
        if element.count * row.itemsize > len(self.data) - start:
            return None
        table = np.frombuffer(self.data, row, element.count, start)
        if any(not name and (table[str(k)] != length).any() for k, (name, _, _, length) in enumerate(columns)):
            return None
        self.at, self.next = start + table.nbytes, self.next + element.count
        counts = [np.full(element.count, count) for _, _, count, _ in columns]
        return {name: (table[str(k)].ravel(), counts[k]) for k, (name, *_) in enumerate(columns)}


def read(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Points (V, 3) and triangles (T, 3). Raises MeshProblem naming the place and what was expected."""
    header = HEADER.match(data, 0, MAX_HEADER)
    if not header:
        raise MeshProblem("line 1: expected ply, and a header up to end_header")
    order, elements = _header(header[1].decode(errors="replace"))
    source = Binary(data, header.end(), order) if order else Text(data, header.end())
    firsts, tables = {}, {}
    for element in elements:
        firsts[element.name], tables[element.name] = source.next, _columns(source, element)
    axes = [tables["vertex"][axis][0] for axis in WANTED["vertex"] if axis in tables.get("vertex", ())]
    if len(axes) < 3 or len({len(axis) for axis in axes}) > 1:
        raise MeshProblem("expected an element vertex with numbers x, y and z in the header")
    points, triangles = np.stack(axes, axis=1).astype(float), [np.empty((0, 3), np.int64)]
    for element in (element for element in elements if element.name in ("face", "tristrips")):
        for corners, counts in (columns for name, columns in tables[element.name].items() if name in INDICES):
            strips, corners, ends = element.name == "tristrips", corners.astype(np.int64), np.cumsum(counts)
            bad = np.flatnonzero((corners >= len(points)) | (corners < -1 * strips))
            few = np.flatnonzero(counts < 3 * (not strips))
            if len(bad) or len(few):
                row = int(np.searchsorted(ends, bad[0], side="right") if len(bad) else few[0])
                expected = f"expected at least three vertices, got {counts[row]}"
                if len(bad):
                    expected = f"expected a vertex from 0 to {len(points) - 1}, got {corners[bad[0]]}"
                raise MeshProblem(f"{source.place(element, firsts[element.name], row)}: {expected}")
            triangles += [_strips(corners, ends) if strips else triangulated(points, corners, counts)]
    return points, np.concatenate(triangles)


def _header(text: str) -> tuple[str, list[Element]]:
    """The order of bytes, "" for text, and the elements."""
    order: str | None = None
    elements: list[Element] = []
    for number, line in enumerate(text.splitlines(), 2):
        try:
            match line.split():
                case ["format", word, _]:
                    order = ORDERS[word]
                case ["element", name, count] if int(count) >= 0 and all(name != other.name for other in elements):
                    elements.append(Element(name, int(count)))
                case ["property", "list", length, kind, name] if TYPES[length] not in "fd":
                    elements[-1].properties.append((name, TYPES[kind], TYPES[length]))
                case ["property", kind, name]:
                    elements[-1].properties.append((name, TYPES[kind], ""))
                case ["comment" | "obj_info", *_] | []:
                    pass
                case _:
                    raise ValueError
        except (KeyError, ValueError, IndexError):
            raise MeshProblem(f"line {number}: expected a line of a PLY header, got {shown(line)}") from None
    if order is None:
        raise MeshProblem(f"line 2: expected format and one of {', '.join(ORDERS)}")
    return order, elements


def _columns(source: Text | Binary, element: Element) -> Columns:
    """The properties of an element that a mesh needs."""
    names = [name for name, *_ in element.properties if name in WANTED.get(element.name, ())]
    if not element.properties or not element.count:
        return {name: (np.empty(0), np.empty(0, np.int64)) for name in names}
    first = source.next
    values = {name: array("d") for name in names}
    counts = {name: array("q") for name in names}
    try:
        found = source.uniform(element) if isinstance(source, Binary) else None
        for _ in range(0 if found else element.count):
            source.begin_row()
            for name, kind, length in element.properties:
                count = int(source.take(length, 1)[0]) if length else 1
                numbers = source.take(kind, count)
                if name in values:
                    values[name].extend(numbers)
                    counts[name].append(count)
    except (ValueError, IndexError, OverflowError, struct.error):
        expected = f"{' '.join(name for name, *_ in element.properties)} of {element.count} rows of {element.name}"
        place = source.place(element, first, max(0, source.next - first - 1))
        raise MeshProblem(f"{place}: expected {cut(expected, 200)}") from None
    return found or {name: (np.array(values[name]), np.array(counts[name])) for name in names}


def _strips(corners: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(T, 3) triangles of strips: each vertex forms one with the two before it. -1 and each end begin a new strip."""
    corners = np.insert(corners, ends, -1)
    place = np.arange(len(corners))
    since = place - np.maximum.accumulate(np.where(corners < 0, place, -1))  # 1, 2, 3 … along a strip
    third = np.flatnonzero((since >= 3) & (corners >= 0))
    a, b, c = corners[third - 2], corners[third - 1], corners[third]
    turned = since[third] % 2 == 0  # every second one faces the other way
    return np.stack([np.where(turned, b, a), np.where(turned, a, b), c], axis=1)
