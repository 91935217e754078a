"""Springs as lines, coloured by force, strain or family."""

from dataclasses import dataclass

import numpy as np
import taichi as ti

from taichi_jello.body import FAMILY_NAMES, Body
from taichi_jello.view import palette
from taichi_jello.view.primitives import WIDTH, Lines
from taichi_jello.view.shading import TOWARDS_EYE, Array1, Array2, Index2, clip, put, row

MOST = 95.0  # percentile of the loads that the scale reaches: one torn corner must not dim the rest
FLOOR = 0.005  # strain below which a scale never shrinks: rounding noise in a resting body stays blue
SHADES = 256
FEW = 600  # springs up to which a body is clear enough to show them all


@dataclass(frozen=True)
class Key:
    """What the colours of one frame mean. `most` is in `unit` at the end of the ramp; `names` replaces the
    ramp."""

    title: str = ""
    unit: str = ""
    most: float = 0.0
    ramp: np.ndarray | None = None
    names: tuple[tuple[str, np.ndarray], ...] = ()


def ramp_table() -> np.ndarray:
    """(SHADES, 3) float32 from no load to the most."""
    at = np.linspace(0.0, 1.0, SHADES)
    knots = np.linspace(0.0, 1.0, len(palette.FORCE_RAMP))
    return np.stack([np.interp(at, knots, channel) for channel in palette.FORCE_RAMP.T], 1).astype(np.float32)


def round_up(value: float) -> float:
    """The next of 1, 2 and 5 times a power of ten: a scale that moves in steps does not flicker."""
    if not np.isfinite(value) or value <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if value <= step * power * (1.0 + 1e-6)))


@ti.kernel
def stretch(x: Array2, v: Array2, pairs: Index2, coefficients: Array2, strain: ti.i32, ends: Array2, load: Array1):
    """Both drawn ends of every spring, and its load: |k (|d| - R) + c v·d/|d|| [N], or the strain ||d| - R| /
    R."""
    ti.loop_config(block_dim=128)
    for s in range(pairs.shape[0]):
        i, j = pairs[s, 0], pairs[s, 1]
        a, b = row(x, i), row(x, j)
        put(ends, 2 * s, a)
        put(ends, 2 * s + 1, b)
        d = b - a
        length = d.norm()
        rest = coefficients[s, 0]
        along = (row(v, j) - row(v, i)).dot(d) / ti.max(length, ti.f32(1e-12))
        load[s] = ti.abs(coefficients[s, 1] * (length - rest) + coefficients[s, 2] * along)
        if strain == 1:
            load[s] = ti.abs(length - rest) / ti.max(rest, ti.f32(1e-12)) * ti.cast(rest > 0.0, ti.f32)


def layers(body: Body) -> np.ndarray:
    """(S,) 0 for springs that tell a body's shape, 1 for the others on its surface and 2 for those inside.

    In a dense body the diagonals inside would hide all else, and bend springs lie on structural ones."""
    if len(body.springs) <= FEW or not np.any(body.family == 0):
        return np.zeros(len(body.springs), np.int64)
    outer = np.zeros(len(body), bool)
    outer[body.surface] = True
    return np.where(np.isin(body.family, (0, 3)), 0, np.where(outer[body.springs].all(1), 1, 2))


class Springs:
    """The springs of a body as `lines`, and `key`, what their colours mean in this frame.

    Of a dense body only layer 0 is drawn, by family also layer 1, and all when `everything` is set; the scale
    is that of the springs drawn."""

    def __init__(self, body: Body):
        layer = layers(body)
        order = np.argsort(layer, kind="stable")
        self.pairs = np.ascontiguousarray(body.springs[order], np.int32)
        self.coefficients = np.stack([body.rest_length, body.stiffness, body.damping], 1)[order].astype(np.float32)
        self.families = np.minimum(body.family, 3).astype(np.intp)[order]
        self.everything = False
        self.load = np.zeros(len(self.pairs), np.float32)
        self.lines = Lines.empty(0, WIDTH)
        self.key = Key()
        self._counts = np.searchsorted(layer[order], [1, 2])
        self._ends = Lines.empty(len(self.pairs), WIDTH)
        self._table = ramp_table()
        typical = np.median(body.rest_length * body.stiffness) if len(self.pairs) else 0.0
        self._floor = {"force": FLOOR * float(typical), "strain": FLOOR}

    def update(self, x: np.ndarray, v: np.ndarray, look: np.ndarray, color: str) -> None:
        stretch(x, v, self.pairs, self.coefficients, int(color == "strain"), self._ends.x, self.load)
        shown = len(self.pairs) if self.everything else int(self._counts[1 if color == "family" else 0])
        self.lines = Lines(self._ends.x[: 2 * shown], self._ends.rgb[: 2 * shown], WIDTH)
        clip(self.lines.x, look, TOWARDS_EYE)
        if color == "family":
            rgb, self.key = self._by_family(self.families[:shown])
        elif color == "plain":
            rgb, self.key = palette.PLAIN, Key()
        else:
            rgb, self.key = self._by_load(color, self.load[:shown])
        self.lines.rgb.reshape(-1, 2, 3)[:] = rgb

    def _by_load(self, color: str, load: np.ndarray) -> tuple[np.ndarray, Key]:
        load = np.where(np.isfinite(load), load, np.float32(np.inf))
        rank = min(len(load) - 1, int(len(load) * MOST / 100.0))
        most = round_up(max(float(np.partition(load, rank)[rank]), self._floor[color]))
        shade = np.minimum(load * ((SHADES - 1) / most), SHADES - 1).astype(np.intp)
        ramp = self._table
        named = Key("spring force", "N", most, ramp) if color == "force" else Key("strain", "%", 100.0 * most, ramp)
        return ramp[shade][:, None], named

    def _by_family(self, families: np.ndarray) -> tuple[np.ndarray, Key]:
        names = tuple((FAMILY_NAMES[f], palette.FAMILIES[f]) for f in np.unique(families))
        return palette.FAMILIES[families][:, None], Key("spring family", names=names)
