"""The renderer on a Vulkan driver: Taichi's GGUI, into memory or into a window."""

import contextlib
import ctypes
import os
import select
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence

import numpy as np
import taichi as ti
from taichi.ui.utils import get_field_info

from taichi_jello.support import runtime
from taichi_jello.support.runtime import RuntimeProblem, has_vulkan
from taichi_jello.view.camera import FAR, NEAR, Viewpoint
from taichi_jello.view.drawing import palette
from taichi_jello.view.drawing.drawing import Drawing
from taichi_jello.view.drawing.primitives import Dots, Triangles

ROWS = 720  # line widths are given for a picture this high
FRAMES = 300  # Mesa's software driver leaks half a megabyte a frame until its window is destroyed
ROW = 12  # floats of one vertex in GGUI's own buffers: position 3, normal 3, texture 2, colour 4
IDENTITY = np.eye(4, dtype=np.float32)
WHITE = (1.0, 1.0, 1.0)
UPWARDS = np.array([0.0, 1.0, 0.0], np.float32)
STRIP = 32  # columns of pixels


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


def screen_is_gone() -> bool:
    """Whether the X server that answered has left since."""
    if not _screens:
        return False
    connection = ctypes.c_void_p(_screens[os.environ.get("DISPLAY", "")])
    asked = select.poll()
    asked.register(ctypes.CDLL("libX11.so.6").XConnectionNumber(connection), select.POLLRDHUP)
    return bool(asked.poll(500))  # ms: of two connections one hears of it first


class Buffers:
    """What one call hands to GGUI: the first `counts` of `rows` (R, ROW), its vertices, and of `index` (I,).

    They grow by doubling, for what is drawn changes its size from picture to picture."""

    def __init__(self) -> None:
        self.rows, self.index = np.empty((0, ROW), np.float32), np.empty(0, np.int32)
        self.counts = 0, 0

    def fill(self, parts: list[tuple[np.ndarray, np.ndarray]], faces: Sequence[np.ndarray] = ()) -> "Buffers":
        """parts: positions (V, 3) and colours (V, 3) or (V, 4) of each; faces: (T, 3) of each, of its own vertices."""
        self.counts = sum(len(x) for x, _ in parts), sum(face.size for face in faces)
        if self.counts[0] > len(self.rows):
            self.rows = np.zeros((_doubled(self.counts[0]), ROW), np.float32)
            self.rows[:, 3:6] = UPWARDS  # a light of no colour times a normal of no length is not a number
            self.rows[:, 11] = 1.0
        if self.counts[1] > len(self.index):
            self.index = np.zeros(_doubled(self.counts[1]), np.int32)
        start = corner = 0
        for k, (x, color) in enumerate(parts):
            rows = self.rows[start : start + len(x)]
            rows[:, :3] = x
            rows[:, 8 : 8 + color.shape[1]] = color
            if faces:
                np.add(faces[k].ravel(), start, out=self.index[corner : corner + faces[k].size])
                corner += faces[k].size
            start += len(x)
        return self

    @property
    def info(self) -> tuple:
        """No more than is drawn: lines are drawn of all that is handed over, whatever count is asked for."""
        vertices, corners = self.counts
        return get_field_info(self.rows[:vertices]), get_field_info(self.index[:corners] if corners else None)


