"""A rabbit hops down onto the ground, wobbles, and stands on its feet with its ears up."""

from taichi_jello import Camera, Contact, Mesh, Plane, Scene


def scene() -> Scene:
    return Scene(
        title="Rabbit",
        seconds=4.0,
        jello=[
            Mesh(
                file="meshes/rabbit.ply",
                resolution=20,
                size=1.48,
                position=(0.0, 1.0, 0.0),
                rotation=(0.0, -20.0, 0.0),
                stiffness=15.0,
                damping=0.02,
                color="#f55c94",
            )
        ],
        contact=Contact(stiffness=500.0, damping=0.5, friction=0.8),
        collider=[Plane()],
        camera=Camera(eye=(1.1, 1.25, 2.75), target=(0.0, 0.72, 0.0), show="skin"),
    )
