"""The demos one after the other, for a window that is asked for the next."""

from collections.abc import Callable, Iterator
from typing import Any

from taichi_jello import sceneio
from taichi_jello.scene import Scene


def scenes() -> Iterator[Scene]:
    """The demos that can be loaded here: some need packages that may be missing."""
    for name in sceneio.demos():
        try:
            yield sceneio.load(name)
        except (ValueError, ImportError, OSError):
            continue


def following(now: Scene, make: Callable[[Scene], Any]) -> Any:
    """What `make` makes of the demo after the scene `now`, or of the first; of the one after that if it raises
    ValueError. Raises ValueError if no demo works."""
    found = list(scenes())
    same = next((k for k, scene in enumerate(found) if scene.title == now.title), -1)
    for scene in found[same + 1 :] + found[: same + 1]:
        try:
            return make(scene)
        except ValueError:
            continue
    raise ValueError("no demo was found")
