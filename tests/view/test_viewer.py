"""The viewer's keys and clock, and what it writes over the picture; without a window."""

import time

import numpy as np
import pytest
from still import Still, grab_at

from taichi_jello.physics.integrators import schemes
from taichi_jello.run.diverged import Diverged
from taichi_jello.run.find_culprit import Culprit
from taichi_jello.scene.description import COLORS, SHOWS
from taichi_jello.view.drawing import palette
from taichi_jello.view.render.legend import MIN_TEXT, legend
from taichi_jello.view.window.actions import HELP, KEYS, WIND
from taichi_jello.view.window.frame_pacing import BUDGET, MAX_FRAMES_PER_DRAW
from taichi_jello.view.window.overlay import overlay
from taichi_jello.view.window.viewer import NOTICE_SECONDS


def test_physics_follows_the_clock(viewer):
    frame = viewer.simulation.frame_dt
    assert [viewer.advance(0.5 * frame) for _ in range(6)] == [0, 1, 0, 1, 0, 1]
    assert viewer.simulation.time == pytest.approx(3 * frame)


def test_a_slow_machine_slows_time_and_catches_up_with_nothing(viewer):
    frame = viewer.simulation.frame_dt
    for _ in range(40):
        assert viewer.advance(10 * MAX_FRAMES_PER_DRAW * frame) == MAX_FRAMES_PER_DRAW
    assert viewer.advance(0.5 * frame) == 0
    assert viewer.pace.speed < 0.2


def test_heavy_physics_leaves_time_to_draw(viewer, monkeypatch):
    monkeypatch.setattr(Still, "frame", lambda self: time.sleep(3.0 * BUDGET))
    assert viewer.advance(4.0 * viewer.simulation.frame_dt) < 4
    assert viewer.pace.cost >= 2.9 * BUDGET
    assert viewer.advance(0.5 * viewer.simulation.frame_dt) == 0  # what could not be done is not owed


def test_a_notice_stays_while_it_is_news(viewer):
    def after(seconds: float) -> str:
        for _ in range(10):
            viewer.advance(seconds / 10.0)
        return viewer.notice

    viewer.handle_key("c")
    assert after(0.9 * NOTICE_SECONDS) == "color: strain" and after(0.2 * NOTICE_SECONDS) == ""
    viewer.handle_key(" ")
    viewer.handle_key("Up")
    assert "paused" in after(2.0 * NOTICE_SECONDS)
    viewer.handle_key(" ")
    assert viewer.notice == ""


def test_time_can_run_slower(viewer):
    viewer.pace.scale = 0.25
    assert sum(viewer.advance(viewer.simulation.frame_dt) for _ in range(40)) == 10


def test_space_pauses_and_right_steps_only_then(viewer):
    frame = viewer.simulation.frame_dt
    viewer.handle_key("Right")
    assert viewer.simulation.time == 0.0
    viewer.handle_key(" ")
    assert viewer.advance(1.0) == 0
    viewer.handle_key("Right")
    assert viewer.simulation.time == pytest.approx(frame)
    viewer.handle_key(" ")
    assert viewer.advance(frame) == 1


def test_r_resets_and_escape_leaves(viewer):
    viewer.advance(0.05)
    viewer.handle_key("r")
    assert viewer.simulation.time == 0.0 and viewer.simulation.resets == 1
    assert not viewer.leaving
    viewer.handle_key("Escape")
    assert viewer.leaving


def test_c_and_k_go_round(viewer):
    seen = [viewer.handle_key("c") and viewer.color for _ in COLORS]
    assert sorted(seen) == sorted(COLORS) and seen[-1] == "force"
    parts = []
    for _ in SHOWS:
        viewer.update()
        parts.append((viewer.drawing.blended is not None, len(viewer.drawing.lines), viewer.drawing.dots is not None))
        viewer.handle_key("k")
    assert len(set(parts)) == len(SHOWS) and viewer.shown == SHOWS[0]


def test_b_is_wind_from_the_left_from_the_right_and_none(viewer):
    """As the eye sees it: here it looks along -z, its right is +x."""
    seen = []
    for _ in range(3):
        viewer.handle_key("b")
        seen.append(viewer.simulation.tuning["wind"])
    assert seen == [(WIND, 0.0, 0.0), (-WIND, 0.0, 0.0), (0.0, 0.0, 0.0)]


def test_arrows_push_along_the_ground_as_seen(viewer):
    for key, way in (
        ("Right", (1, 0, 0)),
        ("Left", (-1, 0, 0)),
        ("Up", (0, 0, -1)),
        ("Down", (0, 0, 1)),
        ("j", (0, 1, 0)),
    ):
        viewer.handle_key(key)
        name, velocity = viewer.simulation.calls[-1]
        assert name == "push" and np.linalg.norm(velocity) > 0.5
        assert velocity / np.linalg.norm(velocity) == pytest.approx(way, abs=1e-6)
    viewer.handle_key(" ")
    count = len(viewer.simulation.calls)
    viewer.handle_key("Left")
    assert len(viewer.simulation.calls) == count and "paused" in viewer.notice


