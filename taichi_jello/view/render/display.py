"""The X server that a window needs: whether it answers, and a clean end when it goes away under a window."""

import contextlib
import ctypes
import os
import select
import signal
import sys
from collections.abc import Callable, Iterator
from typing import Any

STATUS = 2  # of a process whose window was lost
HANDLER = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)
_connections: dict[str, int] = {}  # by DISPLAY


def _x11() -> Any:
    """libX11. Raises OSError without it."""
    library = ctypes.CDLL("libX11.so.6")
    library.XOpenDisplay.restype = ctypes.c_void_p
    library.XConnectionNumber.argtypes = [ctypes.c_void_p]
    return library


def display_problem() -> str | None:
    """Why no X server can show a window; None if one can, or if this system needs none. The connection stays open: a
    virtual screen restarts when its last client leaves, and ends windows that are just being opened."""
    name = os.environ.get("DISPLAY")
    if not sys.platform.startswith("linux") or name in _connections:
        return None
    if not name:
        return "DISPLAY is not set"
    with contextlib.suppress(OSError):
        connection = _x11().XOpenDisplay(name.encode())
        if connection:
            _connections[name] = connection
            return None
    return f"no screen answers at DISPLAY={name}"


def display_is_gone() -> bool:
    """Whether the X server that answered has left since."""
    connection = _connections.get(os.environ.get("DISPLAY", ""))
    if connection is None:
        return False
    poll = select.poll()
    poll.register(_x11().XConnectionNumber(connection), select.POLLRDHUP)
    return bool(poll.poll(500))  # ms: the window's own connection may notice first


class DisplayGuard:
    """Until close(), a lost window calls `keep`, prints one line that ends with its answer, and exits with STATUS.
    Xlib would exit the process, and GGUI abort it, but both call a C handler first. On Linux; elsewhere no effect."""

    def __init__(self, keep: Callable[[], str]):
        self._keep, self._linux = keep, sys.platform.startswith("linux")
        if self._linux:
            self._stderr, self._aside = os.dup(2), os.memfd_create("stderr")
            self._handler = HANDLER(self._end)  # C keeps no reference
            self._libc = ctypes.CDLL(None)
            self._libc.signal.restype = ctypes.c_void_p
            self._before = self._libc.signal(signal.SIGABRT, self._handler)
            _x11().XSetIOErrorHandler(self._handler)

    def _end(self, _: Any) -> int:
        """Called in the midst of the C call that failed: there is no way back."""
        os.dup2(self._stderr, 2)
        keep, self._keep = self._keep, str  # closing what is kept may fail here again
        words = [f"the screen at DISPLAY={os.environ.get('DISPLAY', '')} is gone"]
        try:
            if not display_is_gone():
                words = [f"the window is lost ({self._written().decode(errors='replace').partition(chr(10))[0]})"]
            words.append(keep())
        except Exception as error:
            words.append(str(error))
        os.write(2, f"jello: {'; '.join(filter(None, words))}\n".encode())
        os._exit(STATUS)

    @contextlib.contextmanager
    def quiet(self) -> Iterator[None]:
        """Delay what is written to stderr until the end, if the process lives: GGUI aborts with a long report."""
        if not self._linux:
            yield
            return
        os.dup2(self._aside, 2)
        try:
            yield
        finally:
            os.dup2(self._stderr, 2)
            os.write(2, self._written())

    def _written(self) -> bytes:
        written = os.pread(self._aside, 1 << 20, 0)
        os.ftruncate(self._aside, 0)
        os.lseek(self._aside, 0, os.SEEK_SET)
        return written

    def close(self) -> None:
        if self._linux:
            self._libc.signal(signal.SIGABRT, ctypes.c_void_p(self._before))
            _x11().XSetIOErrorHandler(None)
            os.close(self._aside)
            os.close(self._stderr)
