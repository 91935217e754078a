"""A progress bar where somebody watches."""

import sys
from collections.abc import Iterable
from typing import Any


def bar(steps: Iterable[Any], text: str, *, quiet: bool = False, total: float | None = None) -> Iterable[Any]:
    """The steps, with a bar on the screen while they are taken; `total` of them if they cannot be counted."""
    if quiet or not sys.stderr.isatty():
        return steps
    from rich.console import Console
    from rich.progress import track

    return track(steps, description=text, total=total, console=Console(stderr=True), transient=True)
