"""What the rasteriser shades: colliders as one mesh, jellos one by one, springs and particles as strokes."""

from dataclasses import dataclass

import numpy as np

from taichi_jello.physics.colliders.room import Room
from taichi_jello.scene.body import Body
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.drawing import Drawing
from taichi_jello.view.drawing.skin import Skin
from taichi_jello.view.drawing.surroundings import Surroundings
from taichi_jello.view.render.pixels.gel import gel_of
from taichi_jello.view.render.pixels.studio import studio_of

SHEET = 0.10  # a sheet's thickness, of its median structural spring
PRESSED = 0.4  # how far a sheet between its particles may lie behind what it covers, of the same
ROD, THICKEST = 0.024, 1.6  # a spring's radius, of the median structural spring, and in pixels at most, 720 rows high
ROPE, ROPE_THICKEST = 0.13, 60.0  # the same of springs that are no part of a skin
DEEP = 11.0  # 1/size: how fast springs fade in a body


def studio_for(drawing: Drawing) -> np.ndarray:
    """The studio of a scene: around what its first viewpoint looks at, as large as that is far."""
    scene, body, view = drawing.scene, drawing.body, drawing.viewpoint.first(drawing.scene, drawing.body)
    lowest = float(body.x[:, 1].min())
    floors = [level for collider in scene.collider if (level := collider.floor()) is not None]
    below = [level for level in floors if level <= lowest + 1e-6]
    floor = max(below, default=max(floors, default=None))
    return studio_of(view.target, view.distance, floor)


@dataclass
class Solids:
    """Colliders but level floors: x (V, 3) [m], normal (V, 3), faces (T, 3)."""

    x: np.ndarray
    normal: np.ndarray
    faces: np.ndarray

    @classmethod
    def of(cls, surroundings: Surroundings | None, time: float) -> "Solids":
        points, normals, faces = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros((0, 3), np.int32)]
        start = 0
        for surface in [] if surroundings is None else surroundings.surfaces:
            if isinstance(surface.collider, Room) or surface.collider.floor() is not None:
                continue
            points.append(surface.points + surface.collider.place(time))
            normals.append(surface.normal)
            faces.append(surface.faces + start)
            start += len(surface.points)
        x, normal = (np.concatenate(rows).astype(np.float32) for rows in (points, normals))
        return cls(x, normal, np.concatenate(faces).astype(np.int32))


