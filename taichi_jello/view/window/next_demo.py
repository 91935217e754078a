"""The demos one after the other, for a window that is asked for the next."""

from collections.abc import Callable, Iterator
from typing import Any

from taichi_jello import scenefiles
from taichi_jello.scene.description import Scene


def scenes() -> Iterator[Scene]:
    """The demos that can be loaded here: some need packages that may be missing."""
    for name in scenefiles.demos():
        try:
            yield scenefiles.load(name)
        except (ValueError, ImportError, OSError):
            continue


class Playlist:
    """Simulations of the demos, as `make` makes them of their scenes. Each is made once, since Taichi gives back no
    compiled code; when its turn comes again, it is as it was then."""

    def __init__(self, make: Callable[[Scene], Any]):
        self._make = make
        self._made: dict[str, tuple[Any, str, dict[str, Any]]] = {}  # with the first method and tuning, by title

    def following(self, now: Scene) -> Any:
        """The demo after the scene `now`, or the first; the one after that if making it raises ValueError. Raises
        ValueError if no demo works."""
        found = list(scenes())
        same = next((k for k, scene in enumerate(found) if scene.title == now.title), -1)
        for scene in found[same + 1 :] + found[: same + 1]:
            try:
                return self._anew(scene)
            except ValueError:
                continue
        raise ValueError("no demo was found")

    def _anew(self, scene: Scene) -> Any:
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
