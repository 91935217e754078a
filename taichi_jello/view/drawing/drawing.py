"""From a simulation's state to what a renderer draws: the same triangles, lines and dots for every
renderer."""

import numpy as np

from taichi_jello.physics.forces.springs.spring_state import NOTHING, Memory, law_at
from taichi_jello.physics.forces.springs.tearing import parted
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import COLORS, SHOWS, Scene
from taichi_jello.view.camera import ASPECT, Viewpoint
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.embedded import Embedded
from taichi_jello.view.drawing.primitives import Dots, Lines, Triangles
from taichi_jello.view.drawing.shading import look_from
from taichi_jello.view.drawing.shadow import Shadow
from taichi_jello.view.drawing.skin import Skin
from taichi_jello.view.drawing.springs import Key, Springs
from taichi_jello.view.drawing.surroundings import Surroundings

SUNK = 0.05  # m into a floor to which a skin is drawn upon it
OVER = 0.0008  # of the eye's distance: over the shadow on it
DOT = 0.055  # a particle's drawn radius, of the median structural spring
LAYERS = ("skin", "springs", "particles")
HIDDEN = dict(zip(SHOWS, (set(), {"skin"}, {"springs", "particles"}, {"skin", "springs"}), strict=True))


class Drawing:
    """What one scene looks like now. Parts that the scene lacks are None and cost nothing.

    `update` fills them for one moment and one viewpoint; `hidden` names the LAYERS that are left out: see `show`.
    The first viewpoint is for a picture `aspect` times as wide as high.
    """

    def __init__(self, scene: Scene, body: Body, aspect: float = ASPECT):
        self.scene, self.body, self.count = scene, body, len(body)
        self.hidden: set[str] = set()
        self.changing = any(jello.changes for jello in scene.jello)
        self.color = scene.camera.color
        self.viewpoint = Viewpoint.first(scene, body, aspect)
        self.surroundings = Surroundings(scene) if scene.collider else None
        solids = [] if self.surroundings is None else [s for s in self.surroundings.surfaces if not s.level]
        self._solids = solids
        self.springs = Springs(body) if len(body.springs) else None
        self.show(scene.camera.show)
        self._whole: np.ndarray | None = None
        self._unpainted: tuple[float, np.ndarray] | None = None
        self.time = 0.0
        self._dress(body)

    def _dress(self, body: Body) -> None:
        """Make what depends on the body's skins."""
        self.embedded = Embedded(body) if len(body.skin) else None
        self._skinned = self.count + (len(self.embedded) if self.embedded is not None else 0)
        # The particles, the points of embedded skins, and those of colliders that cast a shadow.
        self._points = np.zeros((self._skinned + sum(len(s.points) for s in self._solids), 3), np.float32)
        self._speeds = np.zeros((self.count, 3), np.float32)
        self.skin = Skin(body, self.embedded) if len(body.bare_surface) or self.embedded is not None else None
        self.shadows = self._make_shadows(body)
        # Particles outside an embedded skin are only its scaffold.
        self._inside = np.flatnonzero(body.inside) if self.embedded is not None else None
        shown = self.points if self._inside is None else self.points[self._inside]
        self._dots = Dots(shown, np.tile(palette.PARTICLE, (len(shown), 1)).astype(np.float32), _radius(body))

    def _tear(self, whole: np.ndarray | None) -> None:
        """Show what is left of the skins, if that has changed."""
        whole = None if whole is None or whole.all() else whole
        before, self._whole = self._whole, whole
        if whole is not before and (whole is None or before is None or not np.array_equal(whole, before)):
            self._dress(self.body if whole is None else parted(self.body, whole))

    def show(self, what: str) -> None:
        """Draw what is named, one of SHOWS, from now on."""
        self.hidden = set(HIDDEN[what])
        if self.springs is not None:
            self.springs.everything = what == "all springs"

    @property
    def points(self) -> np.ndarray:
        """(N, 3) float32: the particles when last updated [m]."""
        return self._points[: self.count]

    @property
    def skin_points(self) -> np.ndarray:
        """(N + P, 3) float32: the particles and after them the points of embedded skins, when last updated [m]."""
        return self._points[: self._skinned]

    def _make_shadows(self, body: Body) -> list[tuple[int, Shadow]]:
        if self.surroundings is None:
            return []
        # A jello without a skin casts its springs' shadows: triangles of no area cover one cell in width.
        bare = np.setdiff1d(body.jello, body.jello[body.surface])
        threads = body.springs[np.isin(body.jello[body.springs[:, 0]], bare)]
        faces = [body.bare_surface, threads[:, [0, 1, 1]]]
        if self.embedded is not None:
            faces.append(self.embedded.index + self.count)
        start = self._skinned
        for solid in self._solids:
            faces.append(solid.faces + start)
            start += len(solid.points)
        joined = np.concatenate(faces)
        extent = float(np.ptp(body.x, axis=0).max()) if self.count > 1 else 0.0
        level = [(i, s) for i, s in enumerate(self.surroundings.surfaces) if s.level and s.normal[0][1] > 0.3]
        return [(i, Shadow(s, joined, extent)) for i, s in level] if len(joined) and extent > 0.0 else []

    def update(
        self,
        x: np.ndarray,
        v: np.ndarray,
        time: float,
        *,
        viewpoint: Viewpoint | None = None,
        color: str = "",
        memory: Memory = NOTHING,
    ) -> None:
        """Fill every part from positions x (N, 3) [m] and velocities v (N, 3) [m/s] at `time` [s], as seen
        from `viewpoint`. color, one of COLORS, and viewpoint are by default the scene's own; `memory`, of a
        Snapshot, says what has changed in the springs."""
        color = color or self.color
        if color not in COLORS:
            raise ValueError(f"color: expected one of {', '.join(COLORS)}, got {color!r}")
        self.viewpoint = self.viewpoint if viewpoint is None else viewpoint
        look, self.time = look_from(self.viewpoint), time
        if self.changing:
            self._tear(memory.get("whole"))
        self._points[: self.count], self._speeds[:] = x, v
        skin = self._points[self.count : self._skinned]
        if self.embedded is not None:
            self.embedded.update(self._points[: self.count], skin)
            self._dots.x[:] = self._points[self._inside]
        if self.surroundings is not None:
            origins = self.surroundings.origins(time)
            self._move_solids(self.surroundings, origins)
        if self.springs is not None:
            if self.changing:
                self.springs.obey(law_at(self.scene, self.body, time, memory))
            self.springs.update(self._points, self._speeds, look, color)
        if self.skin is not None and "skin" not in self.hidden:
            self.skin.place(self._points, skin)
            if self.surroundings is not None:
                self._lay(self.skin.triangles.x, self.surroundings, origins, look[0])
        self._unpainted = time, look

    def _paint(self) -> None:
        """Give vertices the colours that they have since the last update, if a renderer asks for them."""
        if self._unpainted is None:
            return
        (time, look), self._unpainted = self._unpainted, None
        if self.surroundings is not None:
            origins = self.surroundings.origins(time)
            self.surroundings.update(origins, look)
            for index, shadow in self.shadows:
                shadow.update(self._points, origins[index], look)
        if self.skin is not None and "skin" not in self.hidden:
            self.skin.shade(look)

    def _move_solids(self, surroundings: Surroundings, origins: np.ndarray) -> None:
        start = self._skinned
        for surface, origin in zip(surroundings.surfaces, origins, strict=True):
            if not surface.level:
                self._points[start : start + len(surface.points)] = surface.points + origin
                start += len(surface.points)

    @staticmethod
    def _lay(skin: np.ndarray, surroundings: Surroundings, origins: np.ndarray, eye: np.ndarray) -> None:
        """Draw what a penalty floor lets sink into it on the floor, that is visible through the rest."""
        for surface, origin in zip(surroundings.surfaces, origins, strict=True):
            if surface.level:
                height = (skin - surface.points[0] - origin) @ surface.normal[0]
                over = OVER * float(np.linalg.norm(eye - origin))
                low = np.flatnonzero((height < over) & (height > -SUNK))
                skin[low] += np.outer(over - height[low], surface.normal[0])

    @property
    def key(self) -> Key:
        """What the springs' colours mean now."""
        return self.springs.key if self.springs is not None and "springs" not in self.hidden else Key()

    @property
    def opaque(self) -> list[Triangles]:
        self._paint()
        around = [] if self.surroundings is None else [self.surroundings.triangles]
        return around + self.cast

    @property
    def cast(self) -> list[Triangles]:
        """The shadows."""
        self._paint()
        return [shadow.triangles for _, shadow in self.shadows]

    @property
    def lines(self) -> list[Lines]:
        self._paint()
        grid = [] if self.surroundings is None else [self.surroundings.lines]
        return [lines for lines in grid + self.threads if len(lines.x)]

    @property
    def threads(self) -> list[Lines]:
        """The springs."""
        return [] if self.springs is None or "springs" in self.hidden else [self.springs.lines]

    @property
    def dots(self) -> Dots | None:
        return None if "particles" in self.hidden or not len(self._dots.x) else self._dots

    @property
    def blended(self) -> Triangles | None:
        self._paint()
        return None if self.skin is None or "skin" in self.hidden else self.skin.triangles


def _radius(body: Body) -> float:
    near = body.rest_length[body.family == 0]
    near = near if len(near) else body.rest_length
    return DOT * float(np.median(near)) if len(near) else 0.02
