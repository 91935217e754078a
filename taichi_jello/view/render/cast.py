"""What the rasteriser shades: colliders as one mesh, jellos one by one, springs and particles as strokes."""

from dataclasses import dataclass

import numpy as np

from taichi_jello.physics.colliders.plane import six_faces
from taichi_jello.physics.colliders.room import Room
from taichi_jello.scene.body import FAMILY_NAMES, Body
from taichi_jello.scene.description import Scene
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.drawing import Drawing
from taichi_jello.view.drawing.skin import Skin
from taichi_jello.view.drawing.surroundings import Surface, Surroundings
from taichi_jello.view.render.pixels.gel import gel_of
from taichi_jello.view.render.pixels.soft_shadow import BEAM
from taichi_jello.view.render.pixels.studio import DARKER, SIZE, studio_of

SHEET = 0.10  # a sheet's thickness, of its median structural spring
PRESSED = 0.4  # how far a sheet between its particles may lie behind what it covers, of the same
ROD, THICKEST = 0.03, 2.4  # a spring's radius, of the median structural spring, and in pixels at most, 720 rows high
ROPE, ROPE_THICKEST = 0.13, 60.0  # the same of springs that are no part of a skin
BAR = 0.0015  # half the width of a room's edge, of its shortest side
DEEP = 11.0  # 1/size: how fast springs fade in a body
OPAQUE, BROAD = 1e3, 2.5  # 1/m: what a rope absorbs; how wide its shadow is, of it: the blur would leave little else
BEND = FAMILY_NAMES.index("bend")
NO_FACES = np.zeros((0, 3), np.int32), np.zeros(0, np.int32)


def studio_for(drawing: Drawing) -> np.ndarray:
    """The studio of a scene: around what its first viewpoint looks at, as large as that is far."""
    scene, body, view = drawing.scene, drawing.body, drawing.viewpoint.first(drawing.scene, drawing.body)
    lowest = float(body.x[:, 1].min())
    floors = [level for collider in scene.collider if (level := collider.floor()) is not None]
    below = [level for level in floors if level <= lowest + 1e-6]
    floor = max(below, default=max(floors, default=None)) if scene.ground.show else None
    darker = 1.0 if scene.ground.pattern == "plain" else DARKER
    tile, top, low = (
        np.array(color) ** palette.GAMMA
        for color in (palette.ground(scene), scene.background.top, scene.background.bottom)
    )
    return studio_of(view.target, view.distance, floor, np.array([tile, darker * tile, top, low]))


@dataclass
class Solids:
    """Colliders but level floors, and rooms' edges: x (V, 3) [m], normal (V, 3), faces (T, 3), rgb (V, 3) linear."""

    x: np.ndarray
    normal: np.ndarray
    faces: np.ndarray
    rgb: np.ndarray

    @classmethod
    def of(cls, surroundings: Surroundings | None, time: float) -> "Solids":
        points, normals, colors, faces = ([np.zeros((0, 3))] for _ in range(4))
        start = 0
        for surface in [] if surroundings is None else surroundings.surfaces:
            if isinstance(surface.collider, Room):
                surface = frame(surface.collider)
            elif surface.collider.floor() is not None:
                continue
            points.append(surface.points + surface.collider.place(time))
            normals.append(surface.normal)
            colors.append(np.tile(palette.obstacle(surface.collider) ** palette.GAMMA, (len(surface.points), 1)))
            faces.append(surface.faces + start)
            start += len(surface.points)
        x, normal, rgb = (np.concatenate(rows).astype(np.float32) for rows in (points, normals, colors))
        return cls(x, normal, np.concatenate(faces).astype(np.int32), rgb)


