"""The same physics in NumPy float64, independent of the Taichi kernels, solved by SciPy to 12 digits."""

from typing import Any

import numpy as np

from taichi_jello.physics.colliders import plane, sphere
from taichi_jello.physics.forces.contact_law import contact_numbers
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene

TOLERANCE = 1e-12
KNOWN = {"springs", "gravity", "drag", "contact", "uniform field"}  # titles of forces


def incidence(body: Body) -> Any:
    """(S, N) sparse incidence matrix: a spring's row has 1 at its first end and -1 at its second."""
    from scipy.sparse import csr_array

    springs, ones = np.arange(len(body.springs)), np.ones(len(body.springs))
    ends = (np.concatenate([springs, springs]), body.springs.T.ravel())
    return csr_array((np.concatenate([ones, -ones]), ends), (len(springs), len(body)))


def spring_forces(body: Body, x: np.ndarray, v: np.ndarray, matrix: Any = None) -> np.ndarray:
    """(N, 3) Hooke and dashpot forces [N] (workshop Eq. 3 and 4). matrix: the incidence of body, if known."""
    matrix = incidence(body) if matrix is None else matrix
    i, j = body.springs.T
    d, w = (np.take(a, i, 0) - np.take(a, j, 0) for a in (x, v))
    squared = np.einsum("sa,sa->s", d, d)
    pull = body.stiffness * (1.0 - body.rest_length / np.sqrt(squared))
    pull += body.damping * np.einsum("sa,sa->s", d, w) / squared
    return -(matrix.T @ (pull[:, None] * d))


def elastic_energy(body: Body, x: np.ndarray) -> float:
    i, j = body.springs.T
    stretch = np.linalg.norm(x[i] - x[j], axis=1) - body.rest_length
    return float(0.5 * np.sum(body.stiffness * stretch**2))


def surface_contact(row: np.ndarray, is_sphere: bool, x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Outward normals (N, 3) and signed distances (N,) [m] of the points x at one surface of Collider.rows."""
    p = x - (row[:3] + t * row[3:6])
    if not is_sphere:
        return np.broadcast_to(row[6:9], p.shape), p @ row[6:9]
    length = np.linalg.norm(p, axis=1)
    return p / length[:, None], length - row[9]


def contact_forces(
    parameters: np.ndarray, surfaces: list[tuple[np.ndarray, bool]], x: np.ndarray, v: np.ndarray, t: float
) -> np.ndarray:
    """(N, 3) penalty spring and dashpot [N] at all surfaces (workshop, "Collisions").

    parameters (2, N, 1): stiffness and damping of each particle."""
    total = np.zeros_like(x)
    for row, is_sphere in surfaces:
        n, distance = surface_contact(row, is_sphere, x, t)
        (hit,) = np.nonzero(distance < 0.0)
        if not len(hit):
            continue
        n, relative = n[hit], v[hit] - row[3:6]
        stiffness, damping = parameters[:, hit]
        speed = np.sum(relative * n, axis=1, keepdims=True)
        normal_force = np.maximum(0.0, -stiffness * distance[hit, None] - damping * speed)
        total[hit] += normal_force * n
    return total


class Reference:
    """The equation of motion of a scene with the forces in KNOWN and planes, boxes and spheres as colliders. Raises
    ImportError without SciPy."""

    def __init__(self, scene: Scene, body: Body):
        self.scene, self.body = scene, body
        self.inverse_mass = np.where(body.pinned, 0.0, 1.0 / body.mass)[:, None]
        stiffness, damping = contact_numbers(scene, body)[body.jello].T
        self.contact = np.stack([stiffness, damping])[..., None]
        self.incidence = incidence(body)
        self.constant = body.mass[:, None] * np.array(scene.gravity)
        self.constant = self.constant + sum(
            (np.array(f.force) for f in scene.force if hasattr(f, "force")), np.zeros(3)
        )
        self.surfaces: list[tuple[np.ndarray, bool]] = []

    @staticmethod
    def knows(scene: Scene, titles: list[str]) -> bool:
        """Whether this module implements all forces, given by their titles, and all colliders of the scene. Friction it
        does not: what holds a point depends on where it has been."""
        if scene.collider and scene.contact.friction > 0.0:
            return False
        shapes = {plane.signed_distance, sphere.signed_distance}
        return set(titles) <= KNOWN and all(c.signed_distance in shapes for c in scene.collider)  # type: ignore[attr-defined]

    def begin_frame(self, start: float, end: float) -> None:
        """Colliders move in straight lines from `start` to `end` [s]."""
        self.surfaces = [
            (row, collider.signed_distance is sphere.signed_distance)  # type: ignore[attr-defined]
            for collider in self.scene.collider
            for row in collider.rows(start, end)
        ]

    def acceleration(self, t: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(N, 3) [m/s²] at `t` seconds after the start of the frame."""
        drag = self.scene.drag * self.body.mass[:, None] * v
        force = spring_forces(self.body, x, v, self.incidence) + self.constant - drag
        if self.surfaces and self.scene.contact.stiffness != 0.0:
            force += contact_forces(self.contact, self.surfaces, x, v, t)
        return force * self.inverse_mass

    def solve(self, x: np.ndarray, v: np.ndarray, seconds: float, frame_dt: float) -> tuple[np.ndarray, np.ndarray]:
        """x and v after `seconds` by DOP853 at a relative tolerance of 1e-12, frame by frame. Raises ArithmeticError
        if DOP853 fails."""
        from scipy.integrate import solve_ivp

        y = np.stack([x, v])

        def slope(t: float, y: np.ndarray) -> np.ndarray:
            x, v = y.reshape(2, -1, 3)
            return np.stack([v, self.acceleration(t, x, v)]).ravel()

        for k in range(max(1, round(seconds / frame_dt))):
            self.begin_frame(k * frame_dt, (k + 1) * frame_dt)
            span = (0.0, min(frame_dt, seconds - k * frame_dt))
            done: Any = solve_ivp(slope, span, y.ravel(), method="DOP853", rtol=TOLERANCE, atol=0.1 * TOLERANCE)
            if not done.success:
                raise ArithmeticError(f"DOP853 gave up: {done.message}")
            y = done.y[:, -1].reshape(y.shape)
        return y[0], y[1]


def twisted(x: np.ndarray, degrees: float = 36.0, stretch: float = 0.1) -> np.ndarray:
    """Points (N, 3) twisted about the vertical axis [degrees per metre] and stretched along it [fraction]."""
    angle = np.radians(degrees) * x[:, 1]
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x[:, 0] + s * x[:, 2], (1.0 + stretch) * x[:, 1], c * x[:, 2] - s * x[:, 0]], 1)
