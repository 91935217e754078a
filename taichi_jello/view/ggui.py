"""The renderer on a Vulkan driver: Taichi's GGUI, into memory or into a window."""

import contextlib
import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator

import numpy as np
import taichi as ti
from taichi.ui.utils import get_field_info

from taichi_jello import runtime
from taichi_jello.runtime import RuntimeProblem, has_vulkan
from taichi_jello.view import palette
from taichi_jello.view.camera import FAR, NEAR, Viewpoint
from taichi_jello.view.drawing import Drawing
from taichi_jello.view.primitives import Triangles
from taichi_jello.view.shading import vec3

ROWS = 720  # line widths are given for a picture this high
FRAMES = 300  # Mesa's software driver leaks half a megabyte a frame until its window is destroyed
ROW = 12  # floats of one vertex in GGUI's own buffers: position 3, normal 3, texture 2, colour 4
UPWARDS = np.array([0.0, 1.0, 0.0], np.float32)
TILE = 16
BACK = 0.8 * FAR  # m; how far behind everything the background hangs


def available() -> bool:
    """Whether a Vulkan driver works here, hardware or software."""
    return has_vulkan()


def window_problem() -> str | None:
    """Why no window can be opened here; None if one can. Without this question GGUI ends the process."""
    if not available():
        return "no Vulkan driver works here"
    if sys.platform.startswith("linux") and not _has_screen():
        shown = os.environ.get("DISPLAY")
        return f"no screen answers at DISPLAY={shown}" if shown else "DISPLAY is not set"
    return None


def require(window: bool) -> None:
    """Raise RuntimeProblem if GGUI cannot draw here."""
    if not available():
        raise RuntimeProblem("ggui: no Vulkan driver works here; install one, or use the renderer raster")
    problem = window_problem() if window else None
    if problem is not None:
        raise RuntimeProblem(f"no window: {problem}; take a shot or a film instead")


_screens: dict[str, int] = {}  # connections to X by DISPLAY


def _has_screen() -> bool:
    """Whether an X server answers.

    The connection stays open: a virtual screen starts anew when its last client leaves, and a window that
    opens meanwhile ends the process."""
    name = os.environ.get("DISPLAY")
    if not name:
        return False
    if name not in _screens:
        try:
            x11 = ctypes.CDLL("libX11.so.6")
        except OSError:
            return False
        x11.XOpenDisplay.restype = ctypes.c_void_p
        connection = x11.XOpenDisplay(name.encode())
        if not connection:
            return False
        _screens[name] = connection
    return True


@contextlib.contextmanager
def _elsewhere() -> Iterator[None]:
    """GGUI leaves an imgui.ini in the directory it works in: lend it one that vanishes."""
    here = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(here)


def _vertices(x: np.ndarray, color: np.ndarray) -> np.ndarray:
    rows = np.empty((len(x), ROW), np.float32)
    rows[:, :3] = x
    rows[:, 3:6] = UPWARDS  # a light of no colour times a normal of no length is not a number
    rows[:, 8 : 8 + color.shape[1]] = color
    if color.shape[1] == 3:
        rows[:, 11] = 1.0
    return rows


