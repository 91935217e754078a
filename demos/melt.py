"""A jello melts and flows into a puddle, which freezes in its new shape and is kicked up by a ball from below."""

from taichi_jello import Ball, Camera, Contact, Keyframe, Move, Plane, Scene, Sphere


def scene() -> Scene:
    return Scene(
        title="Melting and freezing",
        seconds=8.0,
        jello=[
            Ball(
                radius=0.5,
                resolution=9,
                position=(0.0, 0.51, 0.0),
                stiffness=40.0,
                damping=0.02,
                creep=4.0,
                volume=1.0,
                color="#85d12e",
                keyframe=[
                    Keyframe(time=0.5, stiffness=1.0, damping=1.0),
                    Keyframe(time=1.6, stiffness=0.035, damping=0.5),
                    Keyframe(time=4.6, stiffness=0.035, damping=0.5, freeze=True),
                    Keyframe(time=5.0, stiffness=3.0, damping=3.0),
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
        camera=Camera(eye=(1.1, 0.95, 1.65), target=(0.0, 0.33, 0.0), show="skin"),
    )
