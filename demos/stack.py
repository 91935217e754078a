"""Three cubes and a ball are dropped a little and come to rest on each other."""

from taichi_jello import Ball, Box, Camera, Contact, Plane, Scene, Solver

SIDE = 0.5  # m


def scene() -> Scene:
    cubes = [
        Box(
            points=(6, 6, 6),
            size=(SIDE, SIDE, SIDE),
            position=(x, y, z),
            rotation=(0.0, turn, 0.0),
            mass=0.125,
            stiffness=60.0,
            damping=0.06,
        )
        for x, y, z, turn in ((-0.3, 0.255, 0.0, 0.0), (0.3, 0.255, 0.03, 0.0), (0.0, 0.77, 0.015, 30.0))
    ]
    ball = Ball(radius=0.25, resolution=6, position=(0.0, 1.29, 0.015), mass=0.125, stiffness=60.0, damping=0.06)
    return Scene(
        title="Stack",
        seconds=5.0,
        jello=[*cubes, ball],
        collider=[Plane()],
        contact=Contact(stiffness=700.0, damping=0.5, friction=0.6),
        solver=Solver(method="rk4"),
        camera=Camera(eye=(1.2, 1.35, 2.4), target=(0.0, 0.7, 0.0), scale=0.02),
    )
