"""Ctrl-C ends what goes on, also where somebody's `except:` has caught it."""

import contextlib
import signal
import sys

import pytest

from taichi_jello import Box, Scene, Simulation
from taichi_jello.app import cli
from taichi_jello.studies import _report
from taichi_jello.support import interrupt, runtime


def pressed_and_lost():
    """As in Taichi's decorators."""
    with contextlib.suppress(BaseException):
        signal.raise_signal(signal.SIGINT)


@pytest.fixture(scope="module")
def simulation():
    runtime.start("cpu", "f32")
    return Simulation(Scene(jello=[Box(points=(2, 2, 2))]), method="verlet")


def test_one_that_was_lost_ends_the_next_frame(simulation):
    before = signal.getsignal(signal.SIGINT)
    with interrupt.heeded():
        simulation.frame()
        pressed_and_lost()
        with pytest.raises(KeyboardInterrupt):
            simulation.frame()
        assert interrupt.asked()
    assert not interrupt.asked() and signal.getsignal(signal.SIGINT) is before
    simulation.frame()


def test_every_command_ends_with_130(simulation, monkeypatch):
    def loses(chosen):
        pressed_and_lost()
        simulation.frame()

    def becomes_another(chosen):
        pressed_and_lost()
        raise RuntimeError

    for does in (loses, becomes_another):
        monkeypatch.setattr(cli, "do_list", does)
        assert cli.main(["list"]) == 130


def test_a_study_keeps_what_it_has(simulation, monkeypatch):
    chosen, told = type("Chosen", (), {"quiet": True, "json": None}), {"rows": []}

    def pieces():
        for k in range(3):
            told["rows"].append(k)
            if k == 1:
                pressed_and_lost()
            yield

    with interrupt.heeded():
        _report.take(chosen, told, pieces(), "")
        simulation.frame()
    assert told == {"rows": [0, 1], "interrupted": True}


def test_an_import_is_not_cut_in_two_and_the_program_ends_in_one_line(capsys):
    went_on, usual = False, sys.excepthook
    with pytest.raises(KeyboardInterrupt) as stopped, interrupt.importing():
        signal.raise_signal(signal.SIGINT)
        went_on = True
    assert went_on
    ends, sys.excepthook = sys.excepthook, usual
    with pytest.raises(SystemExit) as left:
        ends(stopped.type, stopped.value, stopped.tb)
    assert left.value.code == 130 and capsys.readouterr().err == "jello: stopped while it was starting\n"