class Ggui:
    """Draws with Vulkan. size: (width, height) [pixels]; samples: 1, or 2 for four samples a pixel; window:
    on screen.

    Only one may be open at a time: close() it before the next, and before Taichi starts again."""

    name = "ggui"

    def __init__(self, size: tuple[int, int], samples: int = 2, window: bool = False, title: str = "jello"):
        require(window)
        self._runtime = runtime.current()
        self.size, self.samples, self._shown, self._title = size, samples, window, title
        self._camera = ti.ui.Camera()
        self._open()

    def _open(self) -> None:
        full = tuple(side * self.samples for side in self.size)
        with _elsewhere():
            self.window = ti.ui.Window(self._title, full, vsync=self._shown, show_window=self._shown, pos=(0, 0))
        self.canvas = self.window.get_canvas()
        self._frames = 0

    def draw(self, drawing: Drawing, viewpoint: Viewpoint) -> None:
        runtime.check(self._runtime)
        if self._frames >= FRAMES and not self._shown:
            self.close()
            self._open()
        self._frames += 1
        width, height = self.window.get_window_shape()
        self.canvas.set_background_color(tuple(palette.SKY_LOW))
        scene = self.window.get_scene()
        self._keep: list[np.ndarray] = []  # GGUI reads these when the scene is drawn
        self._aim(scene, viewpoint)
        for width_ in sorted({batch.width for batch in drawing.lines}):
            same = [batch for batch in drawing.lines if batch.width == width_]
            rows = np.concatenate([_vertices(batch.x, batch.rgb) for batch in same])
            self._lines(scene, rows, max(width_ * height / ROWS, 1.0))
        if drawing.dots is not None:
            # GGUI draws discs width/height times too wide.
            self._dots(scene, drawing.dots, drawing.dots.radius * height / width)
        # What is nearer comes first: pixels that it hides are then never shaded.
        self._meshes(scene, [*reversed(drawing.opaque), _background(viewpoint, width / height)])
        if drawing.blended is not None:
            self._meshes(scene, [drawing.blended])
        # Without any light the driver crashes, and with Taichi's own at the origin pixels there turn black.
        scene.point_light((0.0, -1e6, 0.0), (0.0, 0.0, 0.0))
        self.canvas.canvas.scene_v2(scene.scene)

    def _aim(self, scene, viewpoint: Viewpoint) -> None:
        camera = self._camera
        camera.position(*viewpoint.eye)
        camera.lookat(*viewpoint.target)
        camera.up(*(viewpoint.axes()[1] if abs(viewpoint.axes()[2][1]) > 0.999 else (0.0, 1.0, 0.0)))
        camera.fov(viewpoint.fov)
        camera.z_near(NEAR)
        camera.z_far(FAR)
        scene.set_camera(camera)
        scene.ambient_light((1.0, 1.0, 1.0))

    # Taichi's own scene.mesh and its siblings compile a copying kernel anew for every field (0.15 s each);
    # the calls below hand over rows that are ready, as those would after their copy. Each call costs 2 ms on
    # Mesa's software driver, hence few of them.

    def _meshes(self, scene, meshes: list[Triangles]) -> None:
        starts = np.cumsum([0] + [len(mesh.x) for mesh in meshes])
        rows = np.concatenate([_vertices(mesh.x, mesh.rgba) for mesh in meshes])
        index = np.concatenate([mesh.index + start for mesh, start in zip(meshes, starts, strict=False)])
        index = np.ascontiguousarray(index, np.int32).ravel()
        info = get_field_info(rows), get_field_info(index)
        scene.scene.mesh(info[0], True, info[1], (1.0, 1.0, 1.0), False, len(index), 0, len(rows), 0, False)
        self._keep += [rows, index]

    def _lines(self, scene, rows: np.ndarray, width: float) -> None:
        info = get_field_info(rows), get_field_info(None)
        scene.scene.lines(*info, True, (1.0, 1.0, 1.0), width, len(rows), 0, len(rows), 0)
        self._keep += [rows]

    def _dots(self, scene, dots, radius: float) -> None:
        rows = _vertices(dots.x, dots.rgb)
        scene.scene.particles(get_field_info(rows), True, False, (1.0, 1.0, 1.0), radius, len(rows), 0)
        self._keep += [rows]

    def image(self) -> np.ndarray:
        """(height, width, 3) uint8: what was drawn last, a copy. In a window, ask before show()."""
        runtime.check(self._runtime)
        raw = self.window.get_image_buffer_as_numpy()
        width, height = raw.shape[0] // self.samples, raw.shape[1] // self.samples
        image = np.empty((height, width, 3), np.uint8)
        shrink(raw, image, self.samples)
        return image

    def close(self) -> None:
        """Destroy the window. Twice does no harm."""
        if self.window is not None:
            with _elsewhere():
                self.window.destroy()
            self.window = None


def _background(viewpoint: Viewpoint, aspect: float) -> Triangles:
    """The background's two colours on one rectangle far behind everything."""
    right, up, back = viewpoint.axes()
    high = BACK * np.tan(np.radians(viewpoint.fov) / 2.0)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [1.001 * high * aspect, 1.001 * high]
    mesh = Triangles.empty(4, np.array([[0, 1, 2], [0, 2, 3]]))
    mesh.x[:] = viewpoint.eye - BACK * back + corners @ np.stack([right, up])
    mesh.rgba[:, :3] = [palette.SKY_LOW, palette.SKY_LOW, palette.SKY_TOP, palette.SKY_TOP]
    return mesh


@ti.kernel
def shrink(raw: ti.types.ndarray(dtype=ti.f32, ndim=3), image: ti.types.ndarray(dtype=ti.u8, ndim=3), samples: ti.i32):
    """GGUI's picture, columns first and upwards, as rows downwards; each pixel the mean of samples × samples.

    Tile by tile: one of the two is always walked across its memory, and a tile stays in the cache."""
    wide = (image.shape[1] + TILE - 1) // TILE
    high = (image.shape[0] + TILE - 1) // TILE
    ti.loop_config(block_dim=16)
    for tile in range(wide * high):
        left, top = tile % wide * TILE, tile // wide * TILE
        for x in range(left, ti.min(left + TILE, image.shape[1])):
            for y in range(top, ti.min(top + TILE, image.shape[0])):
                total = vec3(0.0)
                for i in range(samples):
                    for j in range(samples):
                        column, row = x * samples + i, (image.shape[0] - 1 - y) * samples + j
                        total += vec3(raw[column, row, 0], raw[column, row, 1], raw[column, row, 2])
                total = total * (255.0 / (samples * samples)) + 0.5
                for k in ti.static(range(3)):
                    image[y, x, k] = ti.cast(total[k], ti.u8)
