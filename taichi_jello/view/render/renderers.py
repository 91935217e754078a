"""Choosing a renderer, and pictures of a simulation."""

import warnings

import numpy as np

from taichi_jello.run.checks.start_warnings import SceneWarning
from taichi_jello.run.replay import Recorded, Replayed
from taichi_jello.run.simulation import Simulation
from taichi_jello.support import runtime
from taichi_jello.support.runtime import RuntimeProblem
from taichi_jello.view.drawing.drawing import Drawing
from taichi_jello.view.render import ggui, raster
from taichi_jello.view.render.legend import legend as legend_sheet

NO_JELLO = "no jello is in the picture: see camera.eye and camera.target, or leave both out"
NAMES = ("auto", "ggui", "raster")
Size = tuple[int, int]  # width and height [pixels]
SIZE: Size = (1280, 720)
Run = Simulation | Recorded | Replayed
Renderer = ggui.Ggui | raster.Raster


def chosen(name: str) -> str:
    """What a renderer's name means here, for pictures, films and the window alike: `auto` is the rasteriser, or GGUI's
    own drawing where Taichi runs on Vulkan or Metal, which lack the 64-bit atomics that the rasteriser needs. Raises
    RuntimeProblem for an unknown name."""
    if name not in NAMES:
        raise RuntimeProblem(f"renderer: expected one of {', '.join(NAMES)}, got {name!r}")
    if name == "auto":
        return "ggui" if runtime.current().arch in raster.ARCHES_WITHOUT else "raster"
    return name


def open_renderer(name: str = "auto", size: Size = SIZE, samples: int = 2) -> Renderer:
    """A renderer into memory; `chosen` says which.
    size: (width, height) [pixels]; samples: 1, or 2 for smooth edges. Close it before Taichi starts again and, if it is
    GGUI, before the next one. Raises RuntimeProblem if it cannot draw."""
    name = chosen(name)
    if min(size) < 16 or max(size) > 8192:
        raise RuntimeProblem(f"size: expected 16 to 8192 pixels a side, got {size[0]} x {size[1]}")
    if samples not in (1, 2):
        raise RuntimeProblem(f"samples: expected 1 or 2, got {samples}")
    if name == "ggui":
        return ggui.Ggui(size, samples)
    return raster.Raster(size, samples)


def drawing_of(simulation: Run, size: Size = SIZE) -> Drawing:
    """The drawing of a simulation for pictures of that size."""
    runtime.current()
    return Drawing(simulation.scene, simulation.body, size[0] / size[1])


def finished(
    renderer: Renderer, drawing: Drawing, simulation: Run, *, color: str = "", legend: bool = True
) -> np.ndarray:
    """(height, width, 3) uint8: the simulation as it is now, with its legend."""
    now = simulation.snapshot()
    drawing.update(now.x, now.v, now.time, color=color, memory=now.memory)
    renderer.draw(drawing, drawing.viewpoint)
    owners = drawing.body.jello
    if not any(drawing.viewpoint.sees(drawing.points[owners == j], renderer.size) for j in range(owners[-1] + 1)):
        warnings.warn(NO_JELLO, SceneWarning, stacklevel=2)
    image = renderer.image()
    if legend:
        legend_sheet(drawing.key, simulation.time, renderer.size).stamp(image)
    return image


def picture(
    simulation: Run,
    size: Size = SIZE,
    renderer: str = "auto",
    color: str = "",
    samples: int = 2,
    legend: bool = True,
) -> np.ndarray:
    """(height, width, 3) uint8: one picture of a simulation as it is now, from its scene's camera.
    color: one of COLORS, by default the scene's. For many pictures, keep a Drawing and a Renderer."""
    drawing, opened = drawing_of(simulation, size), open_renderer(renderer, size, samples)
    try:
        return finished(opened, drawing, simulation, color=color, legend=legend)
    finally:
        opened.close()


def film_strip(
    simulation: Run, size: Size = SIZE, renderer: str = "auto", columns: int = 2, seconds: float | None = None
) -> np.ndarray:
    """(height, width, 3) uint8: columns² moments in one picture, row by row, while the simulation runs on to
    `seconds`, by default the scene's."""
    seconds, start = simulation.scene.seconds if seconds is None else seconds, simulation.time
    width, height = size[0] // columns, size[1] // columns
    drawing, opened = drawing_of(simulation, (width, height)), open_renderer(renderer, (width, height))
    strip = np.full((size[1], size[0], 3), 255, np.uint8)
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
