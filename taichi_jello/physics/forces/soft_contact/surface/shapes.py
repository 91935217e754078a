"""The shape of each jello: solid, sheet or rope, how thick it is, whether convex and compact (NumPy only)."""

from dataclasses import dataclass

import numpy as np

from taichi_jello.scene.body import Body

CORE = 0.25  # of a jello's thickness: the depth at which its core begins
THICKNESS = {"sheet": 0.25, "rope": 0.5}  # the radius of a thin jello, in lengths of its structural springs
THIN = 8.0  # radii that a thin jello is as thick as: an eighth of that may be passed in a step
SLENDERNESS = 2.0 * (1.0 + 1e-6)  # the greatest extent of a compact body, in its least one; with rounding
PAIRS = 200  # of cells, joined to find out whether a body is convex


@dataclass(frozen=True)
class Shapes:
    """(J,) bool: solid, sheet, rope, convex; loose: may melt or tear (see spring_state.loose); firm: solid and not
    loose; of the firm ones, compact: convex and about as thick as long, and slender: not.
    (J,) [m]: radius of sheets and ropes; spacing between points; thickness, of solids that are not convex that of half
    of the cells, of thin jellos THIN radii. (C,) [m] thick: of the undeformed body around each cell; core: how deep its
    core begins there. middle (J, 8): the corners of the cell in the middle of each solid.
    """

    solid: np.ndarray
    sheet: np.ndarray
    rope: np.ndarray
    convex: np.ndarray
    loose: np.ndarray
    firm: np.ndarray
    compact: np.ndarray
    slender: np.ndarray
    radius: np.ndarray
    spacing: np.ndarray
    thickness: np.ndarray
    thick: np.ndarray
    core: np.ndarray
    middle: np.ndarray

    @classmethod
    def of(cls, body: Body, loose: np.ndarray, way: np.ndarray) -> "Shapes":
        """way (C, 6): see ways_out."""
        jellos, holder = np.arange(int(body.jello.max()) + 1), body.jello[body.cells[:, 0]]
        solid = np.isin(jellos, holder)
        sheet = np.isin(jellos, body.jello[body.surface[:, 0]]) & ~solid
        rope = np.isin(jellos, body.jello[body.springs[body.family == 0, 0]]) & ~solid & ~sheet
        spacing = spacings(body, len(jellos))
        radius = spacing * np.select([solid, sheet], [0.0, THICKNESS["sheet"]], THICKNESS["rope"])
        skinned = body.embedded[body.cells[:, 0]]
        thick, thickness = thicknesses(way, skinned, spacing[holder]), THIN * radius
        is_convex, is_compact = np.zeros_like(solid), np.zeros_like(solid)
        middle, places = np.zeros((len(jellos), 8), np.int32), body.rest[body.cells].mean(1)
        for j in np.flatnonzero(solid):
            own = holder == j
            is_convex[j] = convex(body.rest, body.cells[own])
            is_compact[j] = is_convex[j] and compact(body.rest, body.cells[own])
            thickness[j] = thick[own].max() if is_convex[j] else max(np.median(thick[own]), spacing[j])
            middle[j] = body.cells[own][np.linalg.norm(places[own] - places[own].mean(0), axis=1).argmin()]
            if is_convex[j]:  # where it is thin it only ends
                thick[own] = thickness[j]
        core = cores(thick, np.where(skinned, 0.0, spacing[holder]))
        firm, is_compact = solid & ~loose, is_compact & ~loose
        slender = firm & ~is_compact
        sizes = radius, spacing, thickness, thick, core, middle
        return cls(solid, sheet, rope, is_convex, loose, firm, is_compact, slender, *sizes)

    @property
    def has_slender(self) -> bool:
        """Whether solids of two jellos can hold each other: one is slender, and none is loose."""
        return bool(self.slender.any()) and int(np.sum(self.firm)) > 1


def spacings(body: Body, jellos: int) -> np.ndarray:
    """(J,) the mean length of each jello's edges: of its structural springs, else of its cells, else its size."""
    spacing, structural = np.zeros(jellos), body.springs[body.family == 0]
    for j in range(jellos):
        pairs = structural[body.jello[structural[:, 0]] == j]
        if not len(pairs):
            pairs = body.cells[body.jello[body.cells[:, 0]] == j][:, [0, 1]]
        if not len(pairs):
            pairs = body.springs[body.jello[body.springs[:, 0]] == j]
        if len(pairs):
            spacing[j] = np.linalg.norm(body.rest[pairs[:, 0]] - body.rest[pairs[:, 1]], axis=1).mean()
    return np.where(spacing > 0.0, spacing, spacing.max() or 1.0)


def thicknesses(way: np.ndarray, skinned: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """(C,) [m]: how thick the undeformed body is around each cell, the shortest of the straight lines through it, from
    the `way` (C, 6) of `ways_out`. A skin lies within its outermost cells: where `skinned` (C,), a body is thinner by
    half a spacing (C,) [m] at either end, but by no more than half."""
    through = (way[:, 0::2] + way[:, 1::2]).min(1, initial=np.inf)
    through = np.where(np.isfinite(through), through, spacing)
    return np.where(skinned, np.maximum(through - spacing, 0.5 * through), through)


def cores(thick: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """(C,) [m]: how deep the core begins, where a body is `thick` (C,) [m] and has points a `gap` (C,) [m] apart. What
    comes in between points farther apart than half of the thickness is deeper than these."""
    return CORE * (thick - np.clip(gap - 0.5 * thick, 0.0, 0.5 * thick))


def convex(rest: np.ndarray, cells: np.ndarray) -> bool:
    """Whether there is a cell halfway between any two of the cells (C, 8) of a body, for PAIRS drawn at random."""
    middle = rest[cells].mean(1)
    reach = 1.01 * np.linalg.norm(rest[cells] - middle[:, None], axis=2).max()
    first, second = np.random.default_rng(0).integers(len(cells), size=(2, PAIRS))
    halfway = 0.5 * (middle[first] + middle[second])
    return all(np.linalg.norm(middle - place, axis=1).min() <= reach for place in halfway)


def compact(rest: np.ndarray, cells: np.ndarray) -> bool:
    """Whether a body of the cells (C, 8), measured along their axes, is about as thick as it is long."""
    edges = rest[cells[0, [4, 2, 1]]] - rest[cells[0, 0]]
    extents = np.ptp(rest[np.unique(cells)] @ (edges / np.linalg.norm(edges, axis=1)[:, None]).T, axis=0)
    return bool(extents.max() <= SLENDERNESS * extents.min())