def test_g_turns_gravity_up_off_and_down_again(viewer):
    seen: list[tuple[float, ...]] = []
    for _ in range(3):
        viewer.handle_key("g")
        seen.append(viewer.simulation.tuning["gravity"])
    assert seen == [(0.0, 9.81, 0.0), (0.0, 0.0, 0.0), (0.0, -9.81, 0.0)]


def test_m_goes_to_the_next_method_once_that_was_told(viewer):
    names = list(schemes())
    viewer.simulation.safe_dt = 1e-9
    viewer.handle_key("m")
    viewer.do_pending()
    assert "is beyond its safe 1e-09 s" in viewer.notice
    viewer.update()
    assert any("unsafe step" in text.words for text in overlay(viewer).texts)
    viewer.simulation.safe_dt, viewer.simulation.method = 1.0, "rk4"
    assert not any("unsafe step" in text.words for text in overlay(viewer).texts)
    for k in range(len(names)):
        viewer.handle_key("m")
        assert viewer.notice.startswith("compiling") and viewer.do_pending() and not viewer.do_pending()
        assert viewer.simulation.method == names[(names.index("rk4") + 1 + k) % len(names)]


def test_a_first_frame_is_told_before_it_is_compiled(viewer, monkeypatch):
    """One picture with the words, then the frame; the notice from before is back."""
    ran = set()
    monkeypatch.setattr(Still, "compiled", property(lambda still: still.method in ran), raising=False)
    frame = Still.frame
    monkeypatch.setattr(Still, "frame", lambda still: (ran.add(still.method), frame(still)))
    step = viewer.simulation.frame_dt
    assert viewer.advance(step) == 0 and viewer.simulation.time == 0.0
    assert viewer.notice == "compiling rk4 ..." and viewer.advance(step) == 0
    assert viewer.do_pending() and viewer.simulation.time == pytest.approx(step) and viewer.notice == ""
    assert viewer.advance(step) == 1
    viewer.handle_key("m")
    viewer.do_pending()
    method = viewer.simulation.method
    assert method != "rk4" and viewer.notice == f"method: {method}"
    assert viewer.advance(step) == 0 and viewer.notice == f"compiling {method} ..."
    viewer.do_pending()
    assert viewer.notice == f"method: {method}"
    viewer.update()
    assert any(text.words.startswith(f"{method} ") for text in overlay(viewer).texts)


def test_keys_pressed_while_something_waits_are_dropped_but_esc(viewer):
    names = list(schemes())
    viewer.handle_key("m")
    for key in ("j", "c", "m", " "):
        assert not viewer.handle_key(key)
    assert viewer.do_pending() and not viewer.do_pending()
    assert viewer.simulation.method == names[(names.index("rk4") + 1) % len(names)]
    assert not viewer.simulation.calls and viewer.color == "force" and not viewer.paused
    viewer.handle_key("m")
    assert viewer.handle_key("Escape") and viewer.leaving


@pytest.mark.parametrize("ends", ["r", "n"])
def test_slow_motion_is_told_and_ended(viewer, ends):
    viewer.update()
    assert not any("motion" in text.words for text in overlay(viewer).texts)
    viewer.pace.scale = 0.25
    for _ in range(300):
        viewer.advance(1.0 / 60.0)
    told = [text.words for text in overlay(viewer).texts]
    assert "slow motion x 0.25; R: real time" in told  # and that it is slower than life is no news then
    viewer.handle_key(ends)
    viewer.playlist.following = lambda scene: Still(scene)
    viewer.do_pending()
    assert viewer.pace.scale == 1.0


def test_words_over_the_picture_have_a_pale_rim(viewer):
    """Between dark letters over a jello there is light: each is also written thicker, below, in the paper's colour."""
    viewer.update()
    texts = overlay(viewer).texts
    ink = [text for text in texts if text.rgb is not palette.PAPER]
    rims = {(text.words, text.x, text.y): text for text in texts if text.rgb is palette.PAPER}
    assert len(ink) == len(rims) > 3
    for text in ink:
        assert rims[text.words, text.x, text.y].width > text.width + 2.0


def test_time_that_counts_for_no_frame_is_not_in_the_frame_rate(viewer):
    for _ in range(3):
        viewer.advance(0.0)
    assert viewer.rate == 0.0
    viewer.advance(1.0 / 40.0)
    viewer.advance(0.0)
    assert viewer.rate == pytest.approx(40.0)


