"""What each key does to a Viewer, and the help that lists them."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_jello.physics.integrators import schemes
from taichi_jello.scene.description import COLORS, SHOWS
from taichi_jello.view.camera import UP

if TYPE_CHECKING:
    from taichi_jello.view.window.viewer import Viewer

Action = Callable[["Viewer"], Any]
ZOOM = 1.15
PUSH = 1.2  # m/s along the ground
JUMP = 3.0  # m/s
SCRUB = 30  # frames skipped in a replay
WIND = 5.0  # m/s
GRAVITY = 9.81  # m/s² if the scene has none
FRAMING = 1.35  # camera distance, as a multiple of that at which the jello just fits


def pause(viewer: "Viewer") -> None:
    viewer.paused = not viewer.paused
    if not viewer.paused:
        viewer.notice = ""


def restart(viewer: "Viewer") -> None:
    viewer.let_go()
    if viewer.replay:
        viewer.replay.scrub(-viewer.replay.frames)
    else:
        viewer.simulation.reset()
    viewer.pace.in_real_time()


def next_color(viewer: "Viewer") -> None:
    viewer.color = COLORS[(COLORS.index(viewer.color) + 1) % len(COLORS)]
    viewer.notice = f"color: {viewer.color}"


def next_show(viewer: "Viewer") -> None:
    viewer.shown = SHOWS[(SHOWS.index(viewer.shown) + 1) % len(SHOWS)]
    viewer.notice = f"show: {viewer.shown}"


def toggle_film(viewer: "Viewer") -> None:
    """Start or stop a film. While filming, physics waits for each picture, so that none is dropped."""
    if viewer.filming:
        viewer.notice = viewer.pictures.stop_film()
    else:
        viewer.notice = viewer.pictures.start_film(viewer.simulation, viewer.size)


def toggle(name: str) -> Action:
    """An action that flips a boolean attribute of the viewer."""
    return lambda viewer: setattr(viewer, name, not getattr(viewer, name))


def switch_on(name: str) -> Action:
    return lambda viewer: setattr(viewer, name, True)


def frame_jello(viewer: "Viewer") -> None:
    """Point the camera at the centre of the jellos, from a distance at which they fit the window."""
    x = viewer.simulation.snapshot().x
    view, aspect = viewer.viewpoint, viewer.size[0] / viewer.size[1]
    middle = 0.5 * (x.min(0) + x.max(0))
    radius = max(float(np.linalg.norm(x - middle, axis=1).max()), 0.05)
    half = np.arctan(np.tan(np.radians(view.fov) / 2.0) * min(1.0, aspect))
    view.eye = middle + view.axes()[2] * FRAMING * radius / np.sin(half)
    view.target = middle


def push(right: float, forward: float) -> Action:
    """An action that pushes all jellos along the ground, in screen directions. While paused, Right advances one frame;
    in a replay, Left and Right scrub."""

    def action(viewer: "Viewer") -> None:
        replay = viewer.replay
        if right and replay:
            replay.scrub(int(right) * (1 if viewer.paused else SCRUB))
            viewer.notice = f"frame {replay.frames} of {replay.length}"
        elif viewer.paused and right > 0.0:
            viewer.step()
        elif viewer.paused:
            viewer.notice = "paused: press Space to resume"
        else:
            across = viewer.viewpoint.axes()[0]
            viewer.simulation.push(PUSH * (right * across + forward * np.cross(UP, across)))

    return action


def cycle(viewer: "Viewer", key: str, own: np.ndarray, names: tuple[str, str, str]) -> None:
    """Cycle the vector `key` of the tuning: `own`, its opposite, zero."""
    now = float(np.dot(viewer.simulation.tuning.get(key, (0.0, 0.0, 0.0)), own))
    turn = 1 if now > 0.0 else 2 if now < 0.0 else 0
    vector = (own, -own, 0.0 * own)[turn]
    if viewer.tune(**{key: tuple(float(part) + 0.0 for part in vector)}):
        viewer.notice = f"{key}: {names[turn]}"


def next_gravity(viewer: "Viewer") -> None:
    own = np.array(viewer.simulation.scene.gravity)
    cycle(viewer, "gravity", own if own.any() else -GRAVITY * UP, ("down", "up", "off"))


def next_wind(viewer: "Viewer") -> None:
    cycle(viewer, "wind", WIND * viewer.viewpoint.axes()[0], ("from the left", "from the right", "calm"))


def next_method(viewer: "Viewer") -> None:
    """Switch to the next method that has a safe step for the scene."""
    names = list(schemes())
    now = names.index(viewer.simulation.method)

    def change() -> None:
        for name in names[now + 1 :] + names[:now]:
            try:
                viewer.simulation.change_method(name)
            except ValueError:
                continue
            viewer.notice = viewer.simulation.method_told or f"method: {name}"
            if viewer.unsafe:
                viewer.notice += f"; dt = {viewer.dt:.3g} s is beyond its safe {viewer.simulation.safe_dt:.3g} s"
            return
        viewer.notice = "no other method has a safe step for this scene"

    viewer.do_later(f"compiling {names[(now + 1) % len(names)]} ...", change)


def next_demo(viewer: "Viewer") -> None:
    """Open the next demo. A recording or replay covers one scene only, so it ends here."""

    def change() -> None:
        try:
            following = viewer.playlist.following(viewer.simulation.scene)
        except ValueError as error:
            viewer.notice = str(error)
            return
        ended = viewer.end_recording()
        viewer.open(following)
        viewer.pace.in_real_time()
        viewer.notice = ended

    viewer.let_go()
    viewer.do_later("compiling the next demo ...", change)


KEYS: dict[str, Action] = {
    " ": pause, "r": restart, "backspace": restart, "escape": switch_on("leaving"), "p": switch_on("wants_picture"),
    "h": toggle("helping"), "tab": toggle("panelled"), "v": toggle_film, "c": next_color, "k": next_show,
    "f": frame_jello, "g": next_gravity, "b": next_wind, "m": next_method, "n": next_demo,
    "o": lambda viewer: viewer.viewpoint.reset(), "j": lambda viewer: viewer.simulation.push(JUMP * UP),
    "w": lambda viewer: viewer.zoom(1.0 / ZOOM), "s": lambda viewer: viewer.zoom(ZOOM),
    "left": push(-1.0, 0.0), "right": push(1.0, 0.0), "up": push(0.0, 1.0), "down": push(0.0, -1.0),
}  # fmt: skip
HELP = (
    ("drag the jello", "pull it; let go to throw it"),
    ("Shift drag", "pull it closer, push it away"),
    ("drag beside it", "orbit the camera; also right drag"),
    ("middle drag", "pan the camera"),
    ("W S", "zoom in, out (no wheel)"),
    ("F", "look at the jello"),
    ("O", "reset the view"),
    ("left right up down", "push the jello"),
    ("J", "jump"),
    ("G", "gravity: up, off, down"),
    ("B", "wind: from left, from right, calm"),
    ("Space", "pause, resume"),
    ("right", "advance a frame while paused"),
    ("left right", "in a replay: back, forward"),
    ("R  BackSpace", "restart in real time"),
    ("M", "next method"),
    ("N", "next demo"),
    ("Tab", "show or hide the panel"),
    ("C", "next color mode"),
    ("K", "show: skin, springs, particles"),
    ("P", "save a picture"),
    ("V", "start or stop a film"),
    ("H", "this help"),
    ("Esc", "quit"),
)
