"""The rasteriser: Taichi kernels shade every pixel, without a Vulkan driver.

A picture is made of layers: the stage, which is kept while neither the eye nor a collider moves; over it one jello
after the other, from the farthest; over them the strokes. Only the part of the picture in which something can have
changed is drawn anew. Smooth edges come from four such pictures, each shifted by a part of a pixel.
"""

from dataclasses import dataclass

import numpy as np

from taichi_jello.support import runtime
from taichi_jello.support.runtime import RuntimeProblem
from taichi_jello.view.camera import NEAR, Viewpoint
from taichi_jello.view.drawing.drawing import Drawing
from taichi_jello.view.drawing.primitives import ROWS
from taichi_jello.view.drawing.shading import MIN_DEPTH
from taichi_jello.view.render.cast import DEEP, Gels, Solids, Strokes, casters_of, studio_for
from taichi_jello.view.render.pixels import buffers, develop, gel, stage, strokes
from taichi_jello.view.render.pixels.clipping import clipped
from taichi_jello.view.render.pixels.soft_shadow import Shadow

SHIFTS = {1: [(0.0, 0.0)], 2: [(0.25, 0.125), (-0.125, 0.25), (0.125, -0.25), (-0.25, -0.125)]}  # pixels
ARCHES_WITHOUT = ("vulkan", "metal")  # 64-bit atomics
BLACK = np.full((1, 3), 1e3, np.float32)  # what opaque bodies absorb [1/m]


@dataclass
class Stage:
    """The picture without jellos, as seen by `view`: linear colours and depths [m]; `scene` and `scene_depths` are the
    same with jellos. Each sample has its own: bodies refract what lies outside the part of the picture that is drawn
    anew."""

    view: np.ndarray
    colors: np.ndarray
    depths: np.ndarray
    scene: np.ndarray
    scene_depths: np.ndarray
    seen: bytes = b""

    @classmethod
    def of_size(cls, size: tuple[int, int]) -> "Stage":
        shape = size[1], size[0]
        colors, scene = (np.zeros((*shape, 3), np.float32) for _ in range(2))
        depths, scene_depths = (np.zeros(shape, np.float32) for _ in range(2))
        return cls(np.zeros((9, 3), np.float32), colors, depths, scene, scene_depths)


