"""The renderer on a Vulkan driver: Taichi's GGUI, into memory or into a window."""

import contextlib
import tempfile

import numpy as np
import taichi as ti
from taichi.ui.utils import get_field_info

from taichi_jello.scene.look import Background
from taichi_jello.support import runtime
from taichi_jello.support.runtime import RuntimeProblem, has_vulkan
from taichi_jello.view.camera import FAR, NEAR, UP, Viewpoint
from taichi_jello.view.drawing.drawing import Drawing
from taichi_jello.view.drawing.primitives import ROWS, Triangles
from taichi_jello.view.render.display import display_problem

MAX_FRAMES = 300  # Mesa's software driver leaks half a megabyte a frame until its window is destroyed
VERTEX = 12  # floats of a vertex in GGUI's buffers:
POSITION, NORMAL, COLOR, ALPHA = slice(0, 3), slice(3, 6), slice(8, 11), 11  # its columns
IDENTITY = np.eye(4, dtype=np.float32)
WHITE = (1.0, 1.0, 1.0)
STRIP = 32  # columns of pixels


def available() -> bool:
    """Whether a Vulkan driver works here, hardware or software."""
    return has_vulkan()


def window_problem() -> str | None:
    """Why no window can be opened here; None if one can. GGUI would end the process instead."""
    return display_problem() if available() else "no Vulkan driver works here"


def require(window: bool) -> None:
    """Raise RuntimeProblem if GGUI cannot draw here."""
    if not available():
        raise RuntimeProblem("ggui: no Vulkan driver works here; install one, or use the renderer raster")
    problem = window_problem() if window else None
    if problem is not None:
        raise RuntimeProblem(f"no window: {problem}; take a shot or a film instead")


def vertices(count: int) -> np.ndarray:
    """(count, VERTEX) float32 rows for GGUI, opaque."""
    rows = np.zeros((count, VERTEX), np.float32)
    rows[:, NORMAL] = UP  # black light times a normal of no length would give NaN
    rows[:, ALPHA] = 1.0
    return rows


