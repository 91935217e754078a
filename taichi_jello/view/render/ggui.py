"""The renderer on a Vulkan driver: Taichi's GGUI, into memory or into a window."""

import contextlib
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti
from taichi.ui.utils import get_field_info

from taichi_jello.support import runtime
from taichi_jello.support.runtime import RuntimeProblem, has_vulkan
from taichi_jello.view.camera import FAR, NEAR, UP, Viewpoint
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.drawing import Drawing
from taichi_jello.view.drawing.primitives import ROWS, Dots, Triangles
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


class Buffers:
    """Vertices and triangles for one call to GGUI; they grow by doubling."""

    def __init__(self) -> None:
        self.rows, self.index = vertices(0), np.empty(0, np.int32)
        self.counts = 0, 0  # of rows and index entries in use

    def fill(self, parts: list[tuple[np.ndarray, np.ndarray]], faces: Sequence[np.ndarray] = ()) -> "Buffers":
        """parts: positions (V, 3) and colours (V, 3) or (V, 4); faces: (T, 3) of each part's own vertices."""
        self.counts = sum(len(x) for x, _ in parts), sum(face.size for face in faces)
        if self.counts[0] > len(self.rows):
            self.rows = vertices(_doubled(self.counts[0]))
        if self.counts[1] > len(self.index):
            self.index = np.zeros(_doubled(self.counts[1]), np.int32)
        start = corner = 0
        for k, (x, color) in enumerate(parts):
            rows = self.rows[start : start + len(x)]
            rows[:, POSITION] = x
            rows[:, COLOR.start : COLOR.start + color.shape[1]] = color
            if faces:
                np.add(faces[k].ravel(), start, out=self.index[corner : corner + faces[k].size])
                corner += faces[k].size
            start += len(x)
        return self

    @property
    def info(self) -> tuple[Any, Any]:
        """For GGUI, which draws all lines that it gets, whatever count it is asked for."""
        used, corners = self.counts
        return get_field_info(self.rows[:used]), get_field_info(self.index[:corners] if corners else None)


def _doubled(count: int) -> int:
    return 1 << (count - 1).bit_length()


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
        self._background = _background()
        self._buffers: dict[str | float, Buffers] = defaultdict(Buffers)  # GGUI reads them when it draws the scene

    def draw(self, drawing: Drawing, viewpoint: Viewpoint) -> None:
        runtime.check(self._runtime)
        if self._frames >= MAX_FRAMES and not self._shown:
            self.close()
            self._open()
        self._frames += 1
        width, height = self.window.get_window_shape()
        # A flat picture costs Mesa's software driver a third of what a mesh behind everything does.
        self.canvas.canvas.triangles(get_field_info(self._background), get_field_info(None), True, WHITE)
        scene = self.window.get_scene()
        self._aim(scene, viewpoint)
        for line_width in sorted({batch.width for batch in drawing.lines}):
            same = [(batch.x, batch.rgb) for batch in drawing.lines if batch.width == line_width]
            buffers = self._buffers[line_width].fill(same)
            count, pixels = buffers.counts[0], max(line_width * height / ROWS, 1.0)
            scene.scene.lines(*buffers.info, True, WHITE, pixels, count, 0, count, 0)
        if drawing.dots is not None:
            # GGUI draws discs width/height times too wide.
            self._dots(scene, drawing.dots, drawing.dots.radius * height / width)
        if drawing.opaque:  # the nearer first: pixels that it hides are then never shaded
            self._meshes(scene, "opaque", [*reversed(drawing.opaque)])
        if drawing.blended is not None:
            self._meshes(scene, "blended", [drawing.blended])
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

    def _meshes(self, scene: ti.ui.Scene, name: str, meshes: list[Triangles]) -> None:
        buffers = self._buffers[name].fill([(mesh.x, mesh.rgba) for mesh in meshes], [mesh.index for mesh in meshes])
        count, corners = buffers.counts
        if not corners:
            return
        rows, index = buffers.info
        # One instance at the identity: GGUI moves a mesh without instances by 0 times an uninitialised matrix, which
        # may hold a NaN.
        moved = get_field_info(IDENTITY)
        scene.scene.mesh_instance(rows, True, index, WHITE, True, moved, 1, 0, corners, 0, count, 0, False)

    def _dots(self, scene: ti.ui.Scene, dots: Dots, radius: float) -> None:
        buffers = self._buffers["dots"].fill([(dots.x, dots.rgb)])
        scene.scene.particles(buffers.info[0], True, False, WHITE, radius, buffers.counts[0], 0)

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


def _background() -> np.ndarray:
    """GGUI's rows for two triangles that fill the picture with the background's two colours."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], float)
    rows = vertices(6)
    rows[:, :2] = corners
    rows[:, COLOR] = palette.SKY_LOW + corners[:, 1:] * (palette.SKY_TOP - palette.SKY_LOW)
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