class Raster:
    """Draws into memory. size: (width, height) [pixels]; samples: 1, or 2 for four samples a pixel; picture (height,
    width) uint32: the last one, an Image of rows.py, which the next one overwrites in part."""

    name = "raster"

    def __init__(self, size: tuple[int, int], samples: int = 2):
        self._runtime = runtime.current()
        if self._runtime.arch in ARCHES_WITHOUT:
            raise RuntimeProblem(f"raster: needs 64-bit atomics, which {self._runtime.arch} lacks; use --arch cpu")
        self.size, self.samples = size, samples
        shape = size[1], size[0]
        self._stages = [Stage.of_size(size) for _ in SHIFTS[samples]]
        self._keys = np.full(shape, buffers.EMPTY, np.int64)  # of solids, then of strokes
        self._front, self._back = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
        self._thick = np.zeros(shape, np.int32)
        self._shaded = np.zeros((*shape, 3), np.float32)
        self._mean = np.zeros((*shape, 3) if samples > 1 else (1, 1, 3), np.float32)
        self.picture, self._table = np.zeros(shape, np.uint32), develop.srgb_table()
        self._drawing: Drawing | None = None
        self._gels: Gels | None = None
        self._studio, self._floor = np.zeros((10, 3), np.float32), 0.0
        self._shadow = Shadow(1.0, 1.0)
        self._changed = np.array([[0, 0], size])

    def draw(self, drawing: Drawing, viewpoint: Viewpoint) -> None:
        runtime.check(self._runtime)
        if drawing is not self._drawing:
            self._take(drawing)
        if drawing.skin is None:
            self._gels = None
        elif self._gels is None or self._gels.skin is not drawing.skin:
            self._gels = Gels(drawing.scene, drawing.body, drawing.skin)
        self._cast_shadow(drawing)
        visible = drawing.skin is not None and "skin" not in drawing.hidden
        bodies = self._gels if visible else None
        lines = Strokes.of(drawing)
        solids = Solids.of(drawing.surroundings, drawing.time)
        views = [buffers.view_of(viewpoint, self.size, shift) for shift in SHIFTS[self.samples]]
        moved = [self._set(part, view, solids) for part, view in zip(self._stages, views, strict=True)]
        points = [self._shadow.outline(), lines.x, *([] if bodies is None else [bodies.x()])]
        box = self._box(views[0], np.concatenate(points).astype(np.float32))
        region = np.array([[0, 0], self.size]) if any(moved) else _union(box, self._changed)
        self._changed = box
        for number in range(len(views)):
            self._draw_sample(number, bodies, lines, region.astype(np.int32))

    def _take(self, drawing: Drawing) -> None:
        """Prepare for another drawing."""
        self._drawing, self._studio = drawing, studio_for(drawing)
        self._floor = float(self._studio[0, 1])
        size, extent = float(self._studio[1, 0]), float(np.ptp(drawing.body.x, axis=0).max())
        self._gels = None
        self._shadow = Shadow(size, extent or 0.1 * size)
        for part in self._stages:
            part.seen = b""

    def _cast_shadow(self, drawing: Drawing) -> None:
        casters = casters_of(drawing, self._gels, self._studio)
        if casters is not None:
            self._shadow.update(*casters, self._floor)

    def _set(self, part: Stage, view: np.ndarray, solids: Solids) -> bool:
        """Draw the stage anew if the eye or a collider has moved since; whether it was."""
        seen = view.tobytes() + solids.x.tobytes()
        if seen == part.seen:
            return False
        part.seen, part.view = seen, view
        x, faces, screen, normal, rgb = self._projected(view, solids.x, solids.faces, solids.normal, solids.rgb)
        stage.clear(self._keys)
        size = float(self._studio[1, 0])
        extent = float(np.ptp(solids.x, axis=0).max()) if len(solids.x) else size
        shadow = Shadow(size, extent, solid=True)
        if len(faces):
            buffers.nearest(screen, faces, self._keys)
            shadow.update(solids.x, solids.faces, np.zeros(len(solids.faces), np.int32), BLACK, self._floor)
        shadow_of = shadow.grid, shadow.light
        stage.stage(view, self._studio, *shadow_of, x, normal, faces, rgb, self._keys, part.colors, part.depths)
        return True

    def _projected(
        self, view: np.ndarray, x: np.ndarray, faces: np.ndarray, *rows: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """A mesh, where its points are on the screen, and their `rows`; what is behind the eye is cut off."""
        screen = np.zeros_like(x)
        if len(x):
            buffers.project(view, x, screen)
            if screen[:, 2].min() <= MIN_DEPTH:
                faces, x, *cut = clipped(screen[:, 2], faces, x, *rows)
                rows = tuple(cut)
                screen = np.zeros_like(x)
                buffers.project(view, x, screen)
        return x, faces, screen, *rows

    def _draw_sample(self, number: int, bodies: Gels | None, lines: Strokes, region: np.ndarray) -> None:
        picture, count = self._stages[number], len(self._stages)
        view, scene = picture.view, (picture.scene, picture.scene_depths)
        shadow = self._shadow.grid, self._shadow.light
        stage.begin(view, self._studio, *shadow, picture.colors, picture.depths, region, *scene)
        if bodies is not None:
            self._draw_bodies(picture, bodies)
        ends, radius = np.full((len(lines.pairs), 8), 0.0, np.float32), lines.radius.copy()
        radius[:, 1] *= self.size[1] / ROWS
        strokes.strokes(view, lines.x, lines.pairs, radius, ends, self._keys, region)
        fade = DEEP / bodies.size if bodies is not None else 0.0
        inked = self._keys, ends, lines.rgb**2.2, fade
        seen = picture.scene, picture.depths, picture.scene_depths
        part = (-1.0 if number == 0 else 1.0) / count
        develop.compose(*inked, *seen, region, self._mean, part, self.picture, self._table, int(number == count - 1))

    def _draw_bodies(self, picture: Stage, bodies: Gels) -> None:
        view, x, normal, tint = picture.view, bodies.x(), bodies.normal, bodies.tint
        scene = picture.scene, picture.scene_depths
        screen = np.zeros_like(x)
        buffers.project(view, x, screen)
        away = [-np.nan_to_num(screen[points, 2]).mean() for points in bodies.points]
        for k in np.argsort(away, kind="stable"):
            first, last = bodies.first[k], bodies.first[k + 1]
            seen, box = screen[bodies.points[k]], self._box_of(screen[bodies.points[k]])
            mesh, places = [x, normal, tint, bodies.faces], screen
            if seen[:, 2].min() <= MIN_DEPTH:
                cut, faces, places, *rows = self._projected(view, x, bodies.faces[first:last], normal, tint)
                mesh, first, last = [cut, *rows, faces], 0, len(faces)
            if last > first and np.all(box[1] > box[0]):
                run = np.array([first, last, *box[0], *box[1]], np.int32)
                buffers.layers(places, mesh[3], run, self._front, self._back, self._thick)
                surface = *mesh, run, self._front, self._back, self._thick
                gel.shade(view, self._studio, bodies.gel[k], bodies.varied, *surface, *scene, self._shaded)
                gel.settle(run, self._front, self._shaded, *scene)

    def _box(self, view: np.ndarray, x: np.ndarray) -> np.ndarray:
        """(2, 2): first column and row, and those after the last, of the part of the picture that points x lie in."""
        if not len(x):
            return np.zeros((2, 2), int)
        screen = np.zeros_like(x)
        buffers.project(view, x, screen)
        return self._box_of(screen)

    def _box_of(self, screen: np.ndarray) -> np.ndarray:
        if not np.isfinite(screen).all() or screen[:, 2].min() <= NEAR:
            return np.array([[0, 0], self.size])
        edge = 4 + self.size[1] // 200
        low, high = np.floor(screen[:, :2].min(0)) - edge, np.ceil(screen[:, :2].max(0)) + edge
        return np.clip(np.stack([low, high]), 0, self.size).astype(int)

    def image(self) -> np.ndarray:
        """(height, width, 3) uint8: a copy of the last picture."""
        runtime.check(self._runtime)
        return rgb_of(self.picture)

    def close(self) -> None:
        """Free the picture's memory."""
        self._stages, self._drawing = [], None


def rgb_of(picture: np.ndarray) -> np.ndarray:
    """(height, width, 3) uint8: a copy of a picture (height, width) uint32."""
    return picture.view(np.uint8).reshape(*picture.shape, 4)[..., :3].copy()


def _union(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The smallest box (2, 2) around two, either of which may be empty."""
    if np.any(a[1] <= a[0]):
        return b
    if np.any(b[1] <= b[0]):
        return a
    return np.stack([np.minimum(a[0], b[0]), np.maximum(a[1], b[1])])
