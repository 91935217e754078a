"""Runs the studies and puts their tables into a README: `python -m taichi_jello.studies shots README.md`.

Each study writes NAME.json and NAME.png to the folder. A table is between the lines `<!-- NAME -->` and `<!-- end -->`.
"""

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from taichi_jello.app.cli import main as jello
from taichi_jello.app.options import studies
from taichi_jello.studies import speed
from taichi_jello.studies._accuracy.conclusions import fastest
from taichi_jello.support.wording import plain

END = "<!-- end -->"
LONG = ("stress",)  # in full it takes a quarter of an hour: here always with --quick
ERRORS = (1e-2, 1e-3, 1e-4, 1e-5)  # the table's columns


def accuracy_table(results: dict[str, Any]) -> str:
    """The fastest method to each error, by case, as Markdown."""
    heads = [
        "case",
        *(f"to {100 * error:g} % of the edge" for error in ERRORS),
        "float32 comes to",
        "reference known to",
    ]
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for case in results["cases"]:
        cells = [f"{case['case']}: {case['shows']}"]
        for error in ERRORS:
            best = fastest(case, error)
            cells.append(f"{best['method']} {best['precision']}, {plain(best['ms_a_frame'])} ms" if best else "-")
        cells.append(f"{case['float32_floor']:.0e}" if case["float32_floor"] else "-")
        lines.append("| " + " | ".join([*cells, f"{case['disagreement']:.0e}"]) + " |")
    return "\n".join(lines)


TABLES: dict[str, Callable[[dict[str, Any]], str]] = {
    "accuracy": accuracy_table,
    "speed": lambda results: f"```\n{speed.text(results)}\n```",
}


def put_table(readme: Path, name: str, table: str) -> None:
    """Replace the text between the marks. Raises ValueError if the marks are missing."""
    page = readme.read_text(encoding="utf-8")
    before, begin, rest = page.partition(f"<!-- {name} -->")
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{readme}: expected the lines <!-- {name} --> and {END}")
    readme.write_text(f"{before}{begin}\n{table}\n{END}{after}", encoding="utf-8")


def main(arguments: list[str]) -> int:
    known = studies()
    parser = argparse.ArgumentParser(prog="python -m taichi_jello.studies", description="Studies as JSON and pictures.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("readme", type=Path, nargs="?")
    parser.add_argument("--only", action="append", choices=list(known), help="one study, may be given again")
    parser.add_argument("--method", metavar="NAMES", help="only these, separated by commas")
    parser.add_argument("--quick", action="store_true", help="reduced ladders")
    chosen = parser.parse_args(arguments)
    for name in chosen.only or known:
        json_path = chosen.folder / f"{name}.json"
        options = ["--json", str(json_path), *["--quick"] * (chosen.quick or name in LONG)]
        if hasattr(known[name], "plot"):
            options += ["--plot", str(chosen.folder / f"{name}.png")]
        if chosen.method:
            options += ["--method", chosen.method]
        status = jello(["study", name, *options])
        if status:
            return status
        if chosen.readme and name in TABLES:
            put_table(chosen.readme, name, TABLES[name](json.loads(json_path.read_text(encoding="utf-8"))))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
