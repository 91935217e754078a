"""A sheet is pinned along two sides, its other edges are firm; jellos are dropped on it, and it carries them."""

from taichi_jello import Box, Camera, Contact, Pin, Plane, Region, Scene, Sheet, Solver


def scene() -> Scene:
    bridge = Sheet(
        points=(33, 17),
        size=(2.4, 1.2),
        position=(0.0, 1.0, 0.0),
        mass=0.6,
        stiffness=120.0,
        damping=0.05,
        region=[Region(max=(1.0, 1.0, 0.15), stiffness_factor=4.0), Region(min=(0.0, 0.0, 0.85), stiffness_factor=4.0)],
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
            (-0.55, 1.4, 0.05, (0.0, 20.0, 10.0)),
            (0.05, 1.6, -0.03, (20.0, 0.0, 30.0)),
            (0.6, 1.8, 0.0, (0.0, 45.0, 0.0)),
        )
    ]
    return Scene(
        title="Bridge",
        seconds=5.0,
        jello=[bridge, *cubes],
        collider=[Plane()],
        contact=Contact(stiffness=300.0, damping=0.1, friction=0.8),
        solver=Solver(method="rk4"),
        camera=Camera(eye=(1.2, 1.85, 2.6), target=(0.0, 0.95, 0.0), scale=0.5),
    )
