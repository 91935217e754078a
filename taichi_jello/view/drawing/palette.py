"""The colours and the light of every picture: display RGB (gamma-encoded) between 0 and 1."""

import numpy as np

SKY_TOP = np.array([0.765, 0.835, 0.905])
SKY_LOW = np.array([0.955, 0.962, 0.970])  # at the lower edge of the picture
GROUND = np.array([0.885, 0.890, 0.900])
GRID = np.array([0.640, 0.665, 0.705])
EDGE = np.array([0.55, 0.58, 0.63])
OBSTACLE = np.array([0.70, 0.74, 0.79])
SHADOW = np.array([0.44, 0.46, 0.54])
PARTICLE = np.array([0.13, 0.14, 0.20])
INK = np.array([0.13, 0.15, 0.20])
ALARM = np.array([0.93, 0.00, 0.62])
PAPER = np.array([0.985, 0.985, 0.990])

# One skin colour per jello, in turn: raspberry, lime, blueberry, orange, grape, lagoon.
SKINS = np.array(
    [
        [0.93, 0.17, 0.22],
        [0.35, 0.72, 0.22],
        [0.24, 0.42, 0.9],
        [0.97, 0.55, 0.12],
        [0.58, 0.28, 0.8],
        [0.1, 0.66, 0.66],
    ]
)
# From blue at zero to red at the maximum, without a grey that would vanish in the skin.
FORCE_RAMP = np.array(
    [[0.16, 0.36, 0.96], [0.10, 0.55, 0.86], [0.22, 0.72, 0.42], [0.96, 0.74, 0.12], [0.86, 0.07, 0.09]]
)
FAMILIES = np.array([[0.12, 0.30, 0.80], [0.90, 0.47, 0.08], [0.10, 0.58, 0.34], [0.45, 0.45, 0.48]])
PLAIN = np.array([0.20, 0.24, 0.34])

_KEY = np.array([-0.42, 1.0, 0.46])
KEY_LIGHT = _KEY / np.linalg.norm(_KEY)  # towards the lamp, over the viewer's left shoulder
