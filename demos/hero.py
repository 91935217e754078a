"""A teapot, a cube, a ball, a ring and a tower of jello drop onto a table and wobble; the camera goes round."""

from taichi_jello import Background, Ball, Block, Box, Camera, Contact, Ground, Mesh, Plane, Ring, Scene, Solver

TABLE = Block(center=(0.0, -0.05, 0.0), size=(2.3, 0.3, 2.0), color="ivory")


def jellos() -> list[Ball | Box | Mesh | Ring]:
    soft = {"stiffness": 2.6, "damping": 0.005, "mass": 0.25}
    return [
        Box(points=(5, 5, 5), size=(0.5, 0.5, 0.5), position=(-0.62, 0.85, -0.45), rotation=(15.0, 30.0, 20.0),
            volume=1.0, **soft),
        Ball(radius=0.28, resolution=5, position=(-0.62, 0.95, 0.4), **soft),
        Box(points=(4, 6, 4), size=(0.38, 0.6, 0.38), position=(0.68, 0.52, -0.5), rotation=(0.0, 20.0, 0.0), **soft),
        Ring(radius=0.24, thickness=0.15, points=(14, 3), position=(0.42, 0.55, 0.52), rotation=(75.0, 0.0, 12.0),
             volume=1.0, color="gold", **soft),
        Mesh(file="meshes/teapot.ply", resolution=11, size=1.0, position=(0.05, 0.45, -0.08), rotation=(0.0, 30.0, 0.0),
             stiffness=5.0, damping=0.006, mass=0.5, color="hotpink"),
    ]  # fmt: skip


def scene() -> Scene:
    return Scene(
        title="Jellos on a table",
        seconds=6.0,
        jello=jellos(),
        collider=[Plane(), TABLE],
        contact=Contact(stiffness=25.0, damping=0.0015, friction=0.8),
        solver=Solver(method="symplectic-euler"),
        camera=Camera(eye=(1.25, 1.5, 2.3), target=(0.0, 0.33, 0.0), fov=38.0, show="skin", orbit=0.05),
        ground=Ground(color="lightsteelblue"),
        background=Background(top="#6f8fb0", bottom="#c9d6e2"),
    )
