"""The frames of a film: which moment each one shows, and its picture or mesh."""

from dataclasses import replace
from fractions import Fraction

import numpy as np

from taichi_jello.film.writer import Mesh
from taichi_jello.run.clock import steps_in
from taichi_jello.run.simulation import Simulation
from taichi_jello.support import runtime
from taichi_jello.view.render.renderers import Renderer, Run, drawing_of, finished, open_renderer


class Clock:
    """Steps a simulation to the frames of a film: frame k is speed·k/rate seconds from now, to the nearest substep."""

    def __init__(self, simulation: Run, rate: Fraction, speed: float = 1.0):
        self.simulation, self.per_frame = simulation, speed / float(rate)
        self._done = 0

    def frames(self, seconds: float) -> int:
        """Frames in so many simulated seconds, at least 1."""
        return max(1, steps_in(seconds, self.per_frame))

    def go(self, frame: int) -> None:
        """Step to the moment of this frame, unless it is past."""
        target = round(frame * self.per_frame / self.simulation.dt)
        if target > self._done:
            self.simulation.step(target - self._done)
            self._done = target


def open_film_renderer(name: str, size: tuple[int, int]) -> Renderer:
    """The renderer for many pictures. On a software Vulkan driver GGUI draws rough edges: smooth ones take too long."""
    drawn_by_ggui = name == "ggui" or (name == "auto" and runtime.current().arch in ("vulkan", "metal"))
    rough = drawn_by_ggui and not runtime.has_real_vulkan()
    return open_renderer(name, size, samples=1 if rough else 2)


class Pictures:
    """Pictures of a simulation, (height, width, 3) uint8; close() when done. orbit: turns a second of the camera, in
    place of the scene's."""

    def __init__(self, simulation: Run, size: tuple[int, int], renderer: str = "auto", orbit: float | None = None):
        self.simulation, self.drawing = simulation, drawing_of(simulation, size)
        if orbit is not None:
            self.drawing.camera = replace(self.drawing.camera, orbit=orbit)
        self.renderer = open_film_renderer(renderer, size)

    def take(self) -> np.ndarray:
        return finished(self.renderer, self.drawing, self.simulation)

    def close(self) -> None:
        self.renderer.close()


class Skins:
    """The skin of a simulation as Mesh, coloured as the scene's camera sees it. Raises ValueError without a skin."""

    def __init__(self, simulation: Simulation):
        self.simulation, self.drawing = simulation, drawing_of(simulation)
        if self.drawing.skin is None:
            raise ValueError("this scene has no skin to write as a mesh")
        self.drawing.hidden |= {"springs", "particles"}

    def take(self) -> Mesh:
        now = self.simulation.snapshot()
        self.drawing.update(now.x, now.v, now.time, memory=now.memory)
        skin, painted = self.drawing.skin, self.drawing.blended
        assert skin is not None and painted is not None
        # The skin's own index: that of its triangles is sorted anew for every picture.
        rgb = np.round(255.0 * painted.rgba[:, :3].clip(0.0, 1.0)).astype(np.uint8)
        return Mesh(painted.x.copy(), rgb, skin.index)

    def close(self) -> None:
        pass
