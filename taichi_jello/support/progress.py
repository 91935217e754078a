"""A progress bar on terminals."""

import sys
from collections.abc import Iterable
from typing import Any


def bar(steps: Iterable[Any], text: str, *, quiet: bool = False, total: float | None = None) -> Iterable[Any]:
    """The steps, with a progress bar while they are iterated; total: their number if they have no length."""
    if quiet or not sys.stderr.isatty():
        return steps
    from rich.console import Console
    from rich.progress import track

    return track(steps, description=text, total=total, console=Console(stderr=True), transient=True)
