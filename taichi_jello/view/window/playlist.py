"""Steps through the demos."""

from collections.abc import Callable
from typing import Any

from taichi_jello import scenefiles
from taichi_jello.scene.description import Scene
from taichi_jello.view.render.renderers import Run

Make = Callable[[Scene], Run]


def scenes() -> list[Scene]:
    """The demos that load; some need packages that may not be installed."""
    found = []
    for name in scenefiles.demos():
        try:
            found.append(scenefiles.load(name))
        except (ValueError, ImportError, OSError):
            continue
    return found


class Playlist:
    """The simulations of the demos, created by `make`. Each is created only once, since Taichi never frees compiled
    code."""

    def __init__(self, make: Make):
        self._make = make
        self._made: dict[str, tuple[Run, str, dict[str, Any]]] = {}  # by title, with the initial method and tuning

    def following(self, now: Scene) -> Run:
        """The demo after the scene `now`, or the first one if `now` is no demo. Skips those that fail. Raises
        ValueError if none works."""
        found = scenes()
        current = next((k for k, scene in enumerate(found) if scene.title == now.title), -1)
        for scene in found[current + 1 :] + found[: current + 1]:
            try:
                return self._restarted(scene)
            except ValueError:
                continue
        raise ValueError("no demo was found")

    def _restarted(self, scene: Scene) -> Run:
        if scene.title not in self._made:
            simulation = self._make(scene)
            self._made[scene.title] = simulation, simulation.method, dict(simulation.tuning)
            return simulation
        simulation, method, tuning = self._made[scene.title]
        simulation.tune(**tuning)
        if simulation.method != method:
            simulation.change_method(method)
        simulation.reset()
        return simulation
