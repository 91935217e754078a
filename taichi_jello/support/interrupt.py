"""Ctrl-C that is not lost.

Python raises KeyboardInterrupt wherever the program happens to be, and Taichi has `except:` around its decorators and
the reading of every kernel's source: there it vanishes (2 of 20 films went on, on a busy machine). So it is noted as
well as raised, and whatever goes on for long looks for the note once a frame.
"""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_asked = False


def asked() -> bool:
    """Whether somebody wants the program to end."""
    return _asked


def look() -> None:
    """Raise KeyboardInterrupt if one was raised before and got lost."""
    if _asked:
        raise KeyboardInterrupt


def obey(*_: Any) -> None:
    """A signal's handler: note it, and raise KeyboardInterrupt."""
    _note()
    raise KeyboardInterrupt


def _note(*_: Any) -> None:
    global _asked
    _asked = True


def forget() -> None:
    """What was asked for is done."""
    global _asked
    _asked = False


@contextmanager
def _handled(handler: Callable[..., None]) -> Iterator[None]:
    """Within, Ctrl-C does this, if it would have raised KeyboardInterrupt."""
    free = threading.current_thread() is threading.main_thread()
    if not free or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
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
def heeded() -> Iterator[None]:
    """Within, Ctrl-C is noted and raised."""
    with _handled(obey):
        yield


@contextmanager
def put_off() -> Iterator[None]:
    """Within, Ctrl-C is only noted; it is raised at the end."""
    with _handled(_note):
        yield
        look()


@contextmanager
def importing() -> Iterator[None]:
    """Within, modules are imported: Ctrl-C is put off, since Taichi's decorators lose it. If nobody catches it then, it
    ends the program with one line and status 130."""
    try:
        with put_off():
            yield
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
    if not hasattr(sys, "ps1"):  # at a prompt Python goes on
        raise SystemExit(130)
