"""A cube bounces off two spheres; one of them swings to and fro and kicks it."""

from taichi_jello import Box, Camera, Contact, Plane, Scene, Sphere


def scene() -> Scene:
    return Scene(
        title="Jello and spheres",
        seconds=5.0,
        jello=[
            Box(
                position=(0.1, 2.0, 0.0),
                rotation=(0.0, 20.0, 15.0),
                stiffness=20.0,
                damping=0.03,
                volume=1.0,
                color="#33c2ad",
            )
        ],
        collider=[
            Plane(),
            Sphere(center=(0.0, 0.35, 0.0), radius=0.5),
            Sphere(center=(1.5, 0.4, 0.0), radius=0.4, swing=(0.7, 0.0, 0.0), period=1.5),
        ],
        contact=Contact(stiffness=2000.0, damping=0.5),
        camera=Camera(eye=(2.0, 1.9, 3.7), target=(0.45, 0.85, 0.0), scale=0.5),
    )
