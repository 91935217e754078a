"""Where a picture is taken from: an eye that circles a target, and the matrices both renderers draw with."""

from dataclasses import dataclass, field

import numpy as np

from taichi_jello.physics.colliders.room import Room
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Camera, Scene

NEAR = 0.05  # m; nothing nearer to the eye is drawn
FAR = 1e5  # m
STEEPEST = 0.995  # the sine of the steepest view up or down: at 1 the picture would spin about its own axis
UP = np.array([0.0, 1.0, 0.0])
FILLED = 0.85  # of the picture's half height and width, by what a view is fitted to
AROUND = 2.0  # of the jellos' diagonal: how far from them a large collider counts
TURNS = np.radians([0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0])  # of the eye around the scene
LOST = 0.12  # of the same: what takes less is looked at from nearer
ASPECT = 16.0 / 9.0  # of the pictures that cameras are set up for


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


@dataclass
class Viewpoint:
    """A perspective camera, y up. eye, target (3,) [m]; fov: vertical field of view [degrees]."""

    eye: np.ndarray
    target: np.ndarray
    fov: float = 40.0
    _start: tuple[np.ndarray, np.ndarray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.eye, self.target = np.array(self.eye, float), np.array(self.target, float)
        self._start = (self.eye.copy(), self.target.copy())

    @classmethod
    def of(cls, camera: Camera, aspect: float = ASPECT) -> "Viewpoint":
        """The viewpoint that a scene asks for. A picture narrower than 16:9 shows as much across as one of 16:9, and
        more above and below."""
        fov = camera.fov
        if aspect < ASPECT:
            fov = 2.0 * float(np.degrees(np.arctan(np.tan(np.radians(fov) / 2.0) * ASPECT / aspect)))
        return cls(np.array(camera.eye), np.array(camera.target), fov)

    @classmethod
    def first(cls, scene: Scene, body: Body, aspect: float = ASPECT) -> "Viewpoint":
        """The scene's own; where it has none, and the usual one leaves jellos, colliders or the floor below jellos out
        of a picture `aspect` times as wide as high, or makes them too small, one that shows them, if it
        can from the same side."""
        view, usual = cls.of(scene.camera, aspect), Camera()
        if (scene.camera.eye, scene.camera.target) != (usual.eye, usual.target):
            return view
        corners = _corners(scene, body)
        middle, away = 0.5 * (corners.min(0) + corners.max(0)), view.eye - view.target
        centred = cls(middle + away, middle, view.fov)
        shown = view.way_to(corners, 1.0, aspect) <= 0.0 < centred.way_to(corners, LOST, aspect)
        if shown and view.clear_of(scene):
            return view
        least = 2.0 * NEAR + 0.5 * float(np.linalg.norm(np.ptp(corners, axis=0)))
        fitted = []
        for turn in TURNS:  # the first from which nothing is seen through the ground
            side = cls(middle + away, middle, view.fov)
            side.orbit(turn, 0.0)
            distance = max(least, view.distance + side.way_to(corners, FILLED, aspect))
            fitted.append(cls(middle + _unit(side.eye - middle) * distance, middle, view.fov))
            if fitted[-1].clear_of(scene):
                return fitted[-1]
        return fitted[0]

    def clear_of(self, scene: Scene) -> bool:
        """Whether the eye is outside all colliders but rooms, whose walls are not drawn."""
        solid = [collider for collider in scene.collider if not isinstance(collider, Room)]
        return all(float(each.distance((self.eye - each.place(0.0))[None])[0]) > 0.0 for each in solid)

    def way_to(self, points: np.ndarray, filled: float, aspect: float) -> float:
        """How far [m] the eye has to go back until the points (n, 3) take at most `filled` of the picture's half height
        and width; negative where it may go nearer."""
        across, up, back = self.axes() @ (points - self.eye).T
        slope = filled * np.tan(np.radians(self.fov) / 2.0)
        return float((back + np.maximum(np.abs(across) / aspect, np.abs(up)) / slope).max())

    def reset(self) -> None:
        """Back to where it was made."""
        self.eye, self.target = (part.copy() for part in self._start)

    @property
    def distance(self) -> float:
        """From the eye to the target [m]."""
        return float(np.linalg.norm(self.eye - self.target))

    def axes(self) -> np.ndarray:
        """(3, 3): the unit vectors to the right, up and back towards the viewer, one a row."""
        back = _unit(self.eye - self.target)
        up = UP if abs(back[1]) < 0.99999 else np.array([0.0, 0.0, -1.0])
        right = _unit(np.cross(up, back))
        return np.stack([right, np.cross(back, right), back])

    def orbit(self, across: float, up: float) -> None:
        """Circle the target by `across` [rad] to the right and by `up` [rad], never over the poles."""
        arm = self.eye - self.target
        length = np.linalg.norm(arm)
        height = np.arcsin(np.clip(arm[1] / length, -1.0, 1.0)) + up
        limit = np.arcsin(STEEPEST)
        height = float(np.clip(height, -limit, limit))
        around = np.arctan2(arm[0], arm[2]) + across
        flat = np.cos(height)
        self.eye = self.target + length * np.array([flat * np.sin(around), np.sin(height), flat * np.cos(around)])

    def pan(self, right: float, up: float) -> None:
        """Move eye and target together in the picture plane [m]."""
        axes = self.axes()
        shift = right * axes[0] + up * axes[1]
        self.eye, self.target = self.eye + shift, self.target + shift

    def zoom(self, factor: float) -> None:
        """Multiply the distance to the target, kept between 5 cm and 500 m, or three times what it was first."""
        arm, first = self.eye - self.target, float(np.linalg.norm(self._start[0] - self._start[1]))
        length = float(np.clip(np.linalg.norm(arm) * factor, 0.05, max(500.0, 3.0 * first)))
        self.eye = self.target + _unit(arm) * length

    def view(self) -> np.ndarray:
        """(4, 4) world to camera space, for column vectors."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.axes()
        matrix[:3, 3] = -matrix[:3, :3] @ self.eye
        return matrix

    def projection(self, aspect: float) -> np.ndarray:
        """(4, 4) camera space to clip space, for column vectors; the depth runs from 1 at NEAR to 0 at
        FAR."""
        focal = 1.0 / np.tan(np.radians(self.fov) / 2.0)
        span = FAR - NEAR
        return np.array(
            [
                [focal / aspect, 0.0, 0.0, 0.0],
                [0.0, focal, 0.0, 0.0],
                [0.0, 0.0, NEAR / span, FAR * NEAR / span],
                [0.0, 0.0, -1.0, 0.0],
            ]
        )

    def to_pixels(self, size: tuple[int, int]) -> np.ndarray:
        """(3, 4): takes a point (x, y, z, 1) to (column·w, row·w, w), where w is its depth [m] along the view
        and the picture's upper left corner is the pixel coordinate (0, 0)."""
        width, height = size
        clip = self.projection(width / height) @ self.view()
        column = 0.5 * width * (clip[3] + clip[0])
        row = 0.5 * height * (clip[3] - clip[1])
        return np.stack([column, row, clip[3]])

    def project(self, points: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """(n, 2) columns and rows [pixels] of points (n, 3) [m]; NaN for a point that is not before the
        eye."""
        matrix = self.to_pixels(size)
        flat = np.asarray(points, float) @ matrix[:, :3].T + matrix[:, 3]
        depth = np.where(flat[:, 2:] > NEAR, flat[:, 2:], np.nan)
        return flat[:, :2] / depth

    def sees(self, points: np.ndarray, size: tuple[int, int]) -> bool:
        """Whether what is between the points (n, 3) [m] may be in the picture: False if all are beyond the same edge of
        it, or behind the eye."""
        matrix = self.to_pixels(size)
        column, row, depth = matrix[:, :3] @ np.asarray(points, float).T + matrix[:, 3:]
        width, height = size
        beyond = [column < 0.0, column > width * depth, row < 0.0, row > height * depth, depth < NEAR]
        return not any(side.all() for side in beyond)

    def pixels_per_meter(self, height: int) -> float:
        """How many pixels one metre at a distance of one metre covers in a picture `height` pixels high."""
        return 0.5 * height / float(np.tan(np.radians(self.fov) / 2.0))


def _corners(scene: Scene, body: Body) -> np.ndarray:
    """(n, 3) [m]: of the box around all jellos, of that below it on the highest floor, and of the finite colliders. Of
    a collider much larger than the jellos only what is near them counts, but of a room all."""
    low, high = body.x.min(0), body.x.max(0)
    floors = [level for collider in scene.collider if (level := collider.floor()) is not None and level < low[1]]
    boxes = [(np.array([low[0], max(floors, default=low[1]), low[2]]), high)]
    reach = AROUND * float(np.linalg.norm(high - low))
    for collider in scene.collider:
        if (extent := collider.extent()) is None:
            continue
        first, last = extent + collider.place(0.0)
        if not isinstance(collider, Room):
            near = (first < high + reach) & (last > low - reach)
            first, last = np.where(
                near, [np.maximum(first, low - reach), np.minimum(last, high + reach)], [first, last]
            )
        boxes.append((first, last))
    return np.array([[box[k >> axis & 1][axis] for axis in range(3)] for box in boxes for k in range(8)])
