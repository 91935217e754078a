"""Time-stepping schemes, one per file, found by looking in this folder."""

import sys

from taichi_jello.physics.integrators._base import Integrator
from taichi_jello.scene.description import SceneError
from taichi_jello.support.plugins import classes


def schemes() -> dict[str, type[Integrator]]:
    """Every scheme by its name."""
    return {scheme.name: scheme for scheme in classes(sys.modules[__name__], Integrator)}


def scheme(name: str) -> type[Integrator]:
    """The scheme called `name`; raises SceneError with the names there are."""
    found = schemes()
    if name not in found:
        raise SceneError("solver.method", f"expected one of {', '.join(found)} or auto, got {name!r}")
    return found[name]