def test_a_method_without_a_safe_step_is_passed_over(viewer, monkeypatch):
    names = list(schemes())
    refused = names[(names.index("rk4") + 1) % len(names)]

    def change(name):
        if name == refused:
            raise ValueError("no stable step")
        viewer.simulation.method = name

    monkeypatch.setattr(viewer.simulation, "change_method", change, raising=False)
    viewer.handle_key("m")
    viewer.do_pending()
    assert viewer.simulation.method == names[(names.index("rk4") + 2) % len(names)]


def test_numbers_that_went_bad_pause_and_are_told(viewer, monkeypatch):
    def bad(self):
        raise Diverged({"time": 1.0, "particle": 7, "jello": 0, "dt": 0.01, "safe_dt": 0.002})

    grab_at(viewer)
    monkeypatch.setattr(Still, "frame", bad)
    assert viewer.advance(0.1) == 0
    assert viewer.paused and viewer.simulation.held is None
    assert all(word in viewer.notice for word in ("particle 7", "0.01 s", "0.002 s"))
    viewer.handle_key("Right")  # one step more is no crash either
    assert viewer.paused


def test_starting_again_lets_go(viewer):
    grab_at(viewer)
    viewer.handle_key("BackSpace")
    assert viewer.simulation.resets == 1 and viewer.simulation.held is None


def test_unknown_keys_do_nothing(viewer):
    assert not viewer.handle_key("z") and not viewer.handle_key("Shift")


def test_help_names_every_key(viewer):
    told = " ".join(keys for keys, _ in HELP).lower().split()
    names = {" ": "space", "escape": "esc"}
    assert {names.get(key, key) for key in KEYS} <= set(told)


@pytest.mark.parametrize("size", [(1280, 720), (640, 360), (800, 1000), (2000, 400)])
def test_help_fits_the_window(viewer, size):
    viewer.size = size
    viewer.update()
    viewer.handle_key("h")
    sheet = overlay(viewer)
    page = max(sheet.quads, key=lambda quad: quad.width * quad.height)
    on_page = [text for text in sheet.texts if any(text.words in row for row in HELP)]
    assert len(on_page) >= 2 * len(HELP)
    assert page.x > 0.0 and page.y > 0.0 and page.x + page.width < size[0] and page.y + page.height < size[1]
    for text in on_page:
        places = text.segments().reshape(-1, 2)
        assert (places > [page.x, page.y]).all() and (places < [page.x + page.width, page.y + page.height]).all()


@pytest.mark.parametrize("size", [(320, 180), (640, 360), (300, 200)])
def test_what_is_written_on_a_small_picture_can_be_read(viewer, size):
    viewer.update()
    sheet = legend(viewer.drawing.key, 0.05, size)
    parts = [text.segments().reshape(-1, 2) for text in sheet.texts]
    assert min(text.height for text in sheet.texts) >= MIN_TEXT - 1e-9
    assert all((part > 0.0).all() and (part < size).all() for part in parts)
    time, scale_end = parts[0], parts[-1]
    assert scale_end[:, 0].max() < time[:, 0].min()


def test_state_is_written(viewer):
    for _ in range(3):
        viewer.advance(1.0 / 59.7)
    viewer.update()
    viewer.handle_key(" ")
    words = [text.words for text in overlay(viewer).texts]
    assert any("60 fps" in w and "paused" in w for w in words)


def test_what_made_the_numbers_go_bad_is_marked(viewer, monkeypatch):
    """A thick line along the spring in a colour that nothing else has, and the words, while paused at that moment."""
    told = "the structural spring between particles 0 and 7 of jello 0 had grown to 1e+09 N"
    culprit = Culprit("spring", "springs", (0, 7), 0, 1.0, 1e9, told)

    def bad(self):
        raise Diverged({"time": 1.0, "particle": 7, "jello": 0, "dt": 0.01, "safe_dt": 0.002}, lambda: culprit)

    def marked():
        """Pixels in that colour along the spring, and in the whole picture."""
        viewer.update()
        image = np.full((720, 1280, 3), 255, np.uint8)
        overlay(viewer).stamp(image)
        alarming = np.abs(image - 255.0 * palette.ALARM).max(2) < 2.0
        ends = viewer.viewpoint.project(viewer.simulation.snapshot().x[[0, 7]].astype(float), viewer.size)
        along = np.round(ends[0] + np.linspace(0.0, 1.0, 50)[:, None] * (ends[1] - ends[0])).astype(int)
        return alarming[along[:, 1], along[:, 0]].mean(), alarming.sum()

    assert marked() == (0.0, 0)
    monkeypatch.setattr(Still, "frame", bad)
    viewer.advance(0.1)
    covered, everywhere = marked()
    assert covered > 0.95 and everywhere > 1000
    assert any(text.words == told for text in overlay(viewer).texts)
    viewer.paused = False
    assert marked() == (0.0, 0)
