"""The three spring families in their colours, on a slowly turning cube: structural, shear and bend."""

from taichi_jello import Box, Camera, Scene


def scene() -> Scene:
    return Scene(
        title="Spring families",
        seconds=8.0,
        gravity=(0.0, 0.0, 0.0),
        jello=[Box(points=(4, 4, 4), position=(0.0, 0.8, 0.0), rotation=(20.0, 0.0, 10.0), spin=(0.0, 0.6, 0.0))],
        camera=Camera(eye=(1.4, 1.6, 2.4), target=(0.0, 0.8, 0.0), color="family"),
    )
