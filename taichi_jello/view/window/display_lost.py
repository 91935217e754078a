"""When the screen goes away under a window: what must be kept is kept, one line says so, and the process ends.

Without its server Xlib ends the process, and GGUI aborts it. Neither comes back to Python, but both call a handler
first.
"""

import contextlib
import ctypes
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from typing import Any

STATUS = 2
HANDLER = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)


class LastWords:
    """From when it is made until close(), a lost window calls `keep`, whose words are told, and ends the process with
    STATUS. `gone` asks whether the whole screen is. On Linux; elsewhere it does nothing."""

    def __init__(self, keep: Callable[[], str], gone: Callable[[], bool]):
        self._keep, self._gone = keep, gone
        self._stderr = os.dup(2)
        self._aside = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - closed by close()
        self._handler = HANDLER(self._end)  # C keeps no reference to it
        self._libc = self._x11 = None
        if sys.platform.startswith("linux"):
            self._libc = ctypes.CDLL(None)
            self._libc.signal.argtypes, self._libc.signal.restype = [ctypes.c_int, ctypes.c_void_p], ctypes.c_void_p
            self._before = self._libc.signal(signal.SIGABRT, ctypes.cast(self._handler, ctypes.c_void_p))
            with contextlib.suppress(OSError):
                self._x11 = ctypes.CDLL("libX11.so.6")
                self._x11.XSetIOErrorHandler.argtypes = [ctypes.c_void_p]
                self._x11.XSetIOErrorHandler(ctypes.cast(self._handler, ctypes.c_void_p))

    def _end(self, _: Any) -> int:
        """Called by C in the midst of the call that failed: there is no way back."""
        os.dup2(self._stderr, 2)
        keep, self._keep = self._keep, str  # closing what is kept must not come here again
        words = [f"the screen at DISPLAY={os.environ.get('DISPLAY', '')} is gone"]
        try:
            if not self._gone():
                driver = self._written().decode(errors="replace").partition("\n")[0]
                words = [f"the window is lost ({driver})"]
            words.append(keep())
        except Exception as error:
            words.append(str(error))
        os.write(2, f"jello: {'; '.join(filter(None, words))}\n".encode())
        os._exit(STATUS)

    @contextlib.contextmanager
    def hushed(self) -> Iterator[None]:
        """What is written to stderr within is told afterwards, if the process lives: GGUI explains at length that it
        aborts."""
        os.dup2(self._aside.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(self._stderr, 2)
            if self._aside.tell():
                os.write(2, self._written())

    def _written(self) -> bytes:
        self._aside.seek(0)
        written = self._aside.read()
        self._aside.seek(0)
        self._aside.truncate()
        return written

    def close(self) -> None:
        """The window is closed: from now on all is as it was."""
        if self._libc is not None:
            self._libc.signal(signal.SIGABRT, self._before)
        if self._x11 is not None:
            self._x11.XSetIOErrorHandler(None)
        self._aside.close()
        os.close(self._stderr)
