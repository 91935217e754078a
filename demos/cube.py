"""A cube of 8×8×8 points falls, bounces off the ground, a sphere and the walls of its room, and comes to rest."""

from taichi_jello import Box, Camera, Contact, Room, Scene, Sphere


def scene() -> Scene:
    return Scene(
        title="Jello cube",
        seconds=6.0,
        jello=[
            Box(
                position=(-0.45, 2.3, 0.1),
                rotation=(25.0, 0.0, 30.0),
                velocity=(3.0, 0.0, 0.4),
                stiffness=30.0,
                damping=0.03,
                volume=1.0,
            )
        ],
        collider=[
            Room(min=(-1.6, 0.0, -1.3), max=(1.6, 4.0, 1.3)),
            Sphere(center=(-0.2, 0.1, 0.0), radius=0.45),
        ],
        contact=Contact(stiffness=2000.0, damping=0.5),
        camera=Camera(eye=(2.7, 2.4, 4.7), target=(0.0, 1.28, 0.0), scale=0.2),
    )
