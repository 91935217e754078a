"""The rasteriser: draws with Taichi kernels, without a Vulkan driver."""

import numpy as np

from taichi_jello.support import runtime
from taichi_jello.support.runtime import RuntimeProblem
from taichi_jello.view.camera import Viewpoint
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.drawing import Drawing
from taichi_jello.view.drawing.primitives import ROWS, Lines, Triangles
from taichi_jello.view.render import fill


class Raster:
    """Draws into memory. size: (width, height) [pixels]; samples: 1, or 2 for four samples a pixel."""

    name = "raster"

    def __init__(self, size: tuple[int, int], samples: int = 2):
        self._runtime = runtime.current()
        if self._runtime.arch in ("vulkan", "metal"):
            raise RuntimeProblem(f"raster: needs 64-bit atomics, which {self._runtime.arch} lacks; use --arch cpu")
        self.size, self.samples = size, samples
        width, height = size
        self._pixels = np.zeros((height * samples, width * samples), np.int64)
        self._image = np.zeros((height, width, 3), np.uint8)
        self._last: tuple[object, ...] = ()
        self._background: np.ndarray | None = None
        self._columns: list[np.ndarray] = []
        self._box, self._edge = np.zeros((0, 4), np.int32), np.zeros((0, 9), np.float32)

    def draw(self, drawing: Drawing, viewpoint: Viewpoint) -> None:
        runtime.check(self._runtime)
        height, width = self._pixels.shape
        matrix = viewpoint.to_pixels((width, height)).astype(np.float32)
        self._draw_surroundings(drawing, matrix)
        self._draw_opaque(drawing.shadow_triangles, drawing.spring_lines, matrix)
        dots = drawing.dots
        if dots is not None:
            scale = dots.radius * viewpoint.pixels_per_meter(height)
            fill.dots(self._pixels, matrix, dots.x, dots.rgb, fill.vec3(*viewpoint.eye), scale, dots.radius)
        skin = drawing.blended
        if skin is not None:
            fill.skin(self._pixels, skin.rgba, skin.index, *self._prepare(skin, matrix))

    def _draw_surroundings(self, drawing: Drawing, matrix: np.ndarray) -> None:
        """Draw the background and the colliders. If nothing there has changed, a copy is kept for the next pictures."""
        around = drawing.surroundings
        now = (around, 0 if around is None else around.version, matrix.tobytes())
        again, self._last = now == self._last, now
        if again and self._background is not None:
            np.copyto(self._pixels, self._background)
            return
        fill.backdrop(self._pixels, palette.SKY_TOP, palette.SKY_LOW)
        if around is not None:
            self._draw_opaque([around.triangles], [around.lines], matrix)
        self._background = self._pixels.copy() if again else None

    def _draw_opaque(self, meshes: list[Triangles], batches: list[Lines], matrix: np.ndarray) -> None:
        scale = len(self._pixels) / ROWS
        for mesh in meshes:
            fill.triangles(self._pixels, mesh.rgba, mesh.index, *self._prepare(mesh, matrix))
        for batch in batches:
            if len(batch.x):
                fill.lines(self._pixels, matrix, batch.x, batch.rgb, max(batch.width * scale, 1.0))

    def _prepare(self, mesh: Triangles, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        count = len(mesh.index)
        if count > len(self._box):
            self._box, self._edge = np.zeros((count, 4), np.int32), np.zeros((count, 9), np.float32)
        box, edge = self._box[:count], self._edge[:count]
        height, width = self._pixels.shape
        fill.prepare(matrix, mesh.x, mesh.index, width, height, box, edge)
        return box, edge

    def image(self) -> np.ndarray:
        """(height, width, 3) uint8: a copy of the last picture."""
        runtime.check(self._runtime)
        fill.resolve(self._pixels, self._image, self.samples)
        return self._image.copy()

    def columns(self) -> np.ndarray:
        """(width, height) uint32: the last picture in GGUI's layout, columns first and upwards; reused in two calls."""
        runtime.check(self._runtime)
        if len(self._columns) < 2:
            self._columns = [np.zeros(self.size, np.uint32) for _ in range(2)]
        self._columns.reverse()
        fill.resolve_columns(self._pixels, self._columns[0], self.samples)
        return self._columns[0]

    def close(self) -> None:
        """Free the picture's memory."""
        self._pixels, self._background = np.zeros((0, 0), np.int64), None
