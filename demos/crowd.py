"""Twenty-seven cubes are poured into a box, where they pile up and jostle each other."""

from taichi_jello import Box, Camera, Contact, Room, Scene, Solver

SIDE = 0.4  # m


def scene() -> Scene:
    jello = []
    for k in range(27):
        layer, row, column = k // 4, k // 2 % 2, k % 2
        jello.append(
            Box(
                points=(6, 6, 6),
                size=(SIDE, SIDE, SIDE),
                position=(0.62 * column - 0.31 + 0.05 * (layer % 3), 0.4 + 0.62 * layer, 0.68 * row - 0.34),
                rotation=(37.0 * k % 90.0, 53.0 * k % 90.0, 71.0 * k % 90.0),
                velocity=(0.0, -1.0, 0.0),
                mass=0.064,
                stiffness=4.0,
                damping=0.003,
            )
        )
    return Scene(
        title="Crowd",
        seconds=5.0,
        jello=jello,
        collider=[Room(min=(-0.75, 0.0, -0.75), max=(0.75, 6.0, 0.75))],
        contact=Contact(stiffness=18.0, damping=0.018, friction=0.2),
        solver=Solver(method="rk4"),
        camera=Camera(eye=(1.6, 2.1, 3.2), target=(0.0, 0.75, 0.0), show="skin"),
    )
