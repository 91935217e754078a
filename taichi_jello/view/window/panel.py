"""The panel: sliders for what can be tuned while it runs, buttons, and read-outs. Drawn by GGUI's own widgets."""

from typing import Any

import numpy as np

from taichi_jello.view.picking import Place
from taichi_jello.view.render.legend import ROWS
from taichi_jello.view.window import actions
from taichi_jello.view.window.readouts import ENERGIES
from taichi_jello.view.window.viewer import Viewer

LEFT, TOP = 20.0, 75.0  # from the window's upper left corner, in pixels of a window 720 rows high
SETTLED = 4  # frames after which a button that was let go has told so
SIZE = (380, 370)  # pixels: GGUI's letters are 13 pixels high in any window


class Panel:
    """`rectangle`: where it was drawn last, (left, top, right, bottom) [pixels]; None where it was not. GGUI does not
    tell whose a click is, so that the clicks in there are the panel's."""

    def __init__(self, opened: tuple[int, int]):
        self.opened = opened  # the window's first size [pixels], of which GGUI takes fractions for ever
        self.rectangle: tuple[float, float, float, float] | None = None
        self._pressed = self._used = False
        self._turn = self._left = 0

    def takes(self, at: Place) -> bool:
        """Whether a mouse button that goes down at `at` is meant for the panel."""
        if self.rectangle is None:
            return False
        left, top, right, bottom = self.rectangle
        inside = left <= at[0] < right and top <= at[1] < bottom
        if inside:
            self._pressed, self._left = True, 0
        return inside

    def release(self) -> None:
        """The left button is up."""
        if self._pressed:
            self._pressed, self._left = False, SETTLED

    def _settle(self) -> None:
        """A press that used no widget may have moved or folded the panel, which GGUI does not tell either: under
        another name it is back in its place."""
        self._left -= 1
        if self._left == 0:
            self._turn += not self._used
            self._used = False

    def show(self, gui: Any, viewer: Viewer) -> None:
        """Draw the panel if it is wanted, and do what its widgets were used for."""
        if not viewer.panelled or viewer.helping:
            self.rectangle = None
            return
        width, height = viewer.size
        left, top = LEFT, TOP * height / ROWS
        wide, tall = min(SIZE[0], width - 2.0 * LEFT), min(SIZE[1], height - top - 10.0)
        self.rectangle = (left, top, left + wide, top + tall)
        place = (left / self.opened[0], top / self.opened[1], wide / self.opened[0], tall / self.opened[1])
        # GGUI keeps the place that a name was first shown at: another size of the window needs another name.
        with gui.sub_window(f"jello##{width}x{height}-{self._turn}", *place):
            self._tuning(gui, viewer)
            self._buttons(gui, viewer)
            readings(gui, viewer)
        if self._left:
            self._settle()

    def _slider(self, gui: Any, name: str, value: float, low: float, high: float) -> float | None:
        """The value that the person chose; None if none was."""
        new = gui.slider_float(name, value, low, high)
        if np.float32(new) == np.float32(value):
            return None
        self._used = True
        return float(np.clip(new, low, high))

    def _tuning(self, gui: Any, viewer: Viewer) -> None:
        tuning = viewer.simulation.tuning
        contact = viewer.simulation.first_tuning.get("contact_stiffness") or 2000.0
        changed: dict[str, Any] = {}
        for key, name, low, high in (
            ("stiffness", "stiffness x", 0.1, 10.0),
            ("damping", "damping x", 0.0, 10.0),
            ("friction", "friction", 0.0, 2.0),
            ("contact_stiffness", "contact [N/m]", 0.1 * contact, 10.0 * contact),
        ):
            new = self._slider(gui, name, tuning[key], low, high) if key in tuning else None
            if new is not None:
                changed[key] = new
        if "gravity" in tuning:
            x, y, z = tuning["gravity"]
            new = self._slider(gui, "gravity [m/s2]", y, -20.0, 20.0)
            if new is not None:
                changed["gravity"] = (x, new, z)
        if changed:
            viewer.tune(**changed)
        scale = self._slider(gui, "time x", viewer.pace.scale, 0.05, 2.0)
        viewer.pace.scale = viewer.pace.scale if scale is None else scale

    def _buttons(self, gui: Any, viewer: Viewer) -> None:
        for words, action in (
            (f"method: {viewer.simulation.method}", actions.next_method),
            (f"color: {viewer.color}", actions.next_color),
            (f"show: {viewer.shown}", actions.next_show),
        ):
            if gui.button(words):
                self._used = True
                action(viewer)


def readings(gui: Any, viewer: Viewer) -> None:
    simulation, pace = viewer.simulation, viewer.pace
    gui.text(f"{viewer.rate:.0f} fps, real time x {pace.speed:.2f}")
    gui.text(f"physics {1e3 * pace.cost:.2f} ms a frame, {simulation.substeps} steps")
    gui.text(f"dt {1e3 * viewer.dt:.3g} ms, safe dt {1e3 * simulation.safe_dt:.3g} ms")
    if viewer.gauges.past:
        for name, joules in zip(ENERGIES, viewer.gauges.past[-1][1:], strict=True):
            gui.text(f"{name} energy {joules:.4g} J")
        if viewer.gauges.books:
            gui.text("work {:.4g} J, residual {:.2g} J".format(*viewer.gauges.books))
        gui.text(f"largest spring force {viewer.gauges.force:.3g} N")
