"""One scene in a fresh process: `python -m taichi_jello.studies._probe SCENE [options of jello explain]` prints as JSON
what it compiles in, how many kernels that takes and how long until its first frame is done, and the frames after it."""

import contextlib
import io
import json
import statistics
import sys
import time
from typing import Any

from taichi.lang.kernel_impl import Kernel

from taichi_jello.app.cli import make_scene, make_simulation
from taichi_jello.app.options import options
from taichi_jello.run.explain import facts
from taichi_jello.run.simulation import Simulation
from taichi_jello.support import runtime

FRAMES, LEAST = 0.5, 3  # s of frames that are timed, and how many at least


def main(arguments: list[str]) -> None:
    chosen = options().parse_args(["explain", *arguments])
    kernels: list[str] = []
    materialize = Kernel.materialize

    def counted(self: Any, *args: Any, **named: Any) -> Any:
        before = len(self.compiled_kernels)
        done = materialize(self, *args, **named)
        kernels.extend([self.func.__name__] * (len(self.compiled_kernels) - before))
        return done

    Kernel.materialize = counted
    with contextlib.redirect_stdout(io.StringIO()):  # a scene's own prints are no figures
        scene = make_scene(chosen)
        runtime.start(chosen.arch, chosen.precision, chosen.threads)
        start = time.perf_counter()
        simulation = make_simulation(chosen, scene)
        simulation.frame()
        seconds = time.perf_counter() - start
        frames = frame_seconds(simulation)
    told = {"kernels": kernels, "seconds": seconds, "frame_seconds": frames, "facts": facts(simulation)}
    print(json.dumps(told))


def frame_seconds(simulation: Simulation) -> float:
    """The median time of the frames that follow, of half a second of them or as many as the scene has."""
    times: list[float] = []
    while sum(times) < FRAMES and (len(times) < LEAST or simulation.time < simulation.scene.seconds):
        start = time.perf_counter()
        simulation.frame()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


if __name__ == "__main__":
    main(sys.argv[1:])
