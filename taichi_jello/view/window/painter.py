"""The rasteriser's pictures in a window, and when to redraw them."""

import time

import numpy as np

from taichi_jello.view.render.legend import Sheet
from taichi_jello.view.render.pixels import develop, ink
from taichi_jello.view.render.raster import Raster, rgb_of
from taichi_jello.view.window.fineness import LEVELS, Fineness
from taichi_jello.view.window.viewer import Viewer

FINEST = len(LEVELS) - 1
REST = 0.15  # s without a change, after which the picture is redrawn with antialiasing


class Painter:
    """Draws what a viewer shows, with the kernels that also draw pictures and films. A moving view is drawn as finely
    as time allows; a still view is drawn once, as finely as by `jello shot`."""

    def __init__(self) -> None:
        self.fineness = Fineness()
        self.level = 0  # of the last picture
        self._moment: tuple[object, ...] = ()
        self._image = np.zeros((1, 1), np.uint32)  # the last picture; _page: at window size, with the overlay
        self._page = np.zeros((1, 1), np.uint32)
        self._columns = [np.zeros((1, 1), np.uint32) for _ in range(2)]
        self._rasters: dict[int, Raster] = {}
        self._since = 0.0  # when the last picture was drawn [s]

    def draw(self, viewer: Viewer, finest: bool = False) -> None:
        """Draw the viewer's picture, unless the last one is still up to date and at least as fine."""
        now, moment = time.perf_counter(), viewer.moment()
        still = moment == self._moment
        level = FINEST if finest or (still and now - self._since > REST) else self.fineness.level
        if still and level <= self.level:
            return
        raster = self._raster(level, viewer.size)
        raster.draw(viewer.drawing, viewer.viewpoint)
        self._image, self.level, self._moment = raster.picture, level, moment
        self._since = time.perf_counter()
        if level == self.fineness.level and not still:
            self.fineness.took(self._since - now)

    def image(self, viewer: Viewer) -> np.ndarray:
        """(height, width, 3) uint8: a copy of the last picture, redrawn at full resolution if that one was smaller."""
        if LEVELS[self.level][0] > 1:
            self.draw(viewer, finest=True)
        return rgb_of(self._image)

    def under(self, sheet: Sheet) -> np.ndarray:
        """(columns, rows) uint32 in GGUI's layout, rows upwards: the last picture with the overlay `sheet` on top, at
        window size. The array is reused after two calls."""
        width, height = sheet.size
        if self._page.shape != (height, width):
            self._page = np.zeros((height, width), np.uint32)
            self._columns = [np.zeros((width, height), np.uint32) for _ in range(2)]
        if self._image.shape == self._page.shape:
            np.copyto(self._page, self._image)
        else:
            ink.double(self._image, self._page)
        ink.write(sheet, self._page)
        self._columns.reverse()
        develop.columns_of(self._page, self._columns[0])
        return self._columns[0]

    def _raster(self, level: int, window: tuple[int, int]) -> Raster:
        coarse, samples = LEVELS[level]  # 2 or 1
        size = -(-window[0] // coarse), -(-window[1] // coarse)
        if level not in self._rasters or self._rasters[level].size != size:
            self._rasters[level] = Raster(size, samples)
        return self._rasters[level]
