"""From a simulation's state to the triangles, lines and dots that every renderer draws."""

import numpy as np

from taichi_jello.physics.forces.springs.spring_state import NOTHING, Memory, springs_at
from taichi_jello.physics.forces.springs.tearing import parted
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import COLORS, SHOWS, Scene
from taichi_jello.view.camera import ASPECT, Viewpoint
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.embedded import Embedded
from taichi_jello.view.drawing.primitives import Dots, Lines, Triangles
from taichi_jello.view.drawing.shading import EYE, camera_rows
from taichi_jello.view.drawing.shadow import Shadow
from taichi_jello.view.drawing.skin import Skin
from taichi_jello.view.drawing.springs import Key, Springs
from taichi_jello.view.drawing.surroundings import Surroundings

MAX_PENETRATION = 0.05  # m into a floor at which a skin is still drawn on top of it
SKIN_LIFT = 0.0008  # of the eye's distance: above the shadow
DOT_RADIUS = 0.055  # of the median structural rest length
LAYERS = ("skin", "springs", "particles")
HIDDEN = dict(zip(SHOWS, (set(), {"skin"}, {"springs", "particles"}, {"skin", "springs"}), strict=True))


class Drawing:
    """What one scene looks like now. Parts that the scene lacks are None and cost nothing.

    `update` fills them for one moment, colours only when a renderer asks. `hidden`: LAYERS to leave out; aspect: width
    over height of the picture."""

    def __init__(self, scene: Scene, body: Body, aspect: float = ASPECT):
        self.scene, self.body, self.count = scene, body, len(body)
        self.changing = any(jello.changes for jello in scene.jello)
        self.camera, self.color = scene.camera, scene.camera.color
        self.viewpoint, self.aspect = Viewpoint.first(scene, body, aspect), aspect
        drawn = [each for each in scene.collider if scene.ground.show or each.floor() is None]
        self.surroundings = Surroundings(drawn) if drawn else None
        self._solids = [s for s in self.surroundings.surfaces if not s.planar] if self.surroundings else []
        self.springs = Springs(scene, body) if len(body.springs) else None
        self.hidden: set[str] = set()
        self.show(scene.camera.show)
        self.time = 0.0  # s, of the last update
        self._unpainted: tuple[np.ndarray, np.ndarray] | None = None
        self._whole = np.ones(len(body.springs), bool)
        self._build_skins(body)

    def _build_skins(self, body: Body) -> None:
        """Build all that depends on the body's skins."""
        self.embedded = Embedded(body) if len(body.skin) else None
        self._skinned = self.count + (len(self.embedded) if self.embedded is not None else 0)
        # Particles, then points of embedded skins, then points of solid colliders, which cast shadows.
        self._points = np.zeros((self._skinned + sum(len(s.points) for s in self._solids), 3), np.float32)
        self._velocities = np.zeros((self.count, 3), np.float32)
        skinned = len(body.bare_surface) > 0 or self.embedded is not None
        self.skin = Skin(self.scene, body, self.embedded) if skinned else None
        self.shadows = self._make_shadows(body)
        # The particles of an embedded skin that lie outside it are not drawn.
        self._dotted = np.flatnonzero(body.inside) if self.embedded is not None else slice(self.count)
        x = self._points[self._dotted]
        self._dots = Dots(x, np.tile(palette.PARTICLE, (len(x), 1)).astype(np.float32), _dot_radius(body))

    def show(self, what: str) -> None:
        """Choose what to draw, one of SHOWS."""
        self.hidden = set(HIDDEN[what])
        if self.springs is not None:
            self.springs.everything = what == "all springs"

    @property
    def points(self) -> np.ndarray:
        """(N, 3) float32: the particles [m] at the last update."""
        return self._points[: self.count]

    @property
    def skin_points(self) -> np.ndarray:
        """(N + P, 3) float32: the particles and after them the points of embedded skins [m] at the last update."""
        return self._points[: self._skinned]

    def _make_shadows(self, body: Body) -> list[tuple[int, Shadow]]:
        """A shadow on each planar surface that faces up, with the surface's number."""
        if self.surroundings is None:
            return []
        # A jello without a skin casts the shadows of its springs: triangles without area, drawn one cell wide.
        bare = np.setdiff1d(body.jello, body.jello[body.surface])
        lines = body.springs[np.isin(body.jello[body.springs[:, 0]], bare)]
        faces = [body.bare_surface, lines[:, [0, 1, 1]]]
        if self.embedded is not None:
            faces.append(self.embedded.index + self.count)
        start = self._skinned
        for solid in self._solids:
            faces.append(solid.faces + start)
            start += len(solid.points)
        joined = np.concatenate(faces)
        extent = float(np.ptp(body.x, axis=0).max()) if self.count > 1 else 0.0
        if not len(joined) or extent <= 0.0:
            return []
        floors = [(i, s) for i, s in enumerate(self.surroundings.surfaces) if s.planar and s.normal[0][1] > 0.3]
        return [(i, Shadow(surface, joined, extent)) for i, surface in floors]

    def update(self, x: np.ndarray, v: np.ndarray, time: float, *, color: str = "", memory: Memory = NOTHING) -> None:
        """Fill every part from positions x and velocities v (N, 3) [m, m/s] at `time` [s], seen from `viewpoint`.
        color: one of COLORS, by default the scene's, else ValueError; memory: the changes of springs in a Snapshot."""
        color = color or self.color
        if color not in COLORS:
            raise ValueError(f"color: expected one of {', '.join(COLORS)}, got {color!r}")
        if self.camera.moves:
            followed = self.body.jello == (-1 if self.camera.follow is None else self.camera.follow)
            self.viewpoint.fly(self.camera, time, np.asarray(x)[followed], self.aspect)
        if self.springs is not None and time == 0.0 < self.time:
            self.springs.ends.restart()
        camera, self.time = camera_rows(self.viewpoint, self.scene), time
        if self.changing:
            self._change(time, memory)
        self._points[: self.count], self._velocities[:] = x, v
        if self.embedded is not None:
            self.embedded.update(self._points[: self.count], self._points[self.count : self._skinned])
        if self.springs is not None:
            self.springs.update(self._points, self._velocities, camera, color)
        self._dots.x[:] = self._points[self._dotted]
        if self.skin is not None and "skin" not in self.hidden:
            self.skin.place(self._points, self._points[self.count : self._skinned])
        origins = np.zeros((0, 3), np.float32)
        if self.surroundings is not None:
            origins = self.surroundings.origins(time)
            self._move_surroundings(self.surroundings, origins, camera[EYE])
        self._unpainted = origins, camera

    def _change(self, time: float, memory: Memory) -> None:
        """Follow springs that creep, melt or tear; torn springs take their part of the skin with them."""
        whole = memory.get("whole", np.ones_like(self._whole))
        if not np.array_equal(whole, self._whole):
            self._whole = whole
            self._build_skins(self.body if whole.all() else parted(self.body, whole))
        if self.springs is not None:
            self.springs.set_state(springs_at(self.scene, self.body, time, memory))

    def _move_surroundings(self, surroundings: Surroundings, origins: np.ndarray, eye: np.ndarray) -> None:
        """Move the colliders to their origins, and lift the skin out of penalty floors."""
        start = self._skinned
        for surface, origin in zip(surroundings.surfaces, origins, strict=True):
            if not surface.planar:
                self._points[start : start + len(surface.points)] = surface.points + origin
                start += len(surface.points)
            elif self.skin is not None and "skin" not in self.hidden:
                x, normal = self.skin.triangles.x, surface.normal[0]
                height = (x - surface.points[0] - origin) @ normal
                lift = SKIN_LIFT * float(np.linalg.norm(eye - origin))
                low = np.flatnonzero((height < lift) & (height > -MAX_PENETRATION))
                x[low] += np.outer(lift - height[low], normal)

    def _paint(self) -> None:
        """Colour the vertices as they were last updated, cast shadows and sort the skin, once a renderer asks for it:
        one that shades pixels never does."""
        if self._unpainted is None:
            return
        (origins, camera), self._unpainted = self._unpainted, None
        if self.surroundings is not None:
            self.surroundings.update(origins, camera)
            for index, shadow in self.shadows:
                shadow.update(self._points, origins[index], camera)
        if self.skin is not None and "skin" not in self.hidden:
            self.skin.shade(camera)

    @property
    def key(self) -> Key:
        """The meaning of the springs' colours now."""
        return self.springs.key if self.springs is not None and "springs" not in self.hidden else Key()

    @property
    def shadow_triangles(self) -> list[Triangles]:
        self._paint()
        return [shadow.triangles for _, shadow in self.shadows]

    @property
    def opaque(self) -> list[Triangles]:
        """Colliders and shadows."""
        self._paint()
        return [*([self.surroundings.triangles] if self.surroundings else []), *self.shadow_triangles]

    @property
    def spring_lines(self) -> list[Lines]:
        return [] if self.springs is None or "springs" in self.hidden else [self.springs.lines]

    @property
    def lines(self) -> list[Lines]:
        """The grids of floors, and springs."""
        self._paint()
        grid = [self.surroundings.lines] if self.surroundings else []
        return [lines for lines in grid + self.spring_lines if len(lines.x)]

    @property
    def dots(self) -> Dots | None:
        return None if "particles" in self.hidden or not len(self._dots.x) else self._dots

    @property
    def blended(self) -> Triangles | None:
        self._paint()
        return None if self.skin is None or "skin" in self.hidden else self.skin.triangles


def _dot_radius(body: Body) -> float:
    near = body.rest_length[body.family == 0]
    near = near if len(near) else body.rest_length
    return DOT_RADIUS * float(np.median(near)) if len(near) else 0.02
