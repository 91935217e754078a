"""The study of contact: what it does with a pair, what it calls through, and what it tells."""

import argparse
from dataclasses import replace

import numpy as np
import pytest

from taichi_jello import Ball, Box, Contact, Rope, Scene, Sheet, Simulation
from taichi_jello.run.assembly import assembled
from taichi_jello.studies import contact
from taichi_jello.studies._contact.pairs import Pair, posed
from taichi_jello.studies._contact.through import Lines, Sheets, Solids, crossed, segments_cross, share_inside, watched
from taichi_jello.studies._report import write_csv
from taichi_jello.support import runtime

QUICK = {
    "quick": True, "quiet": True, "arch": "cpu", "threads": 1, "precision": "f32", "json": None, "method": None,
    "scenes": [], "poses": None,
}  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def taichi(request):
    runtime.start(request.config.getoption("--arch"), "f32")


def two(jello, turn=(0.0, 0.0, 0.0)):
    """Both about the world's origin, the second one turned."""
    return assembled(Scene(jello=[jello, replace(jello, rotation=turn)]))


def went(body, ways):
    """What `watched` says of the second jello, on its ways (3,) one after the other, level in the step `level`."""
    watch, second = watched(body), (body.jello == 1)[:, None]
    for way, level in ways:
        watch.look(body.x + second * np.array(way), level)
    return watch.went


def test_sheets_go_through_where_edges_are_cut_as_they_come_level():
    body = two(Sheet(points=(3, 3)), turn=(90.0, 0.0, 20.0))
    assert isinstance(watched(body), Sheets)
    assert went(body, [((0.0, 0.1, 0.1), True)]) and not went(body, [((0.0, 0.1, 0.1), False)])
    assert not went(body, [((0.0, 3.0, 0.0), True)])


def test_ropes_and_rows_of_cells_go_through_if_their_lines_do_and_do_not_come_back():
    for jello in (Rope(points=4, length=1.0), Box(points=(5, 2, 2), size=(1.0, 0.1, 0.1))):
        body = two(jello, turn=(0.0, 80.0, 0.0))
        assert isinstance(watched(body), Lines)
        above, below, aside = (0.01, 0.3, 0.02), (0.01, -0.3, 0.02), (2.0, -0.3, 0.02)
        assert went(body, [(above, False), (below, False)])
        assert not went(body, [(above, False), (below, False), (above, False)])
        assert not went(body, [(above, False), ((2.0, 0.3, 0.02), False), (aside, False), (below, False)])


def test_solids_go_through_if_they_are_in_each_other_as_they_come_level():
    body = two(Box(points=(4, 4, 4), size=(1.0, 1.0, 1.0)))
    assert isinstance(watched(body), Solids) and isinstance(watched(two(Ball(radius=0.5, resolution=4))), Solids)
    assert went(body, [((0.0, 0.3, 0.1), True)])
    assert not went(body, [((0.0, 0.9, 0.1), True)])  # side by side, a tenth deep
    rope = Rope(points=4, length=1.2, rotation=(0.0, 30.0, 0.0))
    body_of = assembled(Scene(jello=[rope, Box(points=(4, 4, 4), size=(1.0, 1.0, 1.0))]))
    assert isinstance(watched(body_of), Solids)
    assert went(body_of, [((0.0, 0.3, 0.1), True)]) and not went(body_of, [((0.0, 0.6, 0.1), True)])
    x = body.x[body.jello == 0]
    points = np.random.default_rng(1).uniform(-0.5, 1.5, (4000, 3)) + x.min(0)
    inside = np.all((points > x.min(0)) & (points < x.max(0)), axis=1)
    assert share_inside(points, x[body.cells[body.jello[body.cells[:, 0]] == 0]]) == pytest.approx(inside.mean())


def test_the_sign_of_a_volume_changes_as_lines_cross():
    one = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
    for height in (0.1, -0.1):
        volume, within = segments_cross(one, np.array([[[0.3, height, -1.0], [0.3, height, 1.0]]]))
        assert volume[0] == pytest.approx(-2.0 * height) and within[0]
    assert not segments_cross(one, np.array([[[1.1, 0.1, -1.0], [1.1, 0.1, 1.0]]]))[1][0]


def test_lines_cross_where_they_meet_not_where_they_turn_by_each_other():
    one = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])

    def other(*ends):
        return np.array([ends])

    above, below = other((0.3, 0.1, -1.0), (0.3, 0.2, 1.0)), other((0.4, -0.3, -1.0), (0.4, -0.1, 1.0))
    assert abs(crossed([one, above], [one, below])) == 1 and crossed([one, above], [one, above]) == 0
    assert crossed([one, above], [one, below]) == -crossed([one, below], [one, above])
    level = above * [1.0, 0.0, 1.0]  # looked at just as they meet
    assert crossed([one, above], [one, level]) + crossed([one, level], [one, below]) == crossed(
        [one, above], [one, below]
    )
    # A scissors' blade half a metre above turns by where both are parallel: the sign changes, nothing meets.
    scissors = [other((0.0, 0.5, -h), (1.0, 0.5, h)) for h in (0.2, -0.3)]
    signs = [np.sign(segments_cross(one, blade)[0][0]) for blade in scissors]
    assert signs[0] == -signs[1] and all(segments_cross(one, blade)[1][0] for blade in scissors)
    assert crossed([one, scissors[0]], [one, scissors[1]]) == 0


def test_poses_are_the_same_for_each_number():
    simulation = Pair("rope", "sheet").simulation("rk4")
    low, high, way = posed(simulation, 3)
    assert all(np.array_equal(a, b) for a, b in zip((low, high, way), posed(simulation, 3), strict=True))
    assert np.linalg.norm(way) == pytest.approx(1.0) and not np.array_equal(way, posed(simulation, 4)[2])


def test_what_passes_is_told(monkeypatch, tmp_path):
    """With no contact a pair passes."""

    def blind(pair, method):
        scene = Scene(
            gravity=(0.0, 0.0, 0.0),
            jello=[Box(points=(3, 3, 3), size=(pair.size,) * 3)] * 2,
            contact=Contact(touch=False),
        )
        return Simulation(scene, method="verlet")

    monkeypatch.setattr(contact, "THROWS", [Pair("box", "box", 0.5), Pair("box", "rabbit")])
    monkeypatch.setattr(Pair, "simulation", blind)
    told = contact.measure(argparse.Namespace(**QUICK))
    (throw,) = told["rows"]
    assert throw["through"] == [0, 1, 2] and throw["around"] == []
    chosen = argparse.Namespace(**QUICK | {"scenes": ["box", "rabbit"], "poses": 1})
    assert [(row["one"], row["other"], row["poses"]) for row in contact.measure(chosen)["rows"]] == [
        ("box", "box", 1), ("box", "rabbit", 1)
    ]  # fmt: skip
    page = contact.text(told)
    assert "3 poses, 3 went through" in page and "box, box, 0.5 m, 200 N/m" in page
    write_csv(tmp_path / "x.csv", contact.rows(told))
    assert "box,box,0.5,200.0,verlet,3,0 1 2," in (tmp_path / "x.csv").read_text()
    contact.plot(told, tmp_path / "x.png")
    assert (tmp_path / "x.png").stat().st_size > 10_000
