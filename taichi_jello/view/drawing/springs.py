"""Springs as lines, coloured by force, strain, stiffness or family."""

from dataclasses import dataclass

import numpy as np

from taichi_jello.physics.forces.springs.spring_state import SpringState
from taichi_jello.scene.body import FAMILY_NAMES, Body
from taichi_jello.scene.description import Scene
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.primitives import Lines
from taichi_jello.view.drawing.scale import Scale
from taichi_jello.view.drawing.shading import clip

SHADES = 256
SPARSE = 600  # springs up to which a body shows them all


@dataclass(frozen=True)
class Key:
    """What the colours of one frame mean: a ramp from 0 to `most` in `unit`, or `names` with a colour each."""

    title: str = ""
    unit: str = ""
    most: float = 0.0
    ramp: np.ndarray | None = None
    names: tuple[tuple[str, np.ndarray], ...] = ()


def ramp_table() -> np.ndarray:
    """(SHADES, 3) float32 from zero to the maximum."""
    at = np.linspace(0.0, 1.0, SHADES)
    knots = np.linspace(0.0, 1.0, len(palette.FORCE_RAMP))
    return np.stack([np.interp(at, knots, channel) for channel in palette.FORCE_RAMP.T], 1).astype(np.float32)


def spring_forces(
    d: np.ndarray, w: np.ndarray, rest: np.ndarray, stiffness: np.ndarray, damping: np.ndarray
) -> np.ndarray:
    """(S,) |k (|d| - R) + c w·d/|d|| [N] of springs with ends d [m] apart that part at w [m/s] (S, 3)."""
    length = np.sqrt(np.einsum("ij,ij->i", d, d))
    along = np.einsum("ij,ij->i", w, d) / np.maximum(length, np.float32(1e-12))
    return np.abs(stiffness * (length - rest) + damping * along)


def layers(body: Body) -> np.ndarray:
    """(S,) 0 for springs that show a body's shape, 1 for others on its surface, 2 for those inside it or outside an
    embedded skin. Inner diagonals would hide a dense body's shape, and bend springs lie on structural ones."""
    outside = ~body.inside[body.springs].all(1)
    if len(body.springs) <= SPARSE or not np.any(body.family == 0):
        return np.where(outside, 2, 0)
    outer = np.zeros(len(body), bool)
    outer[body.surface] = True
    shown = np.where(np.isin(body.family, (0, 3)), 0, np.where(outer[body.springs].all(1), 1, 2))
    return np.where(outside, 2, shown)


class Springs:
    """The springs of a body as `lines`, and `key`, the meaning of their colours.
    Of a dense body only layer 0 is drawn, by family also layer 1, and all if `everything`. load (S,): the force [N] or
    strain of each; scale: factors on the body's stiffness and damping; ends: of colour scales."""

    def __init__(self, scene: Scene, body: Body):
        layer = layers(body)
        self._order = np.argsort(layer, kind="stable")
        self.pairs = np.ascontiguousarray(body.springs[self._order], np.int32)
        self.set_state(SpringState(body.stiffness, body.rest_length, body.damping))
        self.families = np.minimum(body.family, 3).astype(np.intp)[self._order]
        self.everything = False
        self.scale, self.ends = (1.0, 1.0), Scale(scene, body)
        self.load = np.zeros(0, np.float32)
        self.lines = Lines.empty(0)
        self.key = Key()
        self._counts = np.searchsorted(layer[self._order], [1, 2])
        self._all = Lines.empty(len(self.pairs))
        self._ramp = ramp_table()

    def set_state(self, state: SpringState) -> None:
        """Draw springs of these rest lengths and coefficients from now on."""
        values = state.rest_length, state.stiffness, state.damping
        self._coefficients = [value[self._order].astype(np.float32) for value in values]
        self._torn = np.zeros(len(self.pairs), bool) if state.whole is None else ~state.whole[self._order]

    def update(self, x: np.ndarray, v: np.ndarray, camera: np.ndarray, color: str) -> None:
        """Fill lines and key from positions x [m] and velocities v [m/s] (N, 3)."""
        shown = len(self.pairs) if self.everything else int(self._counts[1 if color == "family" else 0])
        self.lines = Lines(self._all.x[: 2 * shown], self._all.rgb[: 2 * shown])
        i, j = self.pairs[:shown].T
        j = np.where(self._torn[:shown], i, j)  # a torn spring has no length
        self.lines.x[0::2], self.lines.x[1::2] = a, b = x[i], x[j]
        clip(self.lines.x, camera)
        rest, stiffness, damping = (values[:shown] for values in self._coefficients)
        stiffness, damping = self.scale[0] * stiffness, self.scale[1] * damping
        if color == "family":
            rgb, self.key = self._by_family(self.families[:shown])
        elif color == "plain":
            rgb, self.key = palette.PLAIN, Key()
        elif color == "stiffness":
            rgb, self.key = self._ramped(stiffness, "stiffness", "stiffness", "N/m")
        elif color == "strain":
            change = np.abs(np.sqrt(np.einsum("ij,ij->i", b - a, b - a)) - rest)
            used = (rest > 0.0) & ~self._torn[:shown]
            self.load = np.divide(change, rest, out=np.zeros_like(change), where=used)
            rgb, self.key = self._ramped(self.load, "strain", "strain", "%", 100.0)
        else:
            self.load = spring_forces(b - a, v[j] - v[i], rest, stiffness, damping)
            rgb, self.key = self._ramped(self.load, "force", "spring force", "N")
        self.lines.rgb.reshape(-1, 2, 3)[:] = rgb

    def _ramped(self, load: np.ndarray, color: str, title: str, unit: str, per: float = 1.0) -> tuple[np.ndarray, Key]:
        """Colours (S, 1, 3) of loads from zero to the end of the scale, and their key; per: from loads to `unit`."""
        load = np.where(np.isfinite(load), load, np.float32(np.inf))
        end = self.ends.of(color, load[np.isfinite(load)], per)
        shade = np.minimum(load * ((SHADES - 1) / end), SHADES - 1).astype(np.intp)
        return self._ramp[shade][:, None], Key(title, unit, per * end, self._ramp)

    def _by_family(self, families: np.ndarray) -> tuple[np.ndarray, Key]:
        names = tuple((FAMILY_NAMES[f], palette.FAMILIES[f]) for f in np.unique(families))
        return palette.FAMILIES[families][:, None], Key("spring family", names=names)
