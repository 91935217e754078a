"""The Utah teapot as a jello drops onto the ground: handle and spout swing, and it stands."""

from taichi_jello import Camera, Contact, Mesh, Plane, Scene


def scene() -> Scene:
    return Scene(
        title="Teapot",
        seconds=4.0,
        jello=[
            Mesh(
                file="meshes/teapot.ply",
                resolution=20,
                size=1.8,
                position=(0.0, 0.75, 0.0),
                rotation=(0.0, 20.0, 6.0),
                stiffness=20.0,
                damping=0.015,
                color="#4d78eb",
            )
        ],
        contact=Contact(stiffness=500.0, damping=1.0, friction=0.8),
        collider=[Plane()],
        camera=Camera(eye=(0.8, 1.15, 2.5), target=(0.05, 0.4, 0.0), show="skin"),
    )