class Gels:
    """The skin's triangles, sorted by jello: faces (T, 3) from first[k] to first[k + 1] are those of jello names[k],
    whose colours and sizes are gel[k], (3, 3). x, normal (V, 3) are those now."""

    def __init__(self, body: Body, skin: Skin):
        self.skin = skin
        order = np.argsort(skin.owner, kind="stable")
        self.faces = np.ascontiguousarray(skin.index[order])
        self.names, first = np.unique(skin.owner[order], return_index=True)
        self.first = np.append(first, len(order))
        self.kind = np.searchsorted(self.names, skin.owner[order]).astype(np.int32)
        self.points = [np.unique(self.faces[a:b]) for a, b in zip(self.first[:-1], self.first[1:], strict=True)]
        solid = np.unique(body.jello[body.cells[:, 0]])
        self.gel, thickness = [], np.zeros((len(skin.triangles.x), 1), np.float32)
        for name, points in zip(self.names, self.points, strict=True):
            rest = body.rest[body.jello == name]
            near = body.rest_length[(body.jello[body.springs[:, 0]] == name) & (body.family == 0)]
            step = float(np.median(near)) if len(near) else 0.1
            spread = np.sort(np.ptp(rest, axis=0))
            size = float(np.exp(np.log(spread.clip(1e-9)).mean())) if name in solid else 2.0 * SHEET * step
            sheet = 0.0 if name in solid else SHEET * step
            behind = 0.1 * step if name in solid else PRESSED * step
            self.gel.append(gel_of(palette.SKINS[name % len(palette.SKINS)], size, sheet, behind))
            thickness[points] = 0.5 * sheet
        self._casters: tuple[np.ndarray, np.ndarray] | None = None
        self._thickness = thickness if thickness.any() else None
        self.absorption = np.array([gel[0] for gel in self.gel], np.float32).reshape(-1, 3)
        self.size = max((float(gel[2, 0]) for gel in self.gel), default=1.0)

    @property
    def normal(self) -> np.ndarray:
        return self.skin.normal

    def x(self) -> np.ndarray:
        """(V, 3) float32 [m]: sheets stand off on both sides by half their thickness."""
        x = self.skin.triangles.x
        return x if self._thickness is None else x + self._thickness * self.skin.normal

    def casters(self, drawing: Drawing) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (P, 3) [m], triangles (T, 3) over them and the row of `gel` of each, of coarse skins that are enough
        for shadows; sheets as thick as they are drawn."""
        if self._thickness is not None and "skin" not in drawing.hidden:
            return self.x(), self.faces, self.kind
        if self._casters is None:
            skin, jello = self.skin, drawing.body.jello[self.skin.surface[:, 0]]
            faces = [skin.surface]
            if skin.embedded is not None:
                faces.append(skin.embedded.index + drawing.count)
                jello = np.append(jello, skin.embedded.jello[skin.embedded.index[:, 0]])
            kind = np.searchsorted(self.names, jello).astype(np.int32)
            self._casters = np.ascontiguousarray(np.concatenate(faces), np.int32), kind
        return drawing.skin_points, *self._casters


@dataclass
class Strokes:
    """x (P, 3) [m], pairs (S, 2), radius (S, 2) [m, most pixels of a picture 720 rows high], rgb (S, 3)."""

    x: np.ndarray
    pairs: np.ndarray
    radius: np.ndarray
    rgb: np.ndarray

    @classmethod
    def of(cls, drawing: Drawing) -> "Strokes":
        points, pairs, radius, rgb = [], [], [], []
        visible = drawing.skin is not None and "skin" not in drawing.hidden
        springs = drawing.springs
        if springs is not None and drawing.spring_lines:
            lines, count = springs.lines, len(springs.lines.x) // 2
            body = drawing.body
            near = body.rest_length[body.family == 0]
            step = float(np.median(near)) if len(near) else float(np.median(body.rest_length))
            skinned = np.zeros(len(body), bool)
            skinned[np.isin(body.jello, body.jello[body.surface])] = True
            skinned |= body.embedded
            first = springs.pairs[:count, 0]
            rope = ~skinned[first]
            # Of a body with an embedded skin no spring lies in the surface: all would be a cage inside.
            shown = np.ones(count, bool) if springs.everything or not visible else ~body.embedded[first]
            points.append(lines.x)
            pairs.append(np.arange(2 * count, dtype=np.int32).reshape(-1, 2)[shown])
            rope = rope[shown]
            radius.append(np.where(rope[:, None], [ROPE * step, ROPE_THICKEST], [ROD * step, THICKEST]))
            rgb.append(lines.rgb[0::2][shown])
        dots = drawing.dots
        if dots is not None and not visible:
            start = sum(map(len, points))
            points.append(dots.x)
            pairs.append(np.repeat(np.arange(start, start + len(dots.x), dtype=np.int32)[:, None], 2, axis=1))
            radius.append(np.tile([dots.radius, 1e3], (len(dots.x), 1)))
            rgb.append(dots.rgb)
        if not points:
            return cls(*(np.zeros((0, n), kind) for n, kind in ((3, "f4"), (2, "i4"), (2, "f4"), (3, "f4"))))
        return cls(
            np.concatenate(points).astype(np.float32),
            np.concatenate(pairs),
            np.concatenate(radius).astype(np.float32),
            np.concatenate(rgb).astype(np.float32),
        )
