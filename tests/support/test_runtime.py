"""What a start of Taichi does to the process: its workers' cores."""

import os
import sys
import time

import pytest

from taichi_jello import Box, Scene, Simulation
from taichi_jello.support import runtime


def threads():
    return {int(number) for number in os.listdir("/proc/self/task")}


def allowed(task):
    return os.sched_getaffinity(task)


def used(task):
    """CPU time [ticks] of a thread of this process, see proc(5)."""
    with open(f"/proc/self/task/{task}/stat") as stat:
        return sum(int(word) for word in stat.read().rpartition(")")[2].split()[11:13])


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have no /proc")
@pytest.mark.skipif(len(runtime.usable_cores()) < 2, reason="on one core there is no team")
def test_each_worker_has_a_core_of_its_own():
    cores = runtime.usable_cores()
    runtime.start("cpu", "f32")
    simulation = Simulation(Scene(jello=[Box(points=(9, 9, 9))]), team=len(cores))
    simulation.system.size.hold(len(cores))  # else fewer, where something else runs
    simulation.frame()
    tasks = threads() - {os.getpid()}
    before, end = {task: used(task) for task in tasks}, time.perf_counter() + 0.5
    while time.perf_counter() < end:
        simulation.frame()
    busy = [task for task in tasks & threads() if used(task) > before[task] + 5]
    assert len(busy) == len(cores)
    assert sorted(core for task in busy for core in allowed(task)) == cores
    runtime.settle(False)
    assert all(allowed(task) == set(cores) for task in busy)
    runtime.settle(True)
    assert sorted(core for task in busy for core in allowed(task)) == cores
    assert allowed(0) == set(cores)  # nothing else is bound, nor what this process starts
    runtime.start("cpu", "f32", 1)
    assert all(len(allowed(task)) > 1 for task in threads())
