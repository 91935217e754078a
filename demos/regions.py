"""A cube lands and sags where it is soft, in its yellow half below; a hard core above keeps its shape."""

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
                    Region(max=(1.0, 0.5, 1.0), stiffness=3.0, damping=0.05, color="gold"),
                    Region(center=(0.5, 0.8, 0.5), radius=0.3, stiffness=180.0, color="deeppink"),
                ],
            )
        ],
        collider=[Plane()],
        contact=Contact(stiffness=2000.0, damping=0.5),
        camera=Camera(eye=(1.35, 1.25, 2.0), target=(0.0, 0.44, 0.0), color="stiffness"),
    )
