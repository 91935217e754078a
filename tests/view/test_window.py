"""A real window on a virtual screen, driven by synthetic keys and mouse."""

import ctypes
import shutil
import signal

import av
import numpy as np
import pytest
from person import Person, virtual_screen

from taichi_jello.view.render import ggui

TOOLS = ("Xvfb", "xdotool")
pytestmark = [
    pytest.mark.window,
    pytest.mark.skipif(not all(shutil.which(tool) for tool in TOOLS), reason=f"needs {' and '.join(TOOLS)}"),
    pytest.mark.skipif(not ggui.available(), reason="no Vulkan driver works here"),
]


def test_keys_and_mouse_reach_the_viewer(person):
    assert "True" in person.press("space", " ")
    person.press("r", "r")
    person.press("p", "p")
    first = person.wait_for(person.pictures)[0].read_bytes()

    person.tool("mousemove", "60", "150")  # beside the cube
    person.button("down", 1)
    person.mouse(*((column, 170) for column in (90, 120, 150, 180)))
    person.button("up", 1)
    person.wait_for(lambda: "drag left" in person.log)
    person.press("p", "p")
    person.wait_for(lambda: len(person.pictures()) == 2)  # of the same moment, from another side
    assert first not in [path.read_bytes() for path in person.pictures() if "-2." in path.name]

    stepped = person.press("Right", "Right")
    assert float(stepped.split()[-1]) == pytest.approx(1 / 60, abs=1e-3)
    assert person.press("r", "r").split()[-1] == "0.0"
    person.press("h", "h")
    person.press("Escape", "Escape")
    assert person.viewer.wait(60) == 0
    assert person.log.rstrip().endswith("left")
    assert not (person.folder / "imgui.ini").exists()


def reddish(image):
    """Where a picture (360, width, 3) is red, as the first jello is, above the legend."""
    return (image[:300, :, 0] - image[:300, :, 1:].max(2)) > 40


def box_of(mask):
    """First column and row, and the last ones."""
    rows, columns = np.flatnonzero(mask.sum(1) > 2), np.flatnonzero(mask.sum(0) > 2)
    return np.array([columns[0], rows[0], columns[-1], rows[-1]])


@pytest.mark.parametrize("renderer", ["auto", "ggui"])
def test_the_jello_is_on_the_screen_where_its_particles_are(screen, tmp_path, renderer):
    """Paused, to 4 pixels (springs have some width, refraction pales edges), and upright: the cube floats above the
    floor's shadow. At rest the rasteriser's picture is the shot of that moment wherever nothing is written."""
    person = Person(screen, tmp_path, "still", renderer)
    try:
        person.press("space", " ")
        person.press("r", "r")
        person.press("o", "o")
        person.watch(2)
        person.wait_for(lambda: np.abs(box_of(reddish(person.seen())) - person.state["box"]).max() < 5.0)
        if renderer == "auto":
            person.press("p", "p")
            shot = av_image(person.wait_for(person.pictures)[-1])
            middle = slice(90, 280)  # no words but the notice above, no legend below
            person.wait_for(lambda: np.array_equal(person.seen()[middle], shot[middle]))
            inner = np.diff(shot[middle], axis=1)
            assert np.abs(inner).max() > 50
        person.press("Escape", "Escape")
        assert person.viewer.wait(60) == 0
    finally:
        if person.viewer.poll() is None:
            person.viewer.kill()
            person.viewer.wait()


def av_image(path):
    """A picture file as (height, width, 3) int."""
    with av.open(str(path)) as container:
        return next(container.decode(video=0)).to_ndarray(format="rgb24").astype(int)


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


def test_the_close_button_ends_it_cleanly_and_keeps_the_film(person):
    person.press("v", "v")
    person.watch(4)
    ask_to_close(person.environment["DISPLAY"], int(person.window))
    assert person.viewer.wait(60) == 0
    assert "left" in person.log
    (film,) = person.folder.glob("*.mp4")
    with av.open(str(film)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) >= 2 and frames[0].shape == (360, 640, 3)
    assert np.ptp(frames[0].mean((0, 1))) > 0.5  # a picture, not a grey nothing


def test_a_closed_terminal_ends_it_as_esc_does(person):
    person.press("v", "v")
    person.watch(4)
    person.viewer.send_signal(signal.SIGHUP)
    assert person.viewer.wait(60) == 0
    (film,) = person.folder.glob("*.mp4")
    assert f"saved {film.name}" in person.log and "left" in person.log


def test_a_hidden_and_a_resized_window_go_on(person):
    """Unmapped it runs on; another size ends the film, which is kept and said; one pixel is survived."""
    person.press("v", "v")
    person.tool("windowunmap", person.window)
    person.watch()
    person.tool("windowmap", person.window)
    person.tool("windowfocus", person.window)
    before = person.state["time"]
    person.wait_for(lambda: person.state["time"] > before)
    person.tool("windowsize", person.window, "400", "300")
    told = person.wait_for(lambda: "changed its size" in person.state["notice"] and person.state["notice"])
    (film,) = person.folder.glob("*.mp4")
    with av.open(str(film)) as container:
        assert f"{film.name}: {len(list(container.decode(video=0)))} frame" in told
    person.tool("windowsize", person.window, "1", "1")
    person.watch()
    person.tool("windowsize", person.window, "640", "360")
    before = person.state["time"]
    person.wait_for(lambda: person.state["time"] > before)
    person.press("Escape", "Escape")
    assert person.viewer.wait(60) == 0


