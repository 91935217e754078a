"""The camera: an eye that orbits a target, and the matrices that both renderers draw with."""

from dataclasses import dataclass, field

import numpy as np

from taichi_jello.physics.colliders.room import Room
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.scene.keyframes import smooth
from taichi_jello.scene.look import Camera

NEAR = 0.05  # m, near clipping plane
FAR = 1e5  # m, far clipping plane
MAX_ELEVATION_SINE = 0.995  # at 1 the picture would spin about its own axis
UP = np.array([0.0, 1.0, 0.0])
FIT = 0.85  # of the picture's half height and width, filled by a view that is fitted to the scene
MIN_FIT = 0.12  # of the same: a view that fills less moves closer
NEARBY = 2.0  # diagonals of the jellos within which a large collider counts
TURNS = np.radians([0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0])  # of the eye around the scene
ASPECT = 16.0 / 9.0  # width over height of the pictures that scene cameras are meant for


def widened(fov: float, aspect: float) -> float:
    """The vertical field of view [degrees] of a picture narrower than 16:9 that is as wide as one of `fov`."""
    slope = np.tan(np.radians(fov) / 2.0) * max(ASPECT / aspect, 1.0)
    return 2.0 * float(np.degrees(np.arctan(slope)))


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


@dataclass
class Viewpoint:
    """A perspective camera, y up. eye, target (3,) [m]; fov: vertical field of view [degrees]."""

    eye: np.ndarray
    target: np.ndarray
    fov: float = 40.0
    _start: tuple[np.ndarray, np.ndarray] = field(init=False, repr=False)
    _flown: tuple[np.ndarray, np.ndarray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.eye, self.target = np.array(self.eye, float), np.array(self.target, float)
        self._start = self._flown = (self.eye.copy(), self.target.copy())

    @classmethod
    def first(cls, scene: Scene, body: Body, aspect: float = ASPECT) -> "Viewpoint":
        """The scene's camera. If the scene sets none, and the default one misses jellos, rooms or the floor below
        jellos, or shows them too small, a view from the same side that fits them.

        A picture narrower than 16:9 shows the same width and more height. aspect: width over height."""
        camera, usual = scene.camera, Camera()
        eye, target = (smooth(camera.keyframe, name, getattr(camera, name), 0.0) for name in ("eye", "target"))
        view = cls(eye, target)
        view.fov = widened(float(smooth(camera.keyframe, "fov", camera.fov, 0.0)), aspect)
        if camera.keyframe or (camera.eye, camera.target) != (usual.eye, usual.target):
            return view
        corners = _corners(scene, body)
        middle, arm = 0.5 * (corners.min(0) + corners.max(0)), view.eye - view.target
        centred = cls(middle + arm, middle, view.fov)
        shows_all = view._retreat(corners, 1.0, aspect) <= 0.0 < centred._retreat(corners, MIN_FIT, aspect)
        if shows_all and view.clear_of(scene):
            return view
        outside = 2.0 * NEAR + 0.5 * float(np.linalg.norm(np.ptp(corners, axis=0)))
        fitted = []
        for turn in TURNS:  # the first from which nothing is seen through the ground
            side = cls(middle + arm, middle, view.fov)
            side.orbit(turn, 0.0)
            distance = max(outside, view.distance + side._retreat(corners, FIT, aspect))
            fitted.append(cls(middle + _unit(side.eye - middle) * distance, middle, view.fov))
            if fitted[-1].clear_of(scene):
                return fitted[-1]
        return fitted[0]

    def clear_of(self, scene: Scene) -> bool:
        """Whether the eye is outside all colliders but rooms, whose walls are not drawn."""
        solid = [collider for collider in scene.collider if not isinstance(collider, Room)]
        return all(float(each.distance((self.eye - each.place(0.0))[None])[0]) > 0.0 for each in solid)

    def _retreat(self, points: np.ndarray, fit: float, aspect: float) -> float:
        """How far [m] the eye must move back, until points (n, 3) fill at most `fit` of the picture's half sides."""
        right, up, back = self.axes() @ (points - self.eye).T
        slope = fit * np.tan(np.radians(self.fov) / 2.0)
        return float((back + np.maximum(np.abs(right) / aspect, np.abs(up)) / slope).max())

    def fly(self, camera: Camera, time: float, followed: np.ndarray, aspect: float) -> None:
        """Go where the scene's camera is at `time` [s], unless a person has moved the view since; from the first view,
        to which `reset` returns, it flies on. followed (n, 3): points [m] whose middle is the target, if there are any.
        """
        still = [all(map(np.array_equal, (self.eye, self.target), known)) for known in (self._start, self._flown)]
        if not any(still):
            return
        eye, target = (
            smooth(camera.keyframe, name, own, time) for name, own in zip(("eye", "target"), self._start, strict=True)
        )
        turn = 2.0 * np.pi * (camera.orbit * time % 1.0)
        x, y, z = eye - target
        eye = target + [x * np.cos(turn) + z * np.sin(turn), y, z * np.cos(turn) - x * np.sin(turn)]
        if np.isfinite(followed).all() and len(followed):
            target = followed.mean(0).astype(float)
        if np.linalg.norm(eye - target) < 2.0 * NEAR:
            eye = target + 2.0 * NEAR * self.axes()[2]
        self.eye, self.target = eye, target
        self.fov = widened(float(smooth(camera.keyframe, "fov", camera.fov, time)), aspect)
        self._flown = eye.copy(), target.copy()

    def reset(self) -> None:
        """Return to the first view."""
        self.eye, self.target = (part.copy() for part in self._start)

    @property
    def distance(self) -> float:
        """Between eye and target [m]."""
        return float(np.linalg.norm(self.eye - self.target))

    def axes(self) -> np.ndarray:
        """(3, 3): the unit vectors right, up and back towards the viewer, one per row."""
        back = _unit(self.eye - self.target)
        up = UP if abs(back[1]) < 0.99999 else np.array([0.0, 0.0, -1.0])
        right = _unit(np.cross(up, back))
        return np.stack([right, np.cross(back, right), back])

    def orbit(self, right: float, up: float) -> None:
        """Circle the target by these angles [rad], never over the poles."""
        arm = self.eye - self.target
        length, limit = np.linalg.norm(arm), np.arcsin(MAX_ELEVATION_SINE)
        elevation = float(np.clip(np.arcsin(np.clip(arm[1] / length, -1.0, 1.0)) + up, -limit, limit))
        azimuth, flat = np.arctan2(arm[0], arm[2]) + right, np.cos(elevation)
        arm = length * np.array([flat * np.sin(azimuth), np.sin(elevation), flat * np.cos(azimuth)])
        self.eye = self.target + arm

    def pan(self, right: float, up: float) -> None:
        """Move eye and target together in the picture plane [m]."""
        axes = self.axes()
        shift = right * axes[0] + up * axes[1]
        self.eye, self.target = self.eye + shift, self.target + shift

    def zoom(self, factor: float) -> None:
        """Multiply the distance to the target; it stays between 5 cm and 500 m or three times the first distance."""
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
        """(4, 4) camera space to clip space, for column vectors; depth runs from 1 at NEAR to 0 at FAR."""
        focal = 1.0 / np.tan(np.radians(self.fov) / 2.0)
        span = FAR - NEAR
        matrix = np.zeros((4, 4))
        matrix[0, 0], matrix[1, 1] = focal / aspect, focal
        matrix[2, 2:], matrix[3, 2] = (NEAR / span, FAR * NEAR / span), -1.0
        return matrix

    def to_pixels(self, size: tuple[int, int]) -> np.ndarray:
        """(3, 4): maps (x, y, z, 1) to (column·w, row·w, w) with the depth w [m]; (0, 0) is the upper left corner."""
        width, height = size
        clip = self.projection(width / height) @ self.view()
        column = 0.5 * width * (clip[3] + clip[0])
        row = 0.5 * height * (clip[3] - clip[1])
        return np.stack([column, row, clip[3]])

    def project(self, points: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """(n, 2) columns and rows [pixels] of points (n, 3) [m]; NaN behind the near plane."""
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
        """Pixels that one metre at a distance of one metre covers in a picture `height` pixels high."""
        return 0.5 * height / float(np.tan(np.radians(self.fov) / 2.0))


def _corners(scene: Scene, body: Body) -> np.ndarray:
    """(n, 3) [m]: corners of the box around all jellos, of that below it down to the highest floor, and of the finite
    colliders. Of a collider much larger than the jellos only what is near them counts, but of a room all."""
    low, high = body.x.min(0), body.x.max(0)
    floors = [level for collider in scene.collider if (level := collider.floor()) is not None and level < low[1]]
    boxes = [(np.array([low[0], max(floors, default=low[1]), low[2]]), high)]
    reach = NEARBY * float(np.linalg.norm(high - low))
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
