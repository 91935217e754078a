"""A real window on a virtual screen, driven by synthetic keys and mouse."""

import ctypes
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from taichi_jello.view import ggui

HERE = Path(__file__).parent
TOOLS = ("Xvfb", "xdotool")
pytestmark = [
    pytest.mark.window,
    pytest.mark.skipif(not all(shutil.which(tool) for tool in TOOLS), reason=f"needs {' and '.join(TOOLS)}"),
    pytest.mark.skipif(not ggui.available(), reason="no Vulkan driver works here"),
]
PROGRAM = """
import sys
sys.path.insert(0, sys.argv[1])
from still import Still, cube_scene
from dataclasses import replace
from taichi_jello import runtime
from taichi_jello.view.viewer import Viewer, play
runtime.start()
simulation = Still(replace(cube_scene(0.5, 3), title="probe"))
told = []
press = Viewer.handle_key
def heard(viewer, key):
    done = press(viewer, key)
    print("key", repr(key), viewer.paused, simulation.resets, round(simulation.time, 4), flush=True)
    return done
Viewer.handle_key = heard
drag = Viewer.drag
def dragged(viewer, *motion):
    drag(viewer, *motion)
    print("drag", motion[0], flush=True)
Viewer.drag = dragged
play(simulation, size=(640, 360), folder=sys.argv[2])
print("left", flush=True)
"""


@pytest.fixture(scope="module")
def screen():
    """A virtual screen on a number that Xvfb finds free itself; it outlives its clients (-noreset)."""
    reading, writing = os.pipe()
    command = ["Xvfb", "-displayfd", str(writing), "-noreset", "-screen", "0", "800x600x24"]
    server = subprocess.Popen(command, pass_fds=[writing], stderr=subprocess.DEVNULL)
    os.close(writing)
    with os.fdopen(reading) as answer:
        number = answer.readline().strip()
    assert number, "Xvfb did not start"
    yield {**os.environ, "DISPLAY": f":{number}"}
    server.terminate()
    server.wait(10)


class Person:
    """Someone in front of the window."""

    def __init__(self, environment: dict[str, str], folder: Path):
        command = [sys.executable, "-c", PROGRAM, str(HERE), str(folder)]
        self.environment, self.folder = environment, folder
        log = (folder / "log").open("w")
        self.viewer = subprocess.Popen(command, env=environment, cwd=folder, stdout=log, stderr=subprocess.STDOUT)
        log.close()
        window = self.wait_for(lambda: self.tool("search", "--name", "^probe$"), 60.0).split()[0]
        self.tool("windowfocus", window)
        self.window = window
        time.sleep(0.5)

    @property
    def log(self) -> str:
        return (self.folder / "log").read_text()

    def tool(self, *arguments: str) -> str:
        return subprocess.run(["xdotool", *arguments], env=self.environment, capture_output=True, text=True).stdout

    def wait_for(self, question, seconds: float = 15.0):
        """The first true answer; fails with the program's output when none comes."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            answer = question()
            if answer:
                return answer
            assert self.viewer.poll() is None or "left" in self.log, self.log
            time.sleep(0.05)
        raise AssertionError(f"no answer in {seconds} s; the window said:\n{self.log}")

    def press(self, key: str, name: str) -> str:
        """Press a key until the window has heard it; what it says of it."""
        before = self.log.count(f"key {name!r}")
        self.tool("key", key)
        self.wait_for(lambda: self.log.count(f"key {name!r}") > before)
        return [line for line in self.log.splitlines() if line.startswith(f"key {name!r}")][-1]

    def pictures(self) -> list[Path]:
        return sorted(self.folder.glob("*.png"))


@pytest.fixture
def person(screen, tmp_path):
    someone = Person(screen, tmp_path)
    yield someone
    if someone.viewer.poll() is None:
        someone.viewer.kill()
        someone.viewer.wait()


def test_keys_and_mouse_reach_the_viewer(person):
    assert "True" in person.press("space", " ")
    person.press("r", "r")
    person.press("p", "p")
    first = person.wait_for(person.pictures)[0].read_bytes()

    person.tool("mousemove", "200", "150", "mousedown", "1")
    for column in (230, 260, 290, 320):
        person.tool("mousemove", str(column), "170")
        time.sleep(0.1)
    person.tool("mouseup", "1")
    person.wait_for(lambda: "drag left" in person.log)
    person.press("p", "p")
    path = person.pictures()[0]
    # The same moment has the same name: the turned picture replaces the first one.
    person.wait_for(lambda: path.read_bytes() != first)

    stepped = person.press("Right", "Right")
    assert float(stepped.split()[-1]) == pytest.approx(1 / 60, abs=1e-3)
    assert person.press("r", "r").split()[-1] == "0.0"
    person.press("h", "h")
    person.press("Escape", "Escape")
    assert person.viewer.wait(15) == 0
    assert person.log.rstrip().endswith("left")
    assert not (person.folder / "imgui.ini").exists()


def ask_to_close(display: str, window: int) -> None:
    """What a window manager sends when its close button is pressed: WM_DELETE_WINDOW, as an
    XClientMessageEvent."""
    x11 = ctypes.CDLL("libX11.so.6")
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XInternAtom.restype = ctypes.c_ulong
    server = ctypes.c_void_p(x11.XOpenDisplay(display.encode()))
    protocols, delete = (x11.XInternAtom(server, name, 0) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW"))
    client_message = 33
    event = (ctypes.c_long * 24)(client_message, 0, 1, server.value, window, protocols, 32, delete)
    assert x11.XSendEvent(server, ctypes.c_ulong(window), 0, ctypes.c_long(0), event)
    x11.XCloseDisplay(server)


def test_the_close_button_ends_it_cleanly(person):
    ask_to_close(person.environment["DISPLAY"], int(person.window))
    assert person.viewer.wait(15) == 0
    assert "left" in person.log
