"""The loop that keeps the window going: listen, let time pass, draw."""

import os
import signal
import threading
import time
from collections.abc import Callable
from typing import Any

from taichi_jello.run.simulation import Simulation
from taichi_jello.scene.description import Scene
from taichi_jello.support import interrupt
from taichi_jello.view.window.screen import Screen
from taichi_jello.view.window.viewer import Viewer


def leave_when_asked(viewer: Viewer) -> dict[int, Any]:
    """A closed terminal or a system that shuts down ends the window as Esc does. The signals, and what they did."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    names = ("SIGTERM", "SIGHUP")
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]

    def leave(*_: Any) -> None:
        viewer.leaving = True

    return {number: signal.signal(number, leave) for number in numbers}


def play(
    simulation: Any,
    size: tuple[int, int] = (1280, 720),
    color: str = "",
    folder: str | os.PathLike[str] = ".",
    seconds: float | None = None,
    make: Callable[[Scene], Any] = Simulation,
) -> None:
    """Show a simulation in a window until Esc or its close button, or until `seconds` of the simulation are
    over.

    color: one of COLORS, by default the scene's; folder: where P saves pictures; make: makes a simulation of the scene
    that N goes to. Raises RuntimeProblem without a Vulkan driver or a screen. A film that is not ended then is ended
    and printed.
    """
    viewer = Viewer(simulation, color, folder, make, size)
    screen = Screen(size, simulation.scene.title or "jello", viewer.keep)
    screen.tell(viewer, "compiling ...")  # what draws
    before: float | None = None  # what took its time between two frames counts as none
    asked = leave_when_asked(viewer)
    try:
        while screen.running and not viewer.leaving and (seconds is None or viewer.simulation.time < seconds):
            interrupt.look()
            screen.listen(viewer)
            now = time.perf_counter()
            viewer.advance(0.0 if before is None else now - before)
            before = now
            viewer.update()
            screen.show(viewer)
            if viewer.catch_up():
                before = None
    finally:
        for number, handler in asked.items():
            signal.signal(number, handler)
        if viewer.filming:
            viewer.stop_film()
            print(viewer.notice, flush=True)
        screen.close()
