"""A slab is pulled at both ends by handles until it tears in two where it is soft."""

from taichi_jello import Box, Camera, Contact, Move, Pin, Plane, Region, Scene

PULL = 0.7  # m that each end travels


def scene() -> Scene:
    def path(sign: float) -> list[Move]:
        return [Move(time=0.5, offset=(0.0, 0.0, 0.0)), Move(time=3.0, offset=(sign * PULL, 0.0, 0.0))]

    return Scene(
        title="Torn in two",
        seconds=5.0,
        jello=[
            Box(
                points=(25, 5, 9),
                size=(1.6, 0.27, 0.53),
                position=(0.0, 0.9, 0.0),
                mass=3.0,
                stiffness=50.0,
                damping=0.1,
                tear_strain=0.8,
                color="#fc8f1a",
                region=[
                    Region(min=(0.48, 0.0, 0.0), max=(0.56, 1.0, 1.0), stiffness_factor=0.4),
                    Region(center=(0.5, 0.5, 1.0), radius=0.3, stiffness_factor=0.6),
                ],
                pin=[
                    Pin(max=(0.04, 1.0, 1.0), keyframe=path(-1.0)),
                    Pin(min=(0.96, 0.0, 0.0), keyframe=path(1.0)),
                ],
            )
        ],
        collider=[Plane()],
        contact=Contact(stiffness=2000.0, damping=0.5),
        camera=Camera(eye=(0.5, 1.6, 2.7), target=(0.0, 0.75, 0.0), color="strain", scale=50.0),
    )
