"""Compiles what the accuracy study comes to next into Taichi's kernel cache, in a process of its own: half of the
study's time would be compiling, on one core. A kernel is found there if its fields were made in the same order since
Taichi's start: `begun` is where the study and its helper do that alike. The helper rests while timings are taken."""

import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from taichi_jello.run.clock import StepWarning
from taichi_jello.run.simulation import Simulation
from taichi_jello.studies._accuracy.cases import Case, default
from taichi_jello.support import runtime

Rest = Callable[[], AbstractContextManager[Any]]


def begun(case: Case, method: str) -> Simulation:
    """The case's simulation, with all kernels compiled that it takes to roll it out."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)
        simulation = Simulation(case.scene, method=method, substeps=1_000_000)
    simulation.step(1)
    simulation.energies()
    simulation.reset()
    return simulation


@contextmanager
def compiling_ahead(arch: str, threads: int | None, methods: list[str], quick: bool) -> Iterator[Rest]:
    """Within, a helper compiles the default cases; what is given is a context in which it rests. There is none where
    a process cannot be stopped, or with a single core."""
    helper = None
    if hasattr(signal, "SIGSTOP") and len(runtime.usable_cores()) > 1:
        words = [arch, str(threads or 0), ",".join(methods), *["quick"] * quick]
        command = [sys.executable, "-m", "taichi_jello.studies._accuracy.ahead", *words]
        helper = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    @contextmanager
    def rest() -> Iterator[None]:
        if helper:
            helper.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            if helper:
                helper.send_signal(signal.SIGCONT)

    try:
        yield rest
    finally:
        if helper:
            helper.kill()
            helper.wait()


def main(arch: str, threads: str, methods: str, quick: str = "") -> None:
    asked_by = os.getppid()
    for number, case in enumerate(default(bool(quick))):
        for precision in ("f64", "f32"):
            if number == 0 and precision == "f64":
                continue  # the study begins with these itself
            runtime.start(arch, precision, int(threads) or None)
            for method in methods.split(","):
                if os.getppid() != asked_by:
                    return
                begun(case, method)
    runtime.start(arch)  # what was compiled is written when Taichi starts again


if __name__ == "__main__":
    main(*sys.argv[1:])
