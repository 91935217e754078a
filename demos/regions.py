"""A cube with a soft lower half and a hard core in the upper one lands and sags where it is soft."""

from taichi_jello import Box, Camera, Contact, Plane, Region, Scene


def scene() -> Scene:
    return Scene(
        title="Regions of stiffness",
        seconds=5.0,
        jello=[
            Box(
                points=(9, 9, 9),
                position=(0.0, 0.9, 0.0),
                rotation=(0.0, 30.0, 0.0),
                mass=4.0,
                stiffness=60.0,
                damping=0.15,
                region=[
                    Region(max=(1.0, 0.5, 1.0), stiffness=8.0, damping=0.1),
                    Region(center=(0.5, 0.8, 0.5), radius=0.3, stiffness=180.0),
                ],
            )
        ],
        collider=[Plane()],
        contact=Contact(stiffness=2000.0, damping=0.5),
        camera=Camera(eye=(2.0, 1.6, 3.0), target=(0.0, 0.5, 0.0), color="stiffness"),
    )
