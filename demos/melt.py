"""A tall jello melts over a ball into a puddle, which then freezes in its new shape."""

from taichi_jello import Box, Camera, Contact, Keyframe, Plane, Scene


def scene() -> Scene:
    return Scene(
        title="Melting and freezing",
        seconds=8.0,
        jello=[
            Box(
                points=(8, 11, 8),
                size=(0.8, 1.1, 0.8),
                position=(0.0, 0.6, 0.0),
                stiffness=40.0,
                damping=0.05,
                keyframe=[
                    Keyframe(time=1.0, stiffness=1.0),
                    Keyframe(time=3.5, stiffness=0.01),
                    Keyframe(time=5.0, stiffness=0.01, freeze=True),
                    Keyframe(time=5.5, stiffness=1.0),
                ],
            )
        ],
        contact=Contact(stiffness=2000.0, damping=0.2, friction=0.1),
        collider=[Plane()],
        camera=Camera(eye=(2.0, 1.7, 3.0), target=(0.0, 0.35, 0.0), color="force"),
    )
