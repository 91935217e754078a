"""Warnings while a scene runs: cells that stay inverted, and objects deep inside a jello (NumPy only)."""

import warnings
from collections.abc import Iterator

import numpy as np

from taichi_jello.physics.forces.contact_law import least_extents
from taichi_jello.physics.forces.springs.tearing import still_there
from taichi_jello.physics.forces.volume import SIGNS, edges
from taichi_jello.run.checks.start_warnings import HALF, SceneWarning
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Collider, Scene
from taichi_jello.support.wording import counted

INTERVAL = 0.2  # s between two checks
PATIENCE = 0.5  # s that cells may stay inverted without a warning
MANY = 64  # roughly, the number of points of a collider that are tested
Key = tuple[str, int, int]  # the kind of warning, and the pair or the jello
Found = tuple[Key, str]  # with the warning's text


class Watch:
    """Checks a scene a few times per simulated second. It warns once about each jello with inverted cells, and about
    each pair in which one object is deeper than half the thickness of the other."""

    def __init__(self, scene: Scene, body: Body):
        self.scene, self.body, self.reported = scene, body, set[Key]()
        volume = np.array([jello.volume for jello in scene.jello])
        self.cells = body.cells[volume[body.jello[body.cells[:, 0]]] == 0.0]
        self.least, owner = least_extents(body), body.jello[body.cells[:, 0]]
        self.cells_of = {int(j): body.cells[owner == j] for j in np.unique(owner)}
        self.points_of = {j: np.flatnonzero((body.jello == j) & body.inside) for j in self.cells_of}
        self.surface_of = {j: body.surface[body.jello[body.surface[:, 0]] == j] for j in self.cells_of}
        self.touches = scene.contact.stiffness != 0.0
        self.turned = np.zeros(len(self.cells))  # s for which each cell has been seen inverted
        self.last = 0.0
        if self.touches:
            self.reported |= {key for key, _ in self._passed(0.0, body.x)}  # it may be meant to be there

    def due(self, time: float) -> bool:
        """Whether a check is due. After a jump back in time the interval starts again."""
        if time < self.last:
            self.last, self.turned = time, np.zeros(len(self.cells))
        return time - self.last >= INTERVAL * (1.0 - 1e-9)

    def look(self, time: float, x: np.ndarray, whole: np.ndarray | None) -> None:
        """Check the state at `time` [s], with particles at x (N, 3) [m]. whole (S,): the springs not torn; None:
        all."""
        found = list(self._inside_out(time - self.last, x, whole))
        self.last = time
        if self.touches:
            found += self._passed(time, x)
        for key, words in found:
            if key not in self.reported:
                self.reported.add(key)
                warnings.warn(words, SceneWarning, stacklevel=4)

    def _inside_out(self, passed: float, x: np.ndarray, whole: np.ndarray | None) -> Iterator[Found]:
        bad = turned_over(x, self.cells)
        if whole is not None and bad.any():
            bad &= still_there(self.body, whole, self.cells, np.zeros((0, 3), int))
        self.turned = np.where(bad, self.turned + passed, 0.0)
        left = self.body.jello[self.cells[self.turned > PATIENCE * (1.0 - 1e-9), 0]]
        for j, count in zip(*np.unique(left, return_counts=True), strict=True):
            cells = f"{counted(int(count), 'cell')} inside out for {PATIENCE:g} s"
            yield ("inside out", int(j), 0), f"jello.{j} has been left with {cells}; volume = 1 brings them back"

    def _passed(self, time: float, x: np.ndarray) -> Iterator[Found]:
        for j, own in self.points_of.items():
            here = x[own]
            box = here.min(0), here.max(0)
            depth = np.array([-c.distance(here - c.place(time)).min() for c in self.scene.collider])
            deep = [int(depth.argmax())] if np.maximum(depth, 0.0).sum() > HALF * self.least[j] else []
            deep += [c for c in range(len(depth)) if self._holds(j, c, time, x, box)]
            for c in deep:
                who = f"collider.{c}, a {self.scene.collider[c].type},"
                yield ("collider", j, c), message(time, who, j)
            for k in self.points_of if self.scene.contact.touch else ():
                if k != j and self._holds_middle(j, k, x, box):
                    yield ("jello", min(j, k), max(j, k)), message(time, f"jello.{k}", j)

    def _holds(self, j: int, c: int, time: float, x: np.ndarray, box: tuple[np.ndarray, np.ndarray]) -> bool:
        """Whether a point of a finite collider is more than halfway from the surface of jello j to its middle."""
        collider = self.scene.collider[c]
        if not np.isfinite(collider.thickness):
            return False
        points = some_of(collider) + collider.place(time)
        points = points[np.all((points > box[0]) & (points < box[1]), axis=1)]
        points = points[in_cells(points, x, self.cells_of[j])]
        corners = x[self.surface_of[j]]
        surface = np.concatenate([corners[:, 0], corners.mean(1)])
        away = np.linalg.norm(points[:, None] - surface, axis=2).min(1, initial=np.inf)
        return bool(np.any(away > 0.5 * HALF * self.least[j]))

    def _holds_middle(self, j: int, k: int, x: np.ndarray, box: tuple[np.ndarray, np.ndarray]) -> bool:
        """Whether the middle of jello k lies inside both k and j."""
        middle = x[self.points_of[k]].mean(0)
        if np.any(middle <= box[0]) or np.any(middle >= box[1]):
            return False
        return all(in_cells(middle[None], x, self.cells_of[one])[0] for one in (j, k))


def message(time: float, who: str, jello: int) -> str:
    return f"at {time:.3g} s {who} is more than halfway in jello.{jello}: a larger contact.stiffness holds more"


def turned_over(x: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(C,) bool: which cells have a negative volume. The signs of `volumes`, in less than half of its time."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (SIGNS.T.astype(x.dtype) @ x[cells]).transpose(1, 2, 0)
    negative: np.ndarray = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx) < 0.0
    return negative


def some_of(collider: Collider) -> np.ndarray:
    """(n, 3) [m]: the centre of a collider and some points of its surface, relative to its origin."""
    points = collider.mesh(1.0)[0]
    return np.concatenate([np.zeros((1, 3)), points[:: max(1, len(points) // MANY)]])


def in_cells(points: np.ndarray, x: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """(n,) bool: which points (n, 3) lie in any of the cells (C, 8), each approximated by the parallelepiped of its
    mean edges."""
    if not len(points):
        return np.zeros(0, bool)
    sides = edges(x, cells).transpose(1, 2, 0)  # (C, 3, 3), each edge a column
    flat = np.abs(np.linalg.det(sides)) < 1e-30
    inverse = np.linalg.inv(np.where(flat[:, None, None], 1e30 * np.eye(3), sides))
    place = np.einsum("cij,ncj->nci", inverse, points[:, None] - x[cells].mean(1))
    return np.any((np.abs(place) <= 0.5).all(2) & ~flat, axis=1)
