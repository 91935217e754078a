"""The pictures of the demos in `shots`: `python demos/_pictures.py [NAME …]`, from the top folder."""

import sys
from pathlib import Path

import taichi_jello.scenefiles as sceneio
from taichi_jello import Simulation, runtime
from taichi_jello.film import Film
from taichi_jello.support.png_file import write_png
from taichi_jello.view.render.film_frames import Clock, Pictures

FOLDER = Path("shots")
MOMENTS = {
    "hero": {"hero": 0.75},
    "cube": {"cube": 0.62, "cube_late": 1.3},
    "sphere": {"sphere": 1.0},
    "room": {"room": 0.2},
    "family": {"family": 1.0},
    "regions": {"regions": 0.6},
    "tear": {"tear": 1.6},
    "rabbit": {"rabbit": 0.5},
    "teapot": {"teapot": 0.5},
    "melt": {"melt": 3.0, "melt_frozen": 6.1},
    "crowd": {"crowd": 1.5},
    "chain": {"chain": 1.0},
    "bridge": {"bridge": 0.8},
    "stack": {"stack": 0.6},
}  # by demo: the moment [s] of each file
FILM, RATE, LENGTH = (560, 315), 20, 3.0  # size [pixels], frames and seconds of cube.gif


def opened(name: str, size: tuple[int, int]) -> tuple[Simulation, Pictures]:
    runtime.start()
    simulation = Simulation(sceneio.load(name))
    return simulation, Pictures(simulation, size)


def shots(name: str) -> None:
    simulation, camera = opened(name, (960, 540))
    for file, moment in MOMENTS[name].items():
        simulation.advance(moment - simulation.time)
        write_png(FOLDER / f"{file}.png", camera.take())
    camera.close()


def film() -> None:
    simulation, camera = opened("cube", FILM)
    with Film(FOLDER / "cube.gif", FILM, RATE) as gif:
        clock = Clock(simulation, gif.rate)
        for frame in range(clock.frames(LENGTH)):
            clock.go(frame)
            gif.add(camera.take())
    camera.close()


if __name__ == "__main__":
    for demo in sys.argv[1:] or MOMENTS:
        shots(demo)
        print(demo, flush=True)
    if not sys.argv[1:] or "cube" in sys.argv[1:]:
        film()
