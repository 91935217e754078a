"""A sheet is pinned along two sides; jellos are dropped on it, and it carries them."""

from taichi_jello import Box, Camera, Contact, Pin, Plane, Scene, Sheet, Solver


def scene() -> Scene:
    bridge = Sheet(
        points=(33, 13),
        size=(2.4, 0.9),
        position=(0.0, 1.0, 0.0),
        mass=0.6,
        stiffness=120.0,
        damping=0.05,
        pin=[Pin(max=(0.0, 1.0, 1.0)), Pin(min=(1.0, 0.0, 0.0))],
    )
    cubes = [
        Box(
            points=(5, 5, 5),
            size=(0.36, 0.36, 0.36),
            position=(x, y, z),
            rotation=turn,
            mass=0.15,
            stiffness=30.0,
            damping=0.03,
        )
        for x, y, z, turn in (
            (-0.55, 1.5, 0.05, (0.0, 20.0, 10.0)),
            (0.1, 1.9, -0.03, (30.0, 0.0, 40.0)),
            (0.6, 2.3, 0.0, (0.0, 45.0, 0.0)),
        )
    ]
    return Scene(
        title="Bridge",
        seconds=5.0,
        jello=[bridge, *cubes],
        collider=[Plane()],
        contact=Contact(stiffness=300.0, damping=0.1, friction=0.5),
        solver=Solver(method="rk4"),
        camera=Camera(eye=(1.7, 2.0, 3.3), target=(0.0, 0.8, 0.0)),
    )