def _doubled(count: int) -> int:
    return 1 << (count - 1).bit_length()


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
        # GGUI leaves an imgui.ini in the directory it works in, at the end and with a panel also on the way.
        self._desk = tempfile.TemporaryDirectory()
        with contextlib.chdir(self._desk.name):
            self.window = ti.ui.Window(self._title, full, vsync=self._shown, show_window=self._shown, pos=(0, 0))
        self.canvas = self.window.get_canvas()
        self._frames = 0
        self._background = _background()
        self._buffers: dict[str | float, Buffers] = defaultdict(Buffers)  # read when the scene is drawn

    def draw(self, drawing: Drawing, viewpoint: Viewpoint) -> None:
        runtime.check(self._runtime)
        if self._frames >= FRAMES and not self._shown:
            self.close()
            self._open()
        self._frames += 1
        width, height = self.window.get_window_shape()
        # A flat picture costs Mesa's software driver a third of what a mesh behind everything does.
        self.canvas.canvas.triangles(get_field_info(self._background), get_field_info(None), True, WHITE)
        scene = self.window.get_scene()
        self._aim(scene, viewpoint)
        for width_ in sorted({batch.width for batch in drawing.lines}):
            same = [(batch.x, batch.rgb) for batch in drawing.lines if batch.width == width_]
            self._lines(scene, same, width_, max(width_ * height / ROWS, 1.0))
        if drawing.dots is not None:
            # GGUI draws discs width/height times too wide.
            self._dots(scene, drawing.dots, drawing.dots.radius * height / width)
        if drawing.opaque:  # what is nearer comes first: pixels that it hides are then never shaded
            self._meshes(scene, "opaque", [*reversed(drawing.opaque)])
        if drawing.blended is not None:
            self._meshes(scene, "blended", [drawing.blended])
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
        scene.ambient_light(WHITE)

    # Taichi's own scene.mesh and its siblings compile a copying kernel anew for every field (0.15 s each);
    # the calls below hand over rows that are ready, as those would after their copy. Each call costs 2 ms on
    # Mesa's software driver, hence few of them.

    def _meshes(self, scene, name: str, meshes: list[Triangles]) -> None:
        buffers = self._buffers[name].fill([(mesh.x, mesh.rgba) for mesh in meshes], [mesh.index for mesh in meshes])
        vertices, corners = buffers.counts
        if not corners:
            return
        rows, index = buffers.info
        # One instance, which stays where it is. GGUI moves what is no instance by 0 times a matrix that nobody has
        # written, and where that memory holds a NaN nothing is drawn.
        moved = get_field_info(IDENTITY)
        scene.scene.mesh_instance(rows, True, index, WHITE, True, moved, 1, 0, corners, 0, vertices, 0, False)

    def _lines(self, scene, parts: list[tuple[np.ndarray, np.ndarray]], name: float, width: float) -> None:
        buffers = self._buffers[name].fill(parts)
        vertices = buffers.counts[0]
        if vertices:
            scene.scene.lines(*buffers.info, True, WHITE, width, vertices, 0, vertices, 0)

    def _dots(self, scene, dots: Dots, radius: float) -> None:
        buffers = self._buffers["dots"].fill([(dots.x, dots.rgb)])
        count = buffers.counts[0]
        if count:
            scene.scene.particles(buffers.info[0], True, False, WHITE, radius, count, 0)

    def image(self) -> np.ndarray:
        """(height, width, 3) uint8: what was drawn last, a copy. In a window, ask before show()."""
        runtime.check(self._runtime)
        return shrink(self.window.get_image_buffer_as_numpy(), self.samples)

    def show(self) -> None:
        """Put what was drawn on the screen; the next picture begins."""
        with contextlib.chdir(self._desk.name):
            self.window.show()

    def close(self) -> None:
        """Destroy the window. Twice does no harm."""
        if self.window is not None:
            with contextlib.chdir(self._desk.name):
                self.window.destroy()
            self.window = None
            self.leave_desk()

    def leave_desk(self) -> None:
        """Remove the folder that GGUI works in."""
        self._desk.cleanup()


def _background() -> np.ndarray:
    """GGUI's rows for two triangles that fill the picture with the background's two colours."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], float)
    rows = np.zeros((6, ROW), np.float32)
    rows[:, :2] = corners
    rows[:, 8:11] = palette.SKY_LOW + corners[:, 1:] * (palette.SKY_TOP - palette.SKY_LOW)
    rows[:, 11] = 1.0
    return rows


def shrink(raw: np.ndarray, samples: int) -> np.ndarray:
    """(height, width, 3) uint8, rows downwards, of GGUI's picture: (columns, rows upwards, 4) float32 from 0 to 1.

    Each pixel is the mean of samples × samples. By strips of columns, so that what is worked on stays in the cache."""
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
