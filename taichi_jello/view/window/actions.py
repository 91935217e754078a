"""What each key does to a Viewer, and the help that lists it all."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from taichi_jello.physics.integrators import schemes
from taichi_jello.scene.description import COLORS
from taichi_jello.view.camera import UP

if TYPE_CHECKING:
    from taichi_jello.view.window.viewer import Viewer

ZOOM = 1.15  # a key press
PUSH = 1.2  # m/s along the ground
JUMP = 3.0  # m/s
SCRUB = 30  # frames of a repeated play
WIND = 5.0  # m/s
GRAVITY = 9.81  # m/s² where the scene has none of its own
ROOM = 1.35  # how much farther the eye goes than where the jello just fits


def pause(viewer: "Viewer") -> None:
    viewer.paused = not viewer.paused
    if not viewer.paused:
        viewer.notice = ""


def restart(viewer: "Viewer") -> None:
    viewer.let_go()
    if viewer.repeating:
        viewer.simulation.scrub(-viewer.simulation.frames)
    else:
        viewer.simulation.reset()
    viewer.pace.rest()


def next_color(viewer: "Viewer") -> None:
    viewer.color = COLORS[(COLORS.index(viewer.color) + 1) % len(COLORS)]
    viewer.notice = f"color: {viewer.color}"


def next_show(viewer: "Viewer") -> None:
    viewer.show_next()
    viewer.notice = f"show: {viewer.shown}"


def ask_photo(viewer: "Viewer") -> None:
    viewer.pictures.asked = True


def toggle_film(viewer: "Viewer") -> None:
    if viewer.filming:
        viewer.stop_film()
    else:
        viewer.start_film()


def toggle_help(viewer: "Viewer") -> None:
    viewer.helping = not viewer.helping


def toggle_panel(viewer: "Viewer") -> None:
    viewer.panelled = not viewer.panelled


def leave(viewer: "Viewer") -> None:
    viewer.leaving = True


def nearer(viewer: "Viewer") -> None:
    viewer.zoom(1.0 / ZOOM)


def farther(viewer: "Viewer") -> None:
    viewer.zoom(ZOOM)


def first_view(viewer: "Viewer") -> None:
    viewer.viewpoint.reset()


def look(viewer: "Viewer") -> None:
    """Turn the eye to the middle of the jellos and go where they just fill the window."""
    x = viewer.simulation.snapshot().x
    view, aspect = viewer.viewpoint, viewer.size[0] / viewer.size[1]
    middle = 0.5 * (x.min(0) + x.max(0))
    radius = max(float(np.linalg.norm(x - middle, axis=1).max()), 0.05)
    half = np.arctan(np.tan(np.radians(view.fov) / 2.0) * min(1.0, aspect))
    view.eye = middle + view.axes()[2] * ROOM * radius / np.sin(half)
    view.target = middle


def jump(viewer: "Viewer") -> None:
    viewer.simulation.push(JUMP * UP)


def push(right: float, forward: float) -> Callable[["Viewer"], None]:
    """Kicks all jellos along the ground, as the eye sees it; while paused, to the right is one frame on. While a play
    is repeated, right and left go through it: frame by frame when paused."""

    def action(viewer: "Viewer") -> None:
        if right and viewer.repeating:
            viewer.simulation.scrub(int(right) * (1 if viewer.paused else SCRUB))
            viewer.notice = f"frame {viewer.simulation.frames} of {viewer.simulation.length}"
        elif viewer.paused and right > 0.0:
            viewer.step()
        elif viewer.paused:
            viewer.notice = "paused: Space goes on"
        else:
            across = viewer.viewpoint.axes()[0]
            viewer.simulation.push(PUSH * (right * across + forward * np.cross(UP, across)))

    return action


def next_gravity(viewer: "Viewer") -> None:
    """Down, up, off; down is what the scene says."""
    own = np.array(viewer.simulation.scene.gravity)
    down = own if own.any() else -GRAVITY * UP
    now = float(np.dot(viewer.simulation.tuning.get("gravity", (0.0, 0.0, 0.0)), down))
    name, turned = ("up", -down) if now > 0.0 else ("off", 0.0 * down) if now < 0.0 else ("down", down)
    if viewer.tune(gravity=tuple(float(part) + 0.0 for part in turned)):
        viewer.notice = f"gravity: {name}"


def next_wind(viewer: "Viewer") -> None:
    """From the left, from the right, calm, as the eye sees it."""
    right = viewer.viewpoint.axes()[0]
    now = float(np.dot(viewer.simulation.tuning.get("wind", (0.0, 0.0, 0.0)), right))
    if now == 0.0:
        name, wind = "from the left", WIND * right
    elif now > 0.0:
        name, wind = "from the right", -WIND * right
    else:
        name, wind = "calm", 0.0 * right
    if viewer.tune(wind=tuple(float(part) + 0.0 for part in wind)):
        viewer.notice = f"wind: {name}"


def next_method(viewer: "Viewer") -> None:
    names = list(schemes())
    now = names.index(viewer.simulation.method)

    def change() -> None:
        for name in names[now + 1 :] + names[:now]:
            try:
                viewer.simulation.change_method(name)
            except ValueError:  # it has no safe step for this scene
                continue
            viewer.notice = viewer.simulation.method_told or f"method: {name}"
            if viewer.unsafe:
                viewer.notice += f"; dt = {viewer.dt:.3g} s is beyond its safe {viewer.simulation.safe_dt:.3g} s"
            return
        viewer.notice = "no other method has a safe step for this scene"

    viewer.wait_for(f"compiling {names[(now + 1) % len(names)]} ...", change)


def next_demo(viewer: "Viewer") -> None:
    """A recording or a replay is of one scene: it ends here."""

    def change() -> None:
        try:
            following = viewer.playlist.following(viewer.simulation.scene)
        except ValueError as error:
            viewer.notice = str(error)
            return
        ended = viewer.end_recording()
        viewer.play(following)
        viewer.notice = ended

    viewer.let_go()
    viewer.wait_for("compiling the next demo ...", change)


KEYS: dict[str, Callable[["Viewer"], None]] = {
    " ": pause, "r": restart, "backspace": restart, "c": next_color, "k": next_show, "p": ask_photo, "h": toggle_help,
    "tab": toggle_panel, "escape": leave, "w": nearer, "s": farther, "f": look, "o": first_view, "j": jump,
    "g": next_gravity, "b": next_wind, "v": toggle_film, "m": next_method, "n": next_demo,
    "left": push(-1.0, 0.0), "right": push(1.0, 0.0), "up": push(0.0, 1.0), "down": push(0.0, -1.0),
}  # fmt: skip
HELP = (
    ("drag the jello", "pull it; let go to throw it"),
    ("Shift drag", "pull it up to you, push it away"),
    ("drag beside it", "turn the view; right drag too"),
    ("middle drag", "move the view"),
    ("W S", "nearer, farther"),
    ("F", "look at the jello"),
    ("O", "the first view again"),
    ("left right up down", "push the jello"),
    ("J", "jump"),
    ("G", "gravity: down, up, off"),
    ("B", "wind: from left, from right, calm"),
    ("Space", "pause, go on"),
    ("right", "one frame, while paused"),
    ("left right", "in a replay: back, on"),
    ("R  BackSpace", "start again"),
    ("M", "next method"),
    ("N", "next demo"),
    ("Tab", "panel and energies"),
    ("C", "what the color shows"),
    ("K", "show: skin, springs, particles"),
    ("P", "save a picture"),
    ("V", "film, end the film"),
    ("H", "this help"),
    ("Esc", "leave"),
)
