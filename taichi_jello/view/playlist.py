"""The demos one after the other, for a window that is asked for the next."""

from collections.abc import Iterator
from typing import Any

from taichi_jello import sceneio
from taichi_jello.physics.forces.grab import Grab, with_hand
from taichi_jello.scene import Scene
from taichi_jello.simulation import Simulation


def scenes() -> Iterator[Scene]:
    """The demos that can be loaded here: some need packages that may be missing."""
    for name in sceneio.demos():
        try:
            yield sceneio.load(name)
        except (ValueError, ImportError, OSError):
            continue


def following(now: Any) -> Simulation:
    """The demo after the one that the simulation `now` is, or the first; a hand can grab it if it can grab `now`.

    Raises ValueError if no demo works."""
    found = list(scenes())
    same = next((k for k, scene in enumerate(found) if scene.title == now.scene.title), -1)
    hand = next((force for force in now.scene.force if isinstance(force, Grab)), None)
    for scene in found[same + 1 :] + found[: same + 1]:
        try:
            return Simulation(scene if hand is None else with_hand(scene, hand))
        except ValueError:
            continue
    raise ValueError("no demo was found")
