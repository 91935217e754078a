"""The window's picture: how fine it is, that it is the one of a shot, that what one clicks is what is drawn there, and
what is written over it. Without a window."""

import numpy as np
import pytest
from still import Still, cube_scene

from taichi_jello.view.picking import pick
from taichi_jello.view.render.legend import Sheet
from taichi_jello.view.render.pixels import buffers, ink
from taichi_jello.view.render.raster import rgb_of
from taichi_jello.view.render.renderers import picture
from taichi_jello.view.window import painter as painting
from taichi_jello.view.window.fineness import GROWTH, LEVELS, PATIENCE, SLOWEST, SPARE, Fineness
from taichi_jello.view.window.painter import FINEST, Painter
from taichi_jello.view.window.viewer import Viewer

SIZE = (320, 180)


def drawn(fineness: Fineness, cost, seconds: float) -> list[int]:
    """The levels passed through when a picture takes cost(level)."""
    levels, spent = [fineness.level], 0.0
    while spent < seconds:
        took = cost(fineness.level)
        fineness.took(took)
        spent += took
        if fineness.level != levels[-1]:
            levels.append(fineness.level)
    return levels


@pytest.mark.parametrize("share", [0.02, 0.1, 0.125, 0.13, 0.3, 0.9, 1.1, 3.0, 20.0])
def test_pictures_are_as_fine_as_time_allows_without_going_to_and_fro(share):
    """Each level takes up to GROWTH times the one before: whatever the machine, it settles, and is then in time."""

    def cost(level: int) -> float:
        return share * SLOWEST * GROWTH ** (level - 1)

    levels = drawn(Fineness(), cost, 60.0 * PATIENCE)
    assert levels == sorted(levels) or levels == sorted(levels, reverse=True)
    last = levels[-1]
    assert cost(last) <= SLOWEST or last == 0
    assert last == FINEST or GROWTH * cost(last) >= SPARE * SLOWEST


def test_one_slow_picture_changes_nothing():
    fineness = Fineness()
    drawn(fineness, lambda level: 0.5 * SLOWEST, 3.0 * PATIENCE)
    fineness.took(2.0 * SLOWEST)
    assert fineness.level == 1


@pytest.fixture
def cube_viewer():
    viewer = Viewer(Still(cube_scene(points=3)), size=SIZE)
    viewer.update()
    return viewer


