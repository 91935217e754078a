"""Where in a TOML file a key is: the standard library's reader does not say."""

import re

HEADER = re.compile(r"\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(?:#.*)?$")
KEY = re.compile(r"""\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[\w-]+|"[^"]*"|'[^']*'))*)\s*=(.*)""")
TEXT = re.compile(r"""\"\"\".*?\"\"\"|'''.*?'''|\"\"\".*|'''.*|"(?:\\.|[^"\\])*"|'[^']*'|#.*""")
OPEN = ('"""', "'''")  # of a text over several lines


def _parts(dotted: str) -> tuple[str, ...]:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))


def key_lines(text: str) -> dict[tuple[str, ...], int]:
    """The line, counted from 1, of every table and key of a valid TOML text; tables of an array by their index."""
    found: dict[tuple[str, ...], int] = {}
    count: dict[tuple[str, ...], int] = {}  # tables of each array until now
    table: tuple[str, ...] = ()
    depth, until = 0, ""  # brackets that are open, quotes that end a text over several lines
    for number, line in enumerate(text.splitlines(), 1):
        if until:
            _, closed, line = line.partition(until)
            if not closed:
                continue
            until = ""
        elif depth == 0 and (header := HEADER.match(line)):
            path: tuple[str, ...] = ()
            *above, last = _parts(header[2])
            for part in above:
                path += (part,)
                path += (str(count[path] - 1),) if path in count else ()
            path += (last,)
            if header[1] == "[[":
                count[path] = count.get(path, 0) + 1
                found.setdefault(path, number)
                path += (str(count[path] - 1),)
            table = path
            found[table] = number
            continue
        elif depth == 0 and (key := KEY.match(line)):
            found.setdefault(table + _parts(key[1]), number)
            line = key[2]
        texts = TEXT.findall(line)
        if texts and texts[-1][:3] in OPEN and (len(texts[-1]) < 6 or texts[-1][:3] != texts[-1][-3:]):
            until = texts[-1][:3]
        rest = TEXT.sub("", line)
        depth += sum(rest.count(c) for c in "[{") - sum(rest.count(c) for c in "]}")
    return found


def line_of(text: str, key: str) -> int | None:
    """The line of `key`, such as jello.0.mass, or of the nearest table or key that holds it."""
    path, lines = tuple(key.split(".")), key_lines(text)
    while path and path not in lines:
        path = path[:-1]
    return lines.get(path)
