"""The top of the colour scale: kept for a whole film, unless loads exceed it, so that colours stay comparable."""

import numpy as np

from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene

SHARE = 0.95  # quantile of the loads that the scale covers, so that one extreme corner does not dim the rest
MIN_STRAIN = 0.005  # least top of the scale, so that rounding noise in a body at rest stays blue


def round_up(value: float) -> float:
    """Round up to 1, 2 or 5 times a power of ten."""
    if not np.isfinite(value) or value <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if value <= step * power * (1.0 + 1e-6)))


def expected(scene: Scene, body: Body) -> dict[str, float]:
    """The expected force [N] and strain of springs, by the names in COLORS: the largest over all jellos, and at least
    that of MIN_STRAIN. For each jello it is the larger of two estimates. One spreads the weight over the springs of a
    cross-section. The other, for solids only, spreads the energy E of motion and fall equally over the S springs of
    stiffness k: F²/2k = E/S. Sheets and ropes fold instead."""
    gravity = float(np.linalg.norm(scene.gravity))
    floor = max((level for each in scene.collider if (level := each.floor()) is not None), default=None)
    solids, skinned = np.unique(body.jello[body.cells]), np.unique(body.jello[body.surface])
    found = {"force": 0.0, "strain": MIN_STRAIN}
    for number in np.unique(body.jello[body.springs[:, 0]]):
        own, springs = body.jello == number, body.jello[body.springs[:, 0]] == number
        mass, count = body.mass[own], int(own.sum())
        stiffness, length = float(np.median(body.stiffness[springs])), float(np.median(body.rest_length[springs]))
        weight = gravity * float(mass.sum())
        fall = 0.0 if floor is None else max(float(body.x[own, 1].min()) - floor, 0.0)
        energy = (weight * fall + 0.5 * float(mass @ np.square(body.v[own]).sum(1))) * (number in solids)
        across = count ** (2.0 / 3.0) if number in solids else count**0.5 if number in skinned else 1.0
        force = max(weight / across, np.sqrt(2.0 * energy * stiffness / springs.sum()), MIN_STRAIN * stiffness * length)
        found["force"] = max(found["force"], float(force))
        found["strain"] = max(found["strain"], float(force) / max(stiffness * length, 1e-30))
    return found


class Scale:
    """The value at the top of the scale, by the names in COLORS: `given` by the scene, in the legend's unit, or else
    estimated, and raised when loads exceed the estimate."""

    def __init__(self, scene: Scene, body: Body):
        scale = scene.camera.scale
        self.given = None if isinstance(scale, str) else scale
        self._first = {name: round_up(load) for name, load in expected(scene, body).items()}
        self.restart()

    def restart(self) -> None:
        """Return to the initial estimate, for a new film."""
        self._most = dict(self._first)

    def of(self, name: str, load: np.ndarray, per: float = 1.0) -> float:
        """The top of the scale for the current loads (S,), none of them NaN, and all earlier ones; per: the factor from
        loads to the legend's unit."""
        if self.given is not None:
            return self.given / per
        if len(load):
            share = 1.0 if name == "stiffness" else SHARE
            rank = min(len(load) - 1, int(len(load) * share))
            reached = float(np.partition(load, rank)[rank])
            self._most[name] = max(self._most.get(name, 0.0), round_up(reached) if reached > 0.0 else 0.0)
        return self._most.get(name) or 1.0