def test_a_still_picture_becomes_that_of_a_shot_and_is_drawn_once(cube_viewer, monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(painting.time, "perf_counter", lambda: clock[0])
    painter = Painter()

    def image():
        cube_viewer.update()
        painter.draw(cube_viewer)
        clock[0] += 0.1
        return painter.image(cube_viewer)

    moving = [image() for _ in range(2)][-1]  # it has not rested yet
    still = [image() for _ in range(2)][-1]
    shot = picture(cube_viewer.simulation, SIZE, legend=False)
    assert np.array_equal(still, shot) and not np.array_equal(moving, shot)
    assert np.array_equal(moving, picture(cube_viewer.simulation, SIZE, samples=1, legend=False))
    monkeypatch.setattr(painting.Raster, "draw", lambda *_: pytest.fail("drawn again"))
    image()
    cube_viewer.viewpoint.orbit(0.1, 0.0)
    with pytest.raises(pytest.fail.Exception):
        image()


@pytest.mark.parametrize("change", ["frame", "view", "color", "show", "push", "tune", "size"])
def test_a_moment_is_all_that_the_picture_depends_on(cube_viewer, change):
    before = cube_viewer.moment()
    cube_viewer.update()
    assert cube_viewer.moment() == before
    if change == "frame":
        cube_viewer.step()
    elif change == "view":
        cube_viewer.zoom(1.1)
    elif change in ("color", "show"):
        cube_viewer.handle_key({"color": "c", "show": "k"}[change])
    elif change == "push":
        cube_viewer.simulation.v = cube_viewer.simulation.v + 1.0
    elif change == "tune":
        cube_viewer.tune(stiffness=2.0)
    else:
        cube_viewer.size = (300, 180)
    cube_viewer.update()
    assert cube_viewer.moment() != before


def test_what_one_clicks_is_what_is_drawn_there(cube_viewer):
    """The depth of the picked point is that of the pixel, to a tenth of a millimetre; beside the cube both are empty.
    A drag then moves the point under the cursor."""
    painter = Painter()
    painter.draw(cube_viewer)
    front = painter._raster(1, SIZE)._front
    body, view = cube_viewer.simulation.body, cube_viewer.viewpoint
    hits = 0
    for row in range(8, 180, 16):
        for column in range(8, 320, 16):
            seen = (front[row, column] >> 32).astype(np.int32).view(np.float32)
            hit = pick(body, cube_viewer.simulation.x, view, (column + 0.5, row + 0.5), SIZE)
            assert (hit is None) == (front[row, column] in (0, buffers.EMPTY))
            if hit is not None:
                hits += 1
                assert -view.axes()[2] @ (hit.point - view.eye) == pytest.approx(seen, abs=1e-4)
    assert hits > 5
    cube_viewer.press("left", (160.0, 100.0))
    cube_viewer.move((190.0, 80.0))
    assert view.project(cube_viewer.grabbed[None], SIZE)[0] == pytest.approx((190.0, 80.0), abs=1e-3)


def test_a_coarse_picture_fills_the_window_and_a_kept_one_is_fine(cube_viewer):
    """Enlarged it is the fine picture but for edges."""
    painter = Painter()
    painter.fineness._set(0)
    painter.draw(cube_viewer)
    assert painter._image.shape == (90, 160)
    columns = painter.under(Sheet(SIZE))
    shown = columns.view(np.uint8).reshape(*SIZE, 4)[:, ::-1, :3].swapaxes(0, 1).astype(int)
    fine = picture(cube_viewer.simulation, SIZE, legend=False)
    assert np.median(np.abs(shown - fine)) <= 1.0 and np.abs(shown - fine).mean() < 4.0
    assert np.array_equal(painter.image(cube_viewer), fine) and painter.level == FINEST
    assert LEVELS[FINEST] == (1, 2)


def test_a_sheet_is_written_as_on_a_shot():
    """The same rectangles, words and lines as `stamp` draws, but where strokes meet, and packed as GGUI wants them."""
    sheet = Sheet((160, 90))
    sheet.quad(20.0, 10.0, 60.0, 12.0, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    sheet.text("t = 0.25 s", 12.0, 60.0, 13.0)
    sheet.line(np.array([[100.0, 20.0], [150.0, 80.0]]), 3.0, np.array([0.1, 0.6, 0.2]))
    sheet.line(np.array([[-50.0, 85.0], [500.0, 87.0]]), 2.0)  # beyond both edges
    stamped, written = np.full((90, 160, 3), 200, np.uint8), np.full((90, 160), 0xFFC8C8C8, np.uint32)
    sheet.stamp(stamped)
    ink.write(sheet, written)
    apart = np.abs(stamped.astype(int) - rgb_of(written)).max(2)
    assert (stamped != 200).any(2).sum() > 1000 and apart.mean() < 2.0 and (apart > 64).sum() < 60
    before = written.copy()
    ink.write(Sheet((160, 90)), written)
    assert np.array_equal(before, written)


@pytest.mark.parametrize("size", [(64, 36), (63, 35)])
def test_doubling_blends_three_parts_to_one(size):
    small = np.random.default_rng(1).integers(0, 256, (18, 32, 3))
    image = (small << [0, 8, 16]).sum(2).astype(np.uint32) | np.uint32(0xFF000000)
    large = np.zeros(size[::-1], np.uint32)
    ink.double(image, large)

    def blended(rows):
        wide = np.pad(rows, [(1, 1)] + [(0, 0)] * (rows.ndim - 1), "edge")
        return np.stack([3 * rows + wide[:-2], 3 * rows + wide[2:]], 1).reshape(-1, *rows.shape[1:])

    expected = blended(blended(small).swapaxes(0, 1)).swapaxes(0, 1) + 8 >> 4
    assert np.array_equal(rgb_of(large), expected[: size[1], : size[0]])