def test_a_screen_that_dies_takes_no_film_with_it(tmp_path):
    """One line, and what was filmed until then; no assertion of the driver's."""
    server, environment = virtual_screen()
    person = Person(environment, tmp_path)
    try:
        person.press("v", "v")
        person.watch(4)
        server.terminate()
        assert person.viewer.wait(60) == 2
    finally:
        person.viewer.kill()
        server.kill()
        server.wait()
    told = [line for line in person.log.splitlines() if not line.startswith(("key", "drag"))]
    assert len(told) == 1 and told[0].startswith(
        f"jello: the screen at DISPLAY={environment['DISPLAY']} is gone; saved"
    )
    (film,) = tmp_path.glob("*.mp4")
    with av.open(str(film)) as container:
        count = len(list(container.decode(video=0)))
    assert count >= 1 and f"{film.name}: {count} frame" in told[0]
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize("person", ["real"], indirect=True)
def test_a_jello_is_pulled_about_tuned_and_pushed(person):
    pull_it_about(person)
    turn_the_view(person)
    use_the_panel(person)
    press_the_other_keys(person)
    person.press("Escape", "Escape")
    assert person.viewer.wait(180) == 0  # the next demo may be compiling
    assert not [path for path in person.folder.iterdir() if path.suffix == ".ini"]


def pull_it_about(person):
    """The grabbed point follows the cursor, and the jello is thrown where it was going."""
    before = person.wait_for(lambda: person.state["time"] > 0.5 and person.state)
    start = (320.0, 190.0)
    person.mouse(start)
    person.button("down", 1)
    held = person.wait_for(lambda: person.state["held"])
    assert held[0] == pytest.approx(start, abs=4.0)  # the physics goes on between the click and the picture
    person.mouse(*((start[0] + 6 * k, start[1] - 8 * k) for k in range(1, 11)))

    def near():
        point, target = person.state["held"]
        return abs(target[0] - 380) < 1 and abs(target[1] - 110) < 1 and abs(point[0] - 380) + abs(point[1] - 110) < 40

    person.wait_for(near)
    after = person.wait_for(lambda: person.state["middle"][1] > before["middle"][1] + 0.2 and person.state)
    assert after["middle"][0] > before["middle"][0] + 0.1 and after["eye"] == before["eye"]
    person.press("space", " ")  # the picture shows the same moment as the state: the jello has moved there too
    person.watch(3)
    lifted = person.state["box"]
    assert lifted[1] < before["box"][1] - 10.0 and lifted[0] > before["box"][0] + 5.0
    # Its top; below it there is now a red shadow.
    person.wait_for(lambda: abs(box_of(reddish(person.seen()))[1] - lifted[1]) < 8.0)
    person.press("space", " ")
    person.button("up", 1)
    person.wait_for(lambda: person.state["held"] is None)
    person.wait_for(lambda: person.state["middle"][1] < 0.6)


def turn_the_view(person):
    eye = person.state["eye"]
    person.mouse((60, 200))
    person.button("down", 3)
    person.mouse((80, 200), (110, 200))
    person.button("up", 3)
    person.wait_for(lambda: person.state["eye"][0] < eye[0] - 0.3)
    assert person.state["held"] is None


def use_the_panel(person):
    """The first slider, of the stiffness, begins 28 pixels from the left and 75 from the top; the button for the color
    is 162 pixels below it."""
    person.press("Tab", "Tab")
    person.wait_for(lambda: person.state["panel"])
    eye = person.state["eye"]
    person.watch(4)
    person.mouse((56, 75))
    person.button("down", 1)
    person.mouse((70, 75), (110, 75), (150, 75), (150, 75))
    person.button("up", 1)
    person.wait_for(lambda: 3.0 < person.state["stiffness"] < 7.0)
    person.mouse((60, 237))
    person.watch(4)
    person.button("down", 1)
    person.watch(4)
    person.button("up", 1)
    person.wait_for(lambda: person.state["color"] == "strain")
    assert person.state["eye"] == eye and person.state["held"] is None
    person.press("Tab", "Tab")
    person.wait_for(lambda: not person.state["panel"])


def press_the_other_keys(person):
    person.press("g", "g")
    person.wait_for(
        lambda: "9.81" in person.state["tuning"]["gravity"] and "-9.81" not in person.state["tuning"]["gravity"]
    )
    person.wait_for(lambda: person.state["middle"][1] > 0.8)
    person.press("BackSpace", "BackSpace")
    person.press("g", "g")
    person.press("j", "j")
    person.wait_for(lambda: person.state["velocity"][1] > 1.0)
    before = person.state["velocity"]
    person.press("Left", "Left")
    person.wait_for(lambda: person.state["velocity"][0] < before[0] - 0.5)
    eye = person.state["eye"]
    person.press("f", "f")
    person.wait_for(lambda: person.state["eye"] != eye)
    person.press("m", "m")
    person.tool("key", "g")  # while it compiles: dropped
    person.wait_for(lambda: person.state["method"] != "rk4" and person.state["compiled"], 120.0)
    person.watch(3)  # keys count again
    assert "-9.81" not in person.state["tuning"]["gravity"]
    color, show = person.state["color"], person.state["show"]
    person.press("c", "c")
    person.press("k", "k")
    person.wait_for(lambda: person.state["color"] != color and person.state["show"] != show)
    person.press("n", "n")
    person.wait_for(lambda: person.state["title"] != "probe", 30.0)
