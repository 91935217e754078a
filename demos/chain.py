"""Seven rings of jello hang in each other; the chain is let go aslant and swings."""

import numpy as np

from taichi_jello import Camera, Contact, Pin, Ring, Scene, Solver

RADIUS, THICKNESS, LINKS = 0.2, 0.09, 7
STEP = 2.0 * RADIUS - THICKNESS - 0.02  # m between middles: the rings do not quite touch at first
TILT = 30.0  # degrees from the vertical


def scene() -> Scene:
    along = np.array([np.sin(np.radians(TILT)), -np.cos(np.radians(TILT)), 0.0])
    top = np.array([-0.5, 2.3, 0.0])
    return Scene(
        title="Chain",
        seconds=6.0,
        jello=[
            Ring(
                radius=RADIUS,
                thickness=THICKNESS,
                points=(24, 3),
                position=tuple(top + k * STEP * along),
                rotation=(0.0, 90.0 * (k % 2), TILT),
                mass=0.2,
                stiffness=400.0,
                damping=0.1,
                pin=[Pin(min=(0.0, 0.92, 0.0))] if k == 0 else [],
            )
            for k in range(LINKS)
        ],
        contact=Contact(stiffness=800.0, damping=0.2, friction=0.2),
        solver=Solver(method="rk4"),
        camera=Camera(eye=(0.3, 1.6, 3.4), target=(-0.25, 1.4, 0.0), show="skin"),
    )
