"""The panel's sliders, buttons and clicks with a stand-in for GGUI's widgets; its energies plotted."""

from contextlib import contextmanager

import numpy as np
import pytest
from still import Still, cube_scene

from taichi_jello import Box, Scene, Simulation
from taichi_jello.scene.description import SHOWS
from taichi_jello.view.render.legend import Sheet
from taichi_jello.view.window.gauges import SPAN, Gauges, largest_force, plot
from taichi_jello.view.window.panel import SETTLING_FRAMES, Panel
from taichi_jello.view.window.viewer import Viewer


class Widgets:
    """GGUI's calls; `slide` and `push` say what the person does in the next frame."""

    def __init__(self):
        self.windows, self.words, self.slide, self.push = [], [], {}, ""
        self.labels = {}

    @contextmanager
    def sub_window(self, *place):
        self.windows.append(place)
        yield self

    def slider_float(self, name, value, low, high):
        words, _, key = name.partition("###")
        self.labels[key] = words
        return float(np.float32(self.slide.pop(key, value)))

    def button(self, words):
        return bool(self.push) and words.startswith(self.push)

    def text(self, words):
        self.words.append(words)


@pytest.fixture
def viewer():
    viewer = Viewer(Still(cube_scene(points=2)))
    viewer.handle_key("Tab")
    viewer.update()
    return viewer


def test_untouched_sliders_tune_nothing(viewer, monkeypatch):
    monkeypatch.setattr(viewer, "tune", lambda **numbers: pytest.fail(f"tuned {numbers}"))
    viewer.simulation.tuning["stiffness"] = 1.0 / 3.0  # no float32
    Panel((1280, 720)).show(Widgets(), viewer)
    assert viewer.pace.scale == 1.0


def test_sliders_tune_what_they_name(viewer):
    gui = Widgets()
    gui.slide = {"stiffness": 4.0, "gravity": -1.5, "friction": 0.75, "time": 0.5}
    Panel((1280, 720)).show(gui, viewer)
    tuned = viewer.simulation.tuning
    assert (tuned["stiffness"], tuned["friction"], tuned["damping"]) == (4.0, 0.75, 1.0)
    assert tuned["gravity"] == (0.0, -1.5, 0.0) and viewer.pace.scale == 0.5
    viewer.update()
    assert viewer.drawing.springs.scale == (4.0, 1.0)
    Panel((1280, 720)).show(gui, viewer)
    assert gui.labels["stiffness"] == "stiffness ×4.0" and gui.labels["gravity"] == "gravity -1.50 m/s²"
    assert gui.labels["time"] == "time ×0.50"


def test_buttons_do_what_keys_do(viewer):
    gui, panel = Widgets(), Panel((1280, 720))
    for gui.push in ("method", "color", "show"):
        panel.show(gui, viewer)
    viewer.do_pending()
    assert viewer.simulation.method != "rk4" and viewer.color == "strain" and viewer.shown == SHOWS[1]


def test_readings_are_shown(viewer):
    gui = Widgets()
    Panel((1280, 720)).show(gui, viewer)
    words = " ".join(gui.words)
    for part in (
        "pictures a second",
        "real time ×1.00",
        "ms a frame",
        "10 steps",
        "step 1.67 ms (safe 2 ms)",
        "energy 1 J",
    ):
        assert part in words


def test_clicks_on_the_panel_are_its_own_only_while_it_is_there(viewer):
    gui, panel = Widgets(), Panel((1280, 720))
    assert not panel.takes((100.0, 150.0))
    panel.show(gui, viewer)
    assert panel.takes((100.0, 150.0)) and not panel.takes((900.0, 150.0))
    viewer.handle_key("Tab")
    panel.show(gui, viewer)
    assert not panel.takes((100.0, 150.0)) and len(gui.windows) == 1


