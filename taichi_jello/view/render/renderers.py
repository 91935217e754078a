"""Choosing a renderer, and one picture of a simulation."""

from typing import Any, Protocol

import numpy as np

from taichi_jello.support import runtime
from taichi_jello.support.runtime import RuntimeProblem
from taichi_jello.view.camera import Viewpoint
from taichi_jello.view.drawing.drawing import Drawing
from taichi_jello.view.render.legend import legend as legend_sheet

NAMES = ("auto", "ggui", "raster")


class Renderer(Protocol):
    """What draws a Drawing into memory."""

    name: str
    size: tuple[int, int]

    def draw(self, drawing: Drawing, viewpoint: Viewpoint) -> None: ...

    def image(self) -> np.ndarray:
        """(height, width, 3) uint8: what was drawn last."""
        ...

    def close(self) -> None: ...


def open_renderer(name: str = "auto", size: tuple[int, int] = (1280, 720), samples: int = 2) -> Renderer:
    """A renderer into memory: `auto` is the rasteriser, or GGUI where Taichi runs on Vulkan or Metal.

    size: (width, height) [pixels]; samples: 1, or 2 for smooth edges. close() it before Taichi starts again
    and, if it is GGUI, before the next one. Raises RuntimeProblem where the wanted one cannot draw.
    """
    if name not in NAMES:
        raise RuntimeProblem(f"renderer: expected one of {', '.join(NAMES)}, got {name!r}")
    if min(size) < 16 or max(size) > 8192:
        raise RuntimeProblem(f"size: expected 16 to 8192 pixels a side, got {size[0]} x {size[1]}")
    if samples not in (1, 2):
        raise RuntimeProblem(f"samples: expected 1 or 2, got {samples}")
    from taichi_jello.view.render import ggui, raster

    if name == "ggui" or (name == "auto" and runtime.current().arch in ("vulkan", "metal")):
        return ggui.Ggui(size, samples)
    return raster.Raster(size, samples)


def window_problem() -> str | None:
    """Why no window can be opened here; None if one can."""
    from taichi_jello.view.render import ggui

    return ggui.window_problem()


def drawing_of(simulation: Any, size: tuple[int, int] = (1280, 720)) -> Drawing:
    """The drawing of a simulation, whatever has a scene, a body and snapshots, for pictures of that size."""
    runtime.current()
    return Drawing(simulation.scene, simulation.body, size[0] / size[1])


def finished(
    renderer: Renderer, drawing: Drawing, simulation: Any, *, color: str = "", legend: bool = True
) -> np.ndarray:
    """(height, width, 3) uint8: the simulation as it is now, drawn into a picture with its legend."""
    now = simulation.snapshot()
    drawing.update(now.x, now.v, now.time, color=color, memory=now.memory)
    renderer.draw(drawing, drawing.viewpoint)
    image = renderer.image()
    if legend:
        legend_sheet(drawing.key, simulation.time, renderer.size).stamp(image)
    return image


def picture(
    simulation: Any,
    size: tuple[int, int] = (1280, 720),
    renderer: str = "auto",
    color: str = "",
    samples: int = 2,
    legend: bool = True,
) -> np.ndarray:
    """One picture (height, width, 3) uint8 of a simulation as it is now, from its scene's camera.

    color: force, strain, family or plain, by default the scene's. For many pictures, keep a Drawing and a
    Renderer.
    """
    drawing = drawing_of(simulation, size)
    opened = open_renderer(renderer, size, samples)
    try:
        return finished(opened, drawing, simulation, color=color, legend=legend)
    finally:
        opened.close()


def film_strip(
    simulation: Any,
    size: tuple[int, int] = (1280, 720),
    renderer: str = "auto",
    columns: int = 2,
    seconds: float | None = None,
) -> np.ndarray:
    """One picture (height, width, 3) uint8 of columns² moments, row by row, from now to `seconds`, by default the
    scene's.

    The simulation runs on to there."""
    seconds, start = simulation.scene.seconds if seconds is None else seconds, simulation.time
    width, height = size[0] // columns, size[1] // columns
    drawing = drawing_of(simulation, (width, height))
    strip = np.full((size[1], size[0], 3), 255, np.uint8)
    opened = open_renderer(renderer, (width, height))
    try:
        for k in range(columns**2):
            until = start + max(seconds - start, 0.0) * k / (columns**2 - 1)
            while simulation.time < until - 0.5 * simulation.frame_dt:
                simulation.frame()
            y, x = k // columns * height, k % columns * width
            strip[y : y + height, x : x + width] = finished(opened, drawing, simulation)
    finally:
        opened.close()
    return strip
