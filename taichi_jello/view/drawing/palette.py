"""The colours and the light of every picture: display RGB (gamma-encoded) between 0 and 1."""

import numpy as np

from taichi_jello.scene.description import Collider, Jello, Scene

SKY_LOW = np.array([0.955, 0.962, 0.970])  # behind words alone
GROUND = np.array([0.768, 0.775, 0.793])
GRID = np.array([0.640, 0.665, 0.705])
EDGE = np.array([0.55, 0.58, 0.63])
OBSTACLE = np.array([0.70, 0.74, 0.79])
SHADOW = np.array([0.44, 0.46, 0.54])
PARTICLE = np.array([0.13, 0.14, 0.20])
INK = np.array([0.13, 0.15, 0.20])
ALARM = np.array([0.93, 0.00, 0.62])
PAPER = np.array([0.985, 0.985, 0.990])

GAMMA = 2.2  # a display's: radiances are colours to this power
# One skin colour per jello, in turn: strawberry, lime, orange, blueberry, grape, lemon, mint, raspberry.
SKINS = np.array(
    [
        [0.93, 0.17, 0.22],
        [0.52, 0.82, 0.18],
        [0.99, 0.56, 0.10],
        [0.30, 0.47, 0.92],
        [0.64, 0.36, 0.84],
        [0.99, 0.85, 0.22],
        [0.20, 0.76, 0.68],
        [0.96, 0.36, 0.58],
    ]
)
# From blue at zero to red at the maximum, without a grey that would vanish in the skin.
FORCE_RAMP = np.array(
    [[0.16, 0.36, 0.96], [0.05, 0.62, 0.92], [0.20, 0.80, 0.42], [1.00, 0.80, 0.10], [0.92, 0.07, 0.09]]
)
FAMILIES = np.array([[0.12, 0.30, 0.80], [0.90, 0.47, 0.08], [0.10, 0.58, 0.34], [0.45, 0.45, 0.48]])
PLAIN = np.array([0.20, 0.24, 0.34])

_KEY = np.array([-0.42, 1.0, 0.46])
KEY_LIGHT = _KEY / np.linalg.norm(_KEY)  # towards the lamp, over the viewer's left shoulder


def skin(jello: Jello, number: int) -> np.ndarray:
    """(3,): of the jello with this number in its scene."""
    return SKINS[number % len(SKINS)] if jello.color is None else np.array(jello.color)


def obstacle(collider: Collider) -> np.ndarray:
    """(3,): of a collider's surface."""
    return OBSTACLE if collider.color is None else np.array(collider.color)


def ground(scene: Scene) -> np.ndarray:
    """(3,): of the scene's level floor."""
    floors = [each.color for each in scene.collider if each.floor() is not None]
    return np.array(next((color for color in (scene.ground.color, *floors) if color is not None), GROUND))
