"""Springs as lines, coloured by force, strain, stiffness or family."""

from dataclasses import dataclass

import numpy as np

from taichi_jello.physics.forces.springs.spring_state import SpringState
from taichi_jello.scene.body import FAMILY_NAMES, Body
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.primitives import WIDTH, Lines
from taichi_jello.view.drawing.shading import TOWARDS_EYE, clip

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


def loads(d: np.ndarray, w: np.ndarray, rest: np.ndarray, stiffness: np.ndarray, damping: np.ndarray) -> np.ndarray:
    """(S,) |k (|d| - R) + c w·d/|d|| [N] of springs that span d (S, 3) [m] and part at w (S, 3) [m/s]."""
    length = np.sqrt(np.einsum("ij,ij->i", d, d))
    along = np.einsum("ij,ij->i", w, d) / np.maximum(length, np.float32(1e-12))
    return np.abs(stiffness * (length - rest) + damping * along)


def strains(d: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(S,) ||d| - R| / R, zero where R is."""
    change = np.abs(np.sqrt(np.einsum("ij,ij->i", d, d)) - rest)
    return np.divide(change, rest, out=np.zeros_like(change), where=rest > 0.0)


def layers(body: Body) -> np.ndarray:
    """(S,) 0 for springs that tell a body's shape, 1 for the others on its surface and 2 for those inside and those
    that reach out of an embedded skin.

    In a dense body the diagonals inside would hide all else, and bend springs lie on structural ones."""
    outside = ~body.inside[body.springs].all(1)
    if len(body.springs) <= FEW or not np.any(body.family == 0):
        return np.where(outside, 2, 0)
    outer = np.zeros(len(body), bool)
    outer[body.surface] = True
    shown = np.where(np.isin(body.family, (0, 3)), 0, np.where(outer[body.springs].all(1), 1, 2))
    return np.where(outside, 2, shown)


class Springs:
    """The springs of a body as `lines`, and `key`, what their colours mean in this frame.

    Of a dense body only layer 0 is drawn, by family also layer 1, and all when `everything` is set; the colour scale
    and `load`, force [N] or strain of each, are those of the springs drawn. `scale`: of the body's stiffness and
    damping, as they are now."""

    def __init__(self, body: Body):
        layer = layers(body)
        order = np.argsort(layer, kind="stable")
        self.pairs = np.ascontiguousarray(body.springs[order], np.int32)
        self._order = order
        self.obey(SpringState(body.stiffness, body.rest_length, body.damping))
        self.families = np.minimum(body.family, 3).astype(np.intp)[order]
        self.everything = False
        self.scale = (1.0, 1.0)
        self.load = np.zeros(0, np.float32)
        self.lines = Lines.empty(0, WIDTH)
        self.key = Key()
        self._counts = np.searchsorted(layer[order], [1, 2])
        self._ends = Lines.empty(len(self.pairs), WIDTH)
        self._table = ramp_table()
        typical = np.median(body.rest_length * body.stiffness) if len(self.pairs) else 0.0
        self._floor = {"force": FLOOR * float(typical), "strain": FLOOR}

    def obey(self, law: SpringState) -> None:
        """Show springs that are as `law` says from now on."""
        self.law = law
        numbers = (law.rest_length, law.stiffness, law.damping)
        self.coefficients = [values[self._order].astype(np.float32) for values in numbers]
        self.torn = None if law.whole is None else ~law.whole[self._order]

    def update(self, x: np.ndarray, v: np.ndarray, look: np.ndarray, color: str) -> None:
        shown = len(self.pairs) if self.everything else int(self._counts[1 if color == "family" else 0])
        self.lines = Lines(self._ends.x[: 2 * shown], self._ends.rgb[: 2 * shown], WIDTH)
        i, j = self.pairs[:shown].T
        if self.torn is not None:  # a spring that is torn is a line of no length
            j = np.where(self.torn[:shown], i, j)
        self.lines.x[0::2], self.lines.x[1::2] = a, b = x[i], x[j]
        clip(self.lines.x, look, TOWARDS_EYE)
        rest, stiffness, damping = (values[:shown] for values in self.coefficients)
        firm, thick = self.scale
        if color == "family":
            rgb, self.key = self._by_family(self.families[:shown])
        elif color == "plain":
            rgb, self.key = palette.PLAIN, Key()
        elif color == "stiffness":
            rgb, self.key = self._by_stiffness(firm * stiffness)
        elif color == "strain":
            rgb, self.key = self._by_load(color, self._strains(b - a, rest, shown))
        else:
            rgb, self.key = self._by_load(color, loads(b - a, v[j] - v[i], rest, firm * stiffness, thick * damping))
        self.lines.rgb.reshape(-1, 2, 3)[:] = rgb

    def _strains(self, d: np.ndarray, rest: np.ndarray, shown: int) -> np.ndarray:
        strain = strains(d, rest)
        return strain if self.torn is None else np.where(self.torn[:shown], 0.0, strain)

    def _by_load(self, color: str, load: np.ndarray) -> tuple[np.ndarray, Key]:
        self.load = load = np.where(np.isfinite(load), load, np.float32(np.inf))
        usual = 0.0
        if len(load):
            rank = min(len(load) - 1, int(len(load) * MOST / 100.0))
            usual = float(np.partition(load, rank)[rank])
        most = round_up(max(usual, self._floor[color]))
        shade = np.minimum(load * ((SHADES - 1) / most), SHADES - 1).astype(np.intp)
        ramp = self._table
        named = Key("spring force", "N", most, ramp) if color == "force" else Key("strain", "%", 100.0 * most, ramp)
        return ramp[shade][:, None], named

    def _by_stiffness(self, stiffness: np.ndarray) -> tuple[np.ndarray, Key]:
        """From no stiffness to that of the stiffest spring drawn."""
        most = round_up(float(stiffness.max(initial=0.0)))
        shade = np.minimum(stiffness * ((SHADES - 1) / most), SHADES - 1).astype(np.intp)
        return self._table[shade][:, None], Key("stiffness", "N/m", most, self._table)

    def _by_family(self, families: np.ndarray) -> tuple[np.ndarray, Key]:
        names = tuple((FAMILY_NAMES[f], palette.FAMILIES[f]) for f in np.unique(families))
        return palette.FAMILIES[families][:, None], Key("spring family", names=names)
