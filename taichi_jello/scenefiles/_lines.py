"""The lines of the keys of a TOML file, which the standard library's reader does not give."""

import re
import tomllib
from typing import Any

HEADER = re.compile(r"\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(?:#.*)?$")
KEY = re.compile(r"""\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[\w-]+|"[^"]*"|'[^']*'))*)\s*=(.*)""")
TEXT = re.compile(r"""\"\"\".*?\"\"\"|'''.*?'''|\"\"\".*|'''.*|"(?:\\.|[^"\\])*"|'[^']*'|#.*""")
MULTILINE = ('"""', "'''")  # quotes


def _parts(dotted: str) -> tuple[str, ...]:
    """The names of a dotted key, some of them quoted and with escapes."""
    parts: list[str] = []
    table: Any = tomllib.loads(f"{dotted} = 0")
    while isinstance(table, dict):
        ((name, table),) = table.items()
        parts.append(name)
    return tuple(parts)


def key_lines(text: str) -> dict[tuple[str, ...], int]:
    """The line, counted from 1, of every table and key of a valid TOML text; tables of an array by their index."""
    found: dict[tuple[str, ...], int] = {}
    count: dict[tuple[str, ...], int] = {}  # tables so far of each array
    table: tuple[str, ...] = ()
    depth, until = 0, ""  # open brackets; quotes that end an open multi-line string
    for number, line in enumerate(text.split("\n"), 1):
        if until:
            _, closed, line = line.partition(until)
            if not closed:
                continue
            until = ""
        elif depth == 0 and (header := HEADER.match(line)):
            table = ()
            *above, last = _parts(header[2])
            for part in above:
                table += (part,)
                table += (str(count[table] - 1),) if table in count else ()
            table += (last,)
            if header[1] == "[[":
                count[table] = count.get(table, 0) + 1
                found.setdefault(table, number)
                table += (str(count[table] - 1),)
            found[table] = number
            continue
        elif depth == 0 and (key := KEY.match(line)):
            parts = _parts(key[1])
            found.setdefault(table + parts, number)
            found.setdefault(table + parts[:1], number)
            line = key[2]
        texts = TEXT.findall(line)
        if texts and texts[-1][:3] in MULTILINE and (len(texts[-1]) < 6 or texts[-1][:3] != texts[-1][-3:]):
            until = texts[-1][:3]
        rest = TEXT.sub("", line)
        depth += sum(rest.count(c) for c in "[{") - sum(rest.count(c) for c in "]}")
    return found


def line_of(text: str, key: str) -> int | None:
    """The line of `key`, such as jello.0.mass, or of the innermost table or key that contains it."""
    path, lines = tuple(key.split(".")), key_lines(text)
    while path and path not in lines:
        path = path[:-1]
    return lines.get(path)


def deepest_line(text: str) -> int:
    """The line with the most open brackets, counted without regard to quotes."""
    depth, deepest, found = 0, 0, 1
    for number, line in enumerate(text.split("\n"), 1):
        for bracket in re.findall(r"[\[\]{}]", line):
            depth += 1 if bracket in "[{" else -1
            if depth > deepest:
                deepest, found = depth, number
    return found


def longest_number_line(text: str) -> int:
    """The line of the longest number."""
    lengths = [max(map(len, re.findall(r"\d[\d_]*", line)), default=0) for line in text.split("\n")]
    return lengths.index(max(lengths)) + 1
