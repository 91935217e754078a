"""The panel of sliders, buttons and readings, made of GGUI widgets."""

from typing import Any

import numpy as np
from taichi.ui.imgui import Gui

from taichi_jello.view.drawing.primitives import ROWS
from taichi_jello.view.picking import Pixel
from taichi_jello.view.window import actions
from taichi_jello.view.window.gauges import ENERGIES
from taichi_jello.view.window.viewer import Viewer

LEFT, TOP = 20.0, 75.0  # of the panel's corner, in pixels of a window 720 rows high
SETTLING_FRAMES = 4  # frames that GGUI may take to report a released button
SIZE = (430, 420)  # pixels: GGUI's font is 13 pixels high at any window size


class Panel:
    """rectangle: (left, top, right, bottom) [pixels] while it is visible. GGUI does not say which clicks its widgets
    used, so every click inside counts as the panel's. opened: the initial size of the window [pixels]."""

    def __init__(self, opened: tuple[int, int]):
        self.opened = opened  # GGUI takes places as fractions of the initial size, even after a resize
        self.rectangle: tuple[float, float, float, float] | None = None
        self._pressed = self._used = False
        self._generation = self._settling = 0

    def takes(self, at: Pixel) -> bool:
        """Whether a click at this place belongs to the panel."""
        if self.rectangle is None:
            return False
        left, top, right, bottom = self.rectangle
        inside = left <= at[0] < right and top <= at[1] < bottom
        if inside:
            self._pressed, self._settling = True, 0
        return inside

    def release(self) -> None:
        """The left button is up."""
        if self._pressed:
            self._pressed, self._settling = False, SETTLING_FRAMES

    def show(self, gui: Gui, viewer: Viewer) -> None:
        """Draw the panel if it is switched on, and apply what the user changed."""
        if not viewer.panelled or viewer.helping:
            self.rectangle = None
            return
        width, height = viewer.size
        left, top = LEFT, TOP * height / ROWS
        wide, tall = min(SIZE[0], width - 2.0 * LEFT), min(SIZE[1], height - top - 10.0)
        self.rectangle = (left, top, left + wide, top + tall)
        place = (left / self.opened[0], top / self.opened[1], wide / self.opened[0], tall / self.opened[1])
        # GGUI remembers the place of a panel by its name, so a new window size needs a new name.
        with gui.sub_window(f"jello##{width}x{height}-{self._generation}", *place):
            self._sliders(gui, viewer)
            self._buttons(gui, viewer)
            read_outs(gui, viewer)
        if self._settling:
            self._settling -= 1
            if not self._settling:
                # A click that used no widget may have moved or collapsed the panel: a new name puts it back.
                self._generation += not self._used
                self._used = False

    def _slider(self, gui: Gui, words: str, key: str, value: float, low: float, high: float) -> float:
        """The value that the user chose, or the old one. GGUI identifies a slider by the text after ###."""
        new = gui.slider_float(f"{words}###{key}", value, low, high)
        if np.float32(new) == np.float32(value):
            return value
        self._used = True
        return float(np.clip(new, low, high))

    def _sliders(self, gui: Gui, viewer: Viewer) -> None:
        tuning = viewer.simulation.tuning
        contact = viewer.simulation.first_tuning.get("contact_stiffness") or 2000.0
        new: dict[str, Any] = {}
        for key, words, low, high in (
            ("stiffness", "stiffness ×{:.1f}", 0.1, 10.0),
            ("damping", "damping ×{:.1f}", 0.0, 10.0),
            ("volume", "volume {:.1f}", 0.0, 20.0),
            ("friction", "friction {:.2f}", 0.0, 2.0),
            ("contact_stiffness", "contact {:.0f} N/m", 0.1 * contact, 10.0 * contact),
        ):
            if key in tuning:
                new[key] = self._slider(gui, words.format(tuning[key]), key, tuning[key], low, high)
        if "gravity" in tuning:
            x, y, z = tuning["gravity"]
            new["gravity"] = (x, self._slider(gui, f"gravity {y:.2f} m/s²", "gravity", y, -20.0, 20.0), z)
        changed = {key: value for key, value in new.items() if value != tuning[key]}
        if changed:
            viewer.tune(**changed)
        scale = viewer.pace.scale
        viewer.pace.scale = self._slider(gui, f"time ×{scale:.2f}", "time", scale, 0.05, 2.0)

    def _buttons(self, gui: Gui, viewer: Viewer) -> None:
        for words, action in (
            (f"method: {viewer.simulation.method}", actions.next_method),
            (f"color: {viewer.color}", actions.next_color),
            (f"show: {viewer.shown}", actions.next_show),
        ):
            if gui.button(words):
                self._used = True
                action(viewer)


def read_outs(gui: Gui, viewer: Viewer) -> None:
    simulation, pace, gauges = viewer.simulation, viewer.pace, viewer.gauges
    gui.text(f"{viewer.rate:.0f} pictures a second, real time ×{pace.speed:.2f}")
    gui.text(f"physics {1e3 * pace.cost:.2f} ms a frame, {simulation.substeps} steps each")
    gui.text(f"step {1e3 * viewer.dt:.3g} ms (safe {1e3 * simulation.safe_dt:.3g} ms)")
    if gauges.past:
        for name, joules in zip(ENERGIES, gauges.past[-1][1:], strict=True):
            gui.text(f"{name} energy {joules:.4g} J")
        if gauges.ledger:
            gui.text("work {:.4g} J, residual {:.2g} J".format(*gauges.ledger))
        gui.text(f"largest spring force {gauges.force:.3g} N")
