"""Options and fixtures for all tests: `pytest --arch cuda` runs the suite on another Taichi arch."""

import os
import signal
import subprocess
import sys
import warnings

import pytest

from taichi_jello.app import cli
from taichi_jello.physics.integrators import schemes
from taichi_jello.support import runtime

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell starts what it runs in the background
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure():
    """Kernels compile in half the time without Taichi's own optimisation (LLVM's stays), and run some 14 % slower. Set
    TI_ADVANCED_OPTIMIZATION=1 to test them as users get them."""
    os.environ.setdefault("TI_ADVANCED_OPTIMIZATION", "0")


def pytest_addoption(parser):
    parser.addoption("--arch", default="cpu", choices=runtime.ARCHES, help="Taichi arch to test on")


def precisions(config):
    """Vulkan and Metal have no f64 in Taichi."""
    return ["f32"] if config.getoption("--arch") in ("vulkan", "metal") else ["f32", "f64"]


def pytest_generate_tests(metafunc):
    """Tests that ask for `precision` run in both; those that ask for `scheme` too run with every scheme. The implicit
    ones share their solver, which takes longest to compile: in the lower precision one of them stands for all."""
    if "scheme" in metafunc.fixturenames:
        known, numbers = schemes(), precisions(metafunc.config)
        of_all = {name for name, scheme in known.items() if not scheme.solves} | {"backward-euler"}
        cases = [(p, name) for p in numbers for name in sorted(known) if p == numbers[-1] or name in of_all]
        metafunc.parametrize(("precision", "scheme"), cases, indirect=["precision"], scope="module")
    elif "precision" in metafunc.fixturenames:
        wanted = precisions(metafunc.config)
        marker = metafunc.definition.get_closest_marker("one_precision")
        if marker:
            wanted = list(marker.args) or wanted[-1:]
        metafunc.parametrize("precision", wanted, indirect=True, scope="module")


@pytest.fixture(scope="module")
def precision(request):
    """Taichi started once per module and precision."""
    runtime.start(request.config.getoption("--arch"), request.param)
    return request.param


@pytest.fixture(scope="module")
def best_precision(request):
    """Taichi started in the highest precision that the arch has."""
    chosen = precisions(request.config)[-1]
    runtime.start(request.config.getoption("--arch"), chosen)
    return chosen


@pytest.fixture
def anew(request):
    """anew(): Taichi as after its start. A second simulation of one scene then finds its kernels compiled; without,
    Taichi compiles them again, as it keeps them by the running numbers of their fields."""
    return lambda: runtime.start(request.config.getoption("--arch"), runtime.current().precision)


@pytest.fixture
def epsilon():
    """The rounding unit of the running precision."""
    return runtime.current().epsilon


@pytest.fixture
def jello(tmp_path, request):
    """Run the command line in a folder of its own: jello("run", "cube", …) -> CompletedProcess."""

    def run(*arguments, timeout=120, **options):
        command = [sys.executable, "-m", "taichi_jello", *map(str, arguments)]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=timeout, **options)

    return run


@pytest.fixture
def here(tmp_path, monkeypatch, capfd):
    """The same in the tests' own process, for what does not need a new one: that takes a second of CPU time each."""

    def run(*arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # the command line sets its own
        capfd.readouterr()
        try:
            status = cli.main([str(argument) for argument in arguments])
        except SystemExit as end:
            status = end.code
        return subprocess.CompletedProcess(arguments, status, *capfd.readouterr())

    return run