def test_a_panel_that_was_dragged_comes_back(viewer):
    gui, panel = Widgets(), Panel((1280, 720))
    panel.show(gui, viewer)
    panel.takes((100.0, 90.0))
    gui.slide = {"stiffness": 2.0}
    panel.show(gui, viewer)
    panel.release()
    for _ in range(SETTLING_FRAMES + 1):
        panel.show(gui, viewer)
    assert len({name for name, *_ in gui.windows}) == 1  # a slider was used: it stays
    panel.takes((100.0, 90.0))
    panel.release()
    panel.show(gui, viewer)
    gui.push = "color"  # a button tells that it was let go, not that it was pressed
    panel.show(gui, viewer)
    gui.push = ""
    for _ in range(SETTLING_FRAMES):
        panel.show(gui, viewer)
    assert viewer.color == "strain" and len({name for name, *_ in gui.windows}) == 1
    panel.takes((100.0, 90.0))
    panel.release()
    for _ in range(SETTLING_FRAMES + 1):
        panel.show(gui, viewer)
    assert len({name for name, *_ in gui.windows}) == 2
    viewer.size = (900, 700)
    panel.show(gui, viewer)
    assert len({name for name, *_ in gui.windows}) == 3
    _, left, top, wide, tall = gui.windows[-1]
    placed = (left * 1280, top * 720, (left + wide) * 1280, (top + tall) * 720)
    assert placed == pytest.approx(panel.rectangle)


def test_gauges_keep_the_last_seconds_and_forget_after_a_restart(viewer):
    simulation, gauges = viewer.simulation, Gauges()
    for _ in range(600):
        simulation.time += 1.0 / 60.0
        gauges.read(simulation, simulation.x, simulation.v)
        gauges.read(simulation, simulation.x, simulation.v)
    assert len(gauges.past) == pytest.approx(60 * SPAN, abs=2)
    simulation.reset()
    gauges.read(simulation, simulation.x, simulation.v)
    assert len(gauges.past) == 1


def test_the_largest_force_is_that_of_the_tuned_spring(viewer):
    simulation = viewer.simulation
    simulation.tune(stiffness=3.0)
    x = 1.1 * simulation.body.x
    worst = 0.1 * (simulation.body.rest_length * simulation.body.stiffness).max()
    assert largest_force(simulation, x, np.zeros_like(x)) == pytest.approx(3.0 * worst, rel=1e-5)


def test_the_plot_lies_in_its_corner_and_shows_each_energy():
    past = [(0.1 * k, 10.0 - 0.1 * k, 0.05 * k, -4.0) for k in range(51)]
    for size in ((1280, 720), (800, 1000), (640, 360)):
        sheet = Sheet(size)
        plot(sheet, past)
        page = sheet.quads[0]
        assert {"-5 s", "now", "0", "5", "10", "J"} <= {text.words for text in sheet.texts}
        places = np.concatenate([text.segments().reshape(-1, 2) for text in sheet.texts])
        assert (places >= [page.x, page.y]).all() and (places <= [page.x + page.width, page.y + page.height]).all()
        curves = [line.points for line in sheet.lines if len(line.points) == 51]
        assert len(curves) == 3
        for points in curves:
            assert points[:, 0].min() >= page.x and points[:, 0].max() <= page.x + page.width <= size[0]
            assert points[:, 1].min() >= page.y and points[:, 1].max() <= page.y + page.height <= size[1]
        kinetic, elastic, gravity = (np.diff(points[:, 1]) for points in curves)
        assert (kinetic > 0.0).all() and (elastic < 0.0).all() and (gravity == 0.0).all()  # rows count downwards
    plot(Sheet((640, 360)), [])


def test_lines_are_stamped_into_a_picture():
    image = np.full((60, 80, 3), 255, np.uint8)
    sheet = Sheet((80, 60))
    sheet.line(np.array([[10.0, 30.0], [70.0, 30.0]]), 4.0, np.zeros(3))
    sheet.stamp(image)
    assert image[30, 40].max() == 0 and image[30, 5].min() == 255 and image[20, 40].min() == 255


def test_gauges_read_the_ledger_where_there_is_one(viewer):
    gauges = Gauges()
    gauges.read(viewer.simulation, viewer.simulation.x, viewer.simulation.v)
    assert gauges.ledger is None
    booked = Simulation(Scene(jello=[Box(points=(2, 2, 2))], drag=1.0), ledger=True, substeps=50)
    booked.frame()
    gauges.read(booked, booked.x, booked.v)
    work, residual = gauges.ledger
    assert work < 0.0 and abs(residual) < 1e-3 * abs(work)