def frame(room: Room) -> Surface:
    """The edges of a room as thin bars."""
    size = np.array(room.max) - np.array(room.min)
    half = BAR * float(size.min())
    points, normals, faces = ([np.zeros((0, 3))] for _ in range(3))
    for axis in range(3):
        bar, triangles = six_faces(np.where(np.arange(3) == axis, 0.5 * size + half, half), 2.0 * size[axis])
        flat = np.repeat(np.concatenate([np.eye(3)[[k, k]] * [[-1.0], [1.0]] for k in range(3)]), len(bar) // 6, 0)
        for corner in np.ndindex(2, 2):
            middle = size * np.insert(np.array(corner, float), axis, 0.5)
            faces.append(triangles + sum(len(part) for part in points))
            points.append(bar + middle)
            normals.append(flat)
    return Surface(room, np.concatenate(points), np.concatenate(normals), np.concatenate(faces).astype(int), False)


class Gels:
    """The skin's triangles, sorted by jello: faces (T, 3) from first[k] to first[k + 1] are those of jello names[k],
    whose colours and sizes are gel[k], (3, 3). x, normal (V, 3) are those now; tint (V, 3): linear colours, if they are
    `varied`."""

    def __init__(self, scene: Scene, body: Body, skin: Skin):
        self.skin, self.varied = skin, int(skin.varied)
        self.tint = skin.albedo**palette.GAMMA
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
            self.gel.append(gel_of(palette.skin(scene.jello[name], name), size, sheet, behind))
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
        visible = drawing.skin is not None and "skin" not in drawing.hidden
        parts = [cls(np.zeros((0, 3)), np.zeros((0, 2), np.int32), np.zeros((0, 2)), np.zeros((0, 3)))]
        springs = drawing.springs
        if springs is not None:
            lines, count = springs.lines, len(springs.lines.x) // 2
            body, first = drawing.body, springs.pairs[:count, 0]
            rope = np.isin(body.jello[first], body.ropes)
            # Of a body with an embedded skin no spring lies in the surface: all would be a cage inside.
            shown = np.ones(count, bool) if springs.everything or not visible else ~body.embedded[first]
            shown &= ~rope & bool(drawing.spring_lines)
            radius, rgb = np.array([ROD * body.spacing, THICKEST]), lines.rgb[0::2]
            pairs = np.arange(2 * count, dtype=np.int32).reshape(-1, 2)
            parts.append(cls(lines.x, pairs[shown], np.tile(radius, (shown.sum(), 1)), rgb[shown]))
            if rope.any():
                tube = rope & (springs.families[:count] != BEND)
                own = np.array([palette.skin(jello, number) for number, jello in enumerate(drawing.scene.jello)])
                rgb = rgb[tube] if drawing.spring_lines else own[body.jello[first[tube]]]
                radius = np.array([ROPE * body.spacing, ROPE_THICKEST])
                parts.append(cls(lines.x, pairs[tube], np.tile(radius, (tube.sum(), 1)), rgb))
        dots = drawing.dots
        if dots is not None and not visible:
            pairs = np.repeat(np.arange(len(dots.x), dtype=np.int32)[:, None], 2, axis=1)
            parts.append(cls(dots.x, pairs, np.tile([dots.radius, 1e3], (len(dots.x), 1)), dots.rgb))
        starts = np.cumsum([0, *(len(part.x) for part in parts)])
        return cls(
            np.concatenate([part.x for part in parts]).astype(np.float32),
            np.concatenate([part.pairs + start for part, start in zip(parts, starts, strict=False)]).astype(np.int32),
            np.concatenate([part.radius for part in parts]).astype(np.float32),
            np.concatenate([part.rgb for part in parts]).astype(np.float32),
        )


Casters = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def casters_of(drawing: Drawing, gels: Gels | None, studio: np.ndarray) -> Casters | None:
    """Points (P, 3) [m], triangles (T, 3) over them, the kind (T,) of each and what each kind absorbs (kinds, 3) [1/m];
    None if nothing casts a shadow. A rope casts that of a ribbon, broadside to the light."""
    if studio[SIZE, 2] == 0.0:
        return None
    body, count = drawing.body, 0 if gels is None else len(gels.absorption)
    x, faces, kind = gels.casters(drawing) if gels is not None else (np.zeros((0, 3), np.float32), *NO_FACES)
    absorption = gels.absorption if gels is not None else np.zeros((0, 3), np.float32)
    if drawing.springs is not None and len(body.ropes):
        tube = np.isin(body.jello[body.springs[:, 0]], body.ropes) & (body.family != BEND)
        a, b = (drawing.points[end] for end in body.springs[tube].T)
        across = np.cross(b - a, [BEAM[0], -1.0, BEAM[1]])
        across *= BROAD * ROPE * body.spacing / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        ribbon = np.stack([a - across, a + across, b + across, b - across], 1).reshape(-1, 3)
        corners = len(x) + np.arange(len(ribbon)).reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        x = np.concatenate([x, ribbon]).astype(np.float32)
        faces = np.concatenate([faces, corners]).astype(np.int32)
        kind = np.append(kind, np.full(len(corners), count)).astype(np.int32)
        absorption = np.concatenate([absorption, np.full((1, 3), OPAQUE, np.float32)])
    return (x, faces, kind, absorption) if len(faces) else None
