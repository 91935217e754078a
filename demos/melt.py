"""A jello melts into a puddle, which freezes in its new shape and is kicked up by a ball from below."""

from taichi_jello import Box, Camera, Contact, Keyframe, Move, Plane, Scene, Sphere


def scene() -> Scene:
    return Scene(
        title="Melting and freezing",
        seconds=8.0,
        jello=[
            Box(
                points=(9, 9, 9),
                size=(0.9, 0.9, 0.9),
                position=(0.0, 0.5, 0.0),
                stiffness=40.0,
                damping=0.02,
                keyframe=[
                    Keyframe(time=0.8, stiffness=1.0, damping=1.0),
                    Keyframe(time=2.0, stiffness=0.02, damping=0.2),
                    Keyframe(time=3.0, stiffness=0.006),
                    Keyframe(time=4.8, stiffness=0.006, damping=0.2, freeze=True),
                    Keyframe(time=5.2, stiffness=2.0, damping=3.0),
                ],
            )
        ],
        contact=Contact(stiffness=1000.0, damping=0.1, friction=0.02),
        collider=[
            Plane(),
            Sphere(
                center=(0.1, -0.45, 0.0),
                radius=0.4,
                keyframe=[
                    Move(time=5.8, offset=(0.0, 0.0, 0.0)),
                    Move(time=6.1, offset=(0.0, 0.35, 0.0)),
                    Move(time=7.0, offset=(0.0, 0.0, 0.0)),
                ],
            ),
        ],
        camera=Camera(eye=(1.7, 1.4, 2.5), target=(0.0, 0.3, 0.0)),
    )
