"""Someone in front of a real window on a virtual screen."""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
PROGRAM = """
import json, os, sys
sys.path.insert(0, sys.argv[1])
from dataclasses import replace
from still import Still, cube_scene
from taichi_jello import runtime
from taichi_jello.physics.forces.grab import Grab
from taichi_jello.run.simulation import Simulation
from taichi_jello.view.window.play import play
from taichi_jello.view.window.viewer import Viewer
runtime.start()
scene = replace(cube_scene(0.5, 3), title="probe", force=(Grab(),))
simulation = Simulation(scene) if sys.argv[3] == "real" else Still(scene)
press = Viewer.handle_key
def heard(viewer, key):
    done = press(viewer, key)
    resets = getattr(viewer.simulation, "resets", 0)
    print("key", repr(key), viewer.paused, resets, round(viewer.simulation.time, 4), flush=True)
    return done
Viewer.handle_key = heard
drag = Viewer.drag
def dragged(viewer, *motion):
    drag(viewer, *motion)
    print("drag", motion[0], flush=True)
Viewer.drag = dragged
update = Viewer.update
frames = 0
def updated(viewer):
    global frames
    update(viewer)
    frames += 1
    now, held = viewer.simulation.snapshot(), viewer.simulation.held
    told = dict(frames=frames, title=viewer.simulation.scene.title, time=now.time, paused=viewer.paused)
    told |= dict(color=viewer.color, show=viewer.shown, panel=viewer.panelled, helping=viewer.helping)
    told |= dict(eye=viewer.viewpoint.eye.tolist(), compiled=getattr(viewer.simulation, "compiled", True))
    places = viewer.viewpoint.project(now.x, viewer.size)
    told |= dict(box=[*places.min(0).tolist(), *places.max(0).tolist()])
    told |= dict(method=viewer.simulation.method, tuning={k: str(v) for k, v in viewer.simulation.tuning.items()})
    told |= dict(stiffness=viewer.simulation.tuning["stiffness"], middle=now.x.mean(0).tolist())
    told |= dict(velocity=now.v.mean(0).tolist(), held=None, notice=viewer.notice)
    if held is not None:
        told["held"] = [viewer.viewpoint.project(p[None], viewer.size)[0].tolist() for p in (held.point, held.target)]
    with open("state.new", "w") as file:
        json.dump(told, file)
    os.replace("state.new", "state")
Viewer.update = updated
play(simulation, size=(640, 360), folder=sys.argv[2], renderer=sys.argv[4])
print("left", flush=True)
"""


def virtual_screen():
    """A virtual screen on a number that Xvfb finds free itself; it outlives its clients (-noreset) and keeps its pixels
    in a file. Its process, and the environment of programs that draw there."""
    reading, writing = os.pipe()
    pixels = tempfile.mkdtemp()
    command = ["Xvfb", "-displayfd", str(writing), "-noreset", "-fbdir", pixels, "-screen", "0", "800x600x24"]
    server = subprocess.Popen(command, pass_fds=[writing], stderr=subprocess.DEVNULL)
    os.close(writing)
    with os.fdopen(reading) as answer:
        number = answer.readline().strip()
    assert number, "Xvfb did not start"
    return server, {**os.environ, "DISPLAY": f":{number}", "PIXELS": f"{pixels}/Xvfb_screen0"}


def pixels_of(path: str) -> np.ndarray:
    """(height, width, 3) uint8 of a screen kept in X's window dump format: a header of 4-byte words, a table of colours
    with 12 bytes each, rows of blue, green, red and an empty byte."""
    raw = Path(path).read_bytes()
    header = np.frombuffer(raw, ">u4", 25).astype(int)
    begins, width, height, row, colors = header[[0, 4, 5, 12, 19]]
    dots = np.frombuffer(raw, np.uint8, row * height, begins + 12 * colors)
    return dots.reshape(height, row // 4, 4)[:, :width, 2::-1]


class Person:
    """Someone in front of the window."""

    def __init__(self, environment: dict[str, str], folder: Path, kind: str = "still", renderer: str = "auto"):
        command = [sys.executable, "-c", PROGRAM, str(HERE), str(folder), kind, renderer]
        self.environment, self.folder = environment, folder
        log = (folder / "log").open("w")
        self.viewer = subprocess.Popen(command, env=environment, cwd=folder, stdout=log, stderr=subprocess.STDOUT)
        log.close()
        window = self.wait_for(lambda: self.tool("search", "--name", "^probe$"), 120.0).split()[0]
        self.tool("windowfocus", window)
        self.window = window
        self.wait_for((folder / "state").exists, 120.0)  # a first picture is compiled first
        self.watch()

    @property
    def log(self) -> str:
        return (self.folder / "log").read_text()

    def tool(self, *arguments: str) -> str:
        return subprocess.run(["xdotool", *arguments], env=self.environment, capture_output=True, text=True).stdout

    def wait_for(self, question, seconds: float = 60.0):
        """The first true answer; fails with the program's output when none comes."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            answer = question()
            if answer:
                return answer
            assert self.viewer.poll() is None or "left" in self.log, self.log
            time.sleep(0.05)
        raise AssertionError(f"no answer in {seconds} s; the window said:\n{self.log}")

    def watch(self, frames: int = 2) -> None:
        """Wait until so many more pictures were drawn: after two, what was done before them has been heard."""
        before = self.state["frames"]
        self.wait_for(lambda: self.state["frames"] >= before + frames)

    def press(self, key: str, name: str) -> str:
        """Press a key until the window has heard it; what it says of it."""
        before = self.log.count(f"key {name!r}")
        self.tool("key", key)
        self.wait_for(lambda: self.log.count(f"key {name!r}") > before)
        return [line for line in self.log.splitlines() if line.startswith(f"key {name!r}")][-1]

    @property
    def state(self) -> dict:
        """What the window showed last."""
        return json.loads((self.folder / "state").read_text())

    def seen(self) -> np.ndarray:
        """(360, 640, 3) int: the window's pixels as they are on the screen."""
        return pixels_of(self.environment["PIXELS"])[:360, :640].astype(int)

    def mouse(self, *places: tuple[float, float]) -> None:
        for column, row in places:
            self.tool("mousemove", str(round(column)), str(round(row)))
            self.watch()

    def button(self, does: str, which: int) -> None:
        self.tool(f"mouse{does}", str(which))
        self.watch()

    def pictures(self) -> list[Path]:
        return sorted(self.folder.glob("*.png"))
