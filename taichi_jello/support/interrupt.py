"""Ctrl-C that is not lost.

Python raises KeyboardInterrupt at any point, and Taichi has bare `except:` clauses that swallow it. So Ctrl-C is also
noted, and long loops check the note once a frame.
"""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_noted = False


def asked() -> bool:
    """Whether Ctrl-C was pressed."""
    return _noted


def look() -> None:
    """Raise KeyboardInterrupt if Ctrl-C was pressed, even if an earlier one was swallowed."""
    if _noted:
        raise KeyboardInterrupt


def obey(*_: Any) -> None:
    """Signal handler: note it and raise KeyboardInterrupt."""
    _note()
    raise KeyboardInterrupt


def _note(*_: Any) -> None:
    global _noted
    _noted = True


def forget() -> None:
    """Clear the note."""
    global _noted
    _noted = False


@contextmanager
def heeded(handler: Callable[..., None] = obey) -> Iterator[None]:
    """Within, Ctrl-C calls `handler` instead of Python's own, if that is installed: by default it is noted and
    raised."""
    in_main_thread = threading.current_thread() is threading.main_thread()
    if not in_main_thread or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    forget()
    signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        forget()


@contextmanager
def importing() -> Iterator[None]:
    """For imports, in which Taichi's decorators would swallow Ctrl-C: it is raised at the end. Uncaught, it ends the
    program with one line and status 130."""
    try:
        with heeded(_note):
            yield
            look()
    except KeyboardInterrupt:
        sys.excepthook = _in_one_line
        raise


def _in_one_line(kind: type[BaseException], error: BaseException, trace: Any) -> None:
    """As sys.excepthook, for KeyboardInterrupt."""
    sys.excepthook = sys.__excepthook__
    if not issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, error, trace)
        return
    print("jello: stopped while it was starting", file=sys.stderr)
    if not hasattr(sys, "ps1"):  # Python goes on at a prompt
        raise SystemExit(130)