class Ggui:
    """Draws with Vulkan. size: (width, height) [pixels]; samples: 1, or 2 for four samples a pixel; window: on screen.
    Only one may be open: close() it before the next, and before Taichi starts again."""

    name = "ggui"

    def __init__(self, size: tuple[int, int], samples: int = 2, window: bool = False, title: str = "jello"):
        require(window)
        self._runtime = runtime.current()
        self.size, self.samples, self._shown, self._title = size, samples, window, title
        self._camera = ti.ui.Camera()
        self._open()

    def _open(self) -> None:
        full = tuple(side * self.samples for side in self.size)
        # GGUI writes an imgui.ini into its working directory.
        self._folder = tempfile.TemporaryDirectory()
        with contextlib.chdir(self._folder.name):
            self.window = ti.ui.Window(self._title, full, vsync=self._shown, show_window=self._shown, pos=(0, 0))
        self.canvas = self.window.get_canvas()
        self._frames = 0

    def draw(self, drawing: Drawing, viewpoint: Viewpoint) -> None:
        runtime.check(self._runtime)
        if self._frames >= MAX_FRAMES and not self._shown:
            self.close()
            self._open()
        self._frames += 1
        self._kept: list[np.ndarray] = []  # what GGUI reads when it draws the scene
        width, height = self.window.get_window_shape()
        # A flat picture costs Mesa's software driver a third of what a mesh behind everything does.
        self._kept.append(_background(drawing.scene.background))
        self.canvas.canvas.triangles(get_field_info(self._kept[0]), get_field_info(None), True, WHITE)
        scene = self.window.get_scene()
        self._aim(scene, viewpoint)
        for line_width in sorted({batch.width for batch in drawing.lines}):
            rows = self._rows([(batch.x, batch.rgb) for batch in drawing.lines if batch.width == line_width])
            pixels = max(line_width * height / ROWS, 1.0)
            scene.scene.lines(
                get_field_info(rows), get_field_info(None), True, WHITE, pixels, len(rows), 0, len(rows), 0
            )
        if drawing.dots is not None:
            rows = self._rows([(drawing.dots.x, drawing.dots.rgb)])
            radius = drawing.dots.radius * height / width  # GGUI draws discs width/height times too wide
            scene.scene.particles(get_field_info(rows), True, False, WHITE, radius, len(rows), 0)
        if drawing.opaque:  # the nearer first: pixels that it hides are then never shaded
            self._meshes(scene, [*reversed(drawing.opaque)])
        if drawing.blended is not None:
            self._meshes(scene, [drawing.blended])
        # Without any light the driver crashes, and a light at the origin, Taichi's default, blackens pixels there.
        scene.point_light((0.0, -1e6, 0.0), (0.0, 0.0, 0.0))
        self.canvas.canvas.scene_v2(scene.scene)

    def _aim(self, scene: ti.ui.Scene, viewpoint: Viewpoint) -> None:
        camera = self._camera
        camera.position(*viewpoint.eye)
        camera.lookat(*viewpoint.target)
        camera.up(*(viewpoint.axes()[1] if abs(viewpoint.axes()[2][1]) > 0.999 else (0.0, 1.0, 0.0)))
        camera.fov(viewpoint.fov)
        camera.z_near(NEAR)
        camera.z_far(FAR)
        scene.set_camera(camera)
        scene.ambient_light(WHITE)

    # Taichi's own scene.mesh, lines and particles compile a copying kernel for every field (0.15 s each); these calls
    # hand over finished rows. Each costs 2 ms on Mesa's software driver, hence few of them.

    def _rows(self, parts: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Vertices at the positions (V, 3) and with the colours (V, 3) or (V, 4) of each part."""
        rows, start = vertices(sum(len(x) for x, _ in parts)), 0
        for x, color in parts:
            part = rows[start : start + len(x)]
            part[:, POSITION], part[:, COLOR.start : COLOR.start + color.shape[1]] = x, color
            start += len(x)
        self._kept.append(rows)
        return rows

    def _meshes(self, scene: ti.ui.Scene, meshes: list[Triangles]) -> None:
        rows = self._rows([(mesh.x, mesh.rgba) for mesh in meshes])
        starts = np.cumsum([0, *(len(mesh.x) for mesh in meshes)], dtype=np.int32)
        index = np.concatenate([(mesh.index + start).ravel() for mesh, start in zip(meshes, starts, strict=False)])
        if not len(index):
            return
        self._kept.append(index)
        # One instance at the identity: GGUI moves a mesh without instances by 0 times an uninitialised matrix, which
        # may hold a NaN.
        faces, moved = get_field_info(index), get_field_info(IDENTITY)
        counts = 1, 0, len(index), 0, len(rows), 0
        scene.scene.mesh_instance(get_field_info(rows), True, faces, WHITE, True, moved, *counts, False)

    def image(self) -> np.ndarray:
        """(height, width, 3) uint8: a copy of the last picture. In a window, ask before show()."""
        runtime.check(self._runtime)
        return shrink(self.window.get_image_buffer_as_numpy(), self.samples)

    def show(self) -> None:
        """Put the picture on the screen and begin the next one."""
        with contextlib.chdir(self._folder.name):
            self.window.show()

    def close(self) -> None:
        """Destroy the window, unless it is already closed."""
        if self.window is not None:
            with contextlib.chdir(self._folder.name):
                self.window.destroy()
            self.window = None
            self.remove_folder()

    def remove_folder(self) -> None:
        """Remove GGUI's working directory."""
        self._folder.cleanup()


def _background(background: Background) -> np.ndarray:
    """Two triangles that fill the picture with the background's two colours."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], float)
    rows = vertices(6)
    rows[:, :2] = corners
    low, top = np.array(background.bottom), np.array(background.top)
    rows[:, COLOR] = low + corners[:, 1:] * (top - low)
    return rows


def shrink(raw: np.ndarray, samples: int) -> np.ndarray:
    """(height, width, 3) uint8, rows downwards, of GGUI's picture (columns, rows upwards, 4), float32 from 0 to 1.
    Each pixel is the mean of samples × samples. Strips of columns stay in the cache."""
    width, height = raw.shape[0] // samples, raw.shape[1] // samples
    image = np.empty((height, width), np.uint32)
    for left in range(0, width, STRIP):
        strip = raw[left * samples : (left + STRIP) * samples]
        if samples == 2:
            strip = strip[0::2] + strip[1::2]
            strip = strip[:, 0::2] + strip[:, 1::2]
        strip = strip * np.float32(255.0 / samples**2)
        strip += np.float32(0.5)
        pixels = strip.astype(np.int32).astype(np.uint8).view(np.uint32)[..., 0]
        image[:, left : left + STRIP] = pixels.T[::-1]
    return image.view(np.uint8).reshape(height, width, 4)[..., :3].copy()
