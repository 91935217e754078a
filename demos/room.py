"""A soft cube is thrown hard inside a box and hits all its walls."""

from taichi_jello import Box, Camera, Contact, Room, Scene


def scene() -> Scene:
    return Scene(
        title="Thrown in a room",
        seconds=5.0,
        gravity=(0.0, -4.0, 0.0),
        jello=[
            Box(
                position=(0.0, 1.2, 0.0),
                velocity=(9.0, 7.0, 6.0),
                spin=(1.0, 3.0, 2.0),
                stiffness=14.0,
                damping=0.01,
                volume=1.0,
                color="#a35cd6",
            )
        ],
        contact=Contact(stiffness=2000.0, damping=0.05, friction=0.1),
        collider=[Room(min=(-1.3, 0.0, -1.3), max=(1.3, 2.6, 1.3))],
        camera=Camera(eye=(2.7, 2.0, 4.4), target=(0.0, 1.2, 0.0), scale=0.5),
    )
