"""The main loop of the window: read events, advance time, draw."""

import signal
import threading
import time
from pathlib import Path
from typing import Any

from taichi_jello.run.simulation import Simulation
from taichi_jello.support import interrupt
from taichi_jello.view.render.renderers import Run, Size
from taichi_jello.view.window.playlist import Make
from taichi_jello.view.window.screen import Screen
from taichi_jello.view.window.viewer import Viewer


def leave_on_signals(viewer: Viewer) -> dict[int, Any]:
    """Quit as if by Esc when the terminal closes or the system shuts down. Returns the previous handlers."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]

    def leave(*_: Any) -> None:
        viewer.leaving = True

    return {number: signal.signal(number, leave) for number in numbers}


def play(
    simulation: Run,
    size: Size = (1280, 720),
    folder: str | Path = ".",
    seconds: float | None = None,
    make: Make = Simulation,
    renderer: str = "auto",
) -> None:
    """Show a simulation in a window until the user quits or `seconds` of simulated time have passed.
    make: creates the simulation of a demo, for the key N; folder: where pictures and films go; renderer: auto, ggui or
    raster. A film that is still running is finished, and a message printed.
    Raises RuntimeProblem without a Vulkan driver or a display."""
    viewer = Viewer(simulation, folder, make, size)
    screen = Screen(size, simulation.scene.title or "jello", viewer.keep, renderer)
    screen.write_alone(viewer, "compiling ...")
    last: float | None = None  # None after slow work, whose time does not count as simulated time
    handlers = leave_on_signals(viewer)
    try:
        viewer.update()
        screen.show(viewer)  # the first call compiles
        while screen.running and not viewer.leaving and (seconds is None or viewer.simulation.time < seconds):
            interrupt.look()
            screen.listen(viewer)
            now = time.perf_counter()
            viewer.advance(0.0 if last is None else now - last)
            last = now
            viewer.update()
            screen.show(viewer)
            if viewer.do_pending():
                screen.forget_keys()
                last = None
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if viewer.filming:
            print(viewer.pictures.stop_film(), flush=True)
        screen.close()
