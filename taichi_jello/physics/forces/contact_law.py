"""The contact springs of each jello: numbers that the scene gives or, with "auto", from the jello's own springs.

The workshop says: "Initially, set the ordinary and collision parameters the same to create a stable simulation". With
"auto" the points that a jello stands on are together STIFFER times as stiff as it is as a bar, E A/H, with the damping
time of its springs: in a cube of 8³ points that is 1.5 springs for each point. With softer contact a ball sinks so deep
into a sheet that the sheet stops it as a whole; harder contact shortens the safe step and turns more of a bounce into
oscillations. No point gets more than a quarter of the stiffness of all springs around a particle, as it would in a thin
slab: that would shorten the step. E A/H does not depend on how many points there are: a cube of 24³ points bounces as
high as one of 8³ within 7 %. On the ground the bound Λ of that cube's springs grows by 5 %, that of one of 4³ by 13 %.
"""

import numpy as np
import taichi as ti

from taichi_jello.physics.state import Memory
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene

AUTO = "auto"
STIFFER = 1.5  # times as stiff as the jello
LARGEST_PART = 0.5  # of the stiffness of all springs over the particles: a quarter of what each has around it
LARGEST_SAG = 0.02  # of its least extent, by which a jello sinks in under its own weight
SIDES = 6  # of a solid; it lies on one of them
DEFAULT_EXTENT = 0.1  # m, of a jello of one point
WITHOUT_SPRINGS = 2000.0  # N/m for each kilogram, of particles that neither springs nor gravity give a scale
DAMPING_RATIO = 0.1  # of particles without springs


def standing_points(body: Body) -> np.ndarray:
    """(J,) how many particles of each jello carry it where it lies on the ground; of a skin, by their shares."""
    jellos = int(body.jello.max()) + 1
    solid = np.isin(np.arange(jellos), body.jello[body.cells[:, 0]])
    surface = np.bincount(body.jello[np.unique(body.surface)], minlength=jellos)
    touching = np.where(solid, surface / SIDES, np.bincount(body.jello, minlength=jellos))
    if len(body.skin_corners):
        skin = np.bincount(body.jello[body.skin_corners[:, 0]], shares(body), jellos) / SIDES
        touching = np.where(skin > 0.0, skin, touching)
    return np.maximum(touching, 1.0)


def least_extents(body: Body) -> np.ndarray:
    """(J,) [m] of the undeformed jellos: of solids along the shortest axis, of sheets and ropes between points."""
    extents = []
    solid = np.isin(np.arange(int(body.jello.max()) + 1), body.jello[body.cells[:, 0]])
    for j in range(len(solid)):
        extent = np.ptp(body.rest[body.jello == j], axis=0)
        spans = extent if solid[j] else body.rest_length[(body.jello[body.springs[:, 0]] == j) & (body.family == 0)]
        extents.append(float(spans[spans > 0.0].min(initial=np.inf)))
    return np.where(np.isfinite(extents), extents, DEFAULT_EXTENT)


def shares(body: Body) -> np.ndarray:
    """(V,) how much of a particle of the lattice's surface each point of the embedded skins stands for: its part of
    the skin's area (a third of the triangles around it) over a side of its cell. So the springs at all points near a
    particle are together about as stiff as one at the particle would be, however fine the skin is."""
    rest = body.skin_points(body.rest)
    a, b, c = (rest[body.skin[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
    area = np.bincount(body.skin.ravel(), np.repeat(area, 3), len(rest))
    corner = body.rest[body.skin_corners[:, [0, 4, 2, 1]]]
    return area / np.abs(np.linalg.det(corner[:, 1:] - corner[:, :1])) ** (2.0 / 3.0)


def contact_numbers(scene: Scene, body: Body) -> np.ndarray:
    """(J, 2) stiffness [N/m] and damping [N·s/m] of the contact of each jello, for every touching point."""
    contact, jellos = scene.contact, len(scene.jello)
    stiffness = np.full(jellos, contact.stiffness) if contact.stiffness != AUTO else _auto_stiffness(scene, body)
    if contact.damping != AUTO:
        return np.stack([stiffness, np.full(jellos, contact.damping)], 1)
    k, c = (as_a_bar(body, weight) for weight in (body.stiffness, body.damping))
    time = np.divide(c, k, out=np.zeros(jellos), where=k > 0.0)
    lightest = np.array([body.mass[body.jello == j].min() for j in range(jellos)])
    damping = np.where(k > 0.0, time * stiffness, DAMPING_RATIO * 2.0 * np.sqrt(stiffness * lightest))
    return np.stack([stiffness, damping], 1)


def as_a_bar(body: Body, weight: np.ndarray) -> np.ndarray:
    """(J,) E A/H of each jello, loaded along its least extent H, from the stiffness or damping (S,) of its springs.
    A lattice has E V = Σ k L²/6 (see material.py), and E A/H = E V/H²."""
    sums = np.bincount(body.jello[body.springs[:, 0]], weight * body.rest_length**2, int(body.jello.max()) + 1)
    return sums / (6.0 * least_extents(body) ** 2)


def _auto_stiffness(scene: Scene, body: Body) -> np.ndarray:
    """(J,) [N/m]: STIFFER than the jello, or what keeps it from sinking in too far under its weight."""
    mass, points = np.bincount(body.jello, body.mass), standing_points(body)
    weight = mass * max(np.linalg.norm(g) for g in (scene.gravity, *(row.gravity for row in scene.keyframe)))
    around = np.bincount(body.jello[body.springs[:, 0]], body.stiffness, len(mass)) / np.bincount(body.jello)
    own = np.minimum(STIFFER * as_a_bar(body, body.stiffness) / points, LARGEST_PART * around)
    found = np.maximum(own, weight / (LARGEST_SAG * least_extents(body) * points))
    return np.where(found > 0.0, found, WITHOUT_SPRINGS * mass / points)


@ti.data_oriented
class ContactLaw:
    """The coefficients of contact, live: stiffness [N/m], damping [N·s/m], friction and grip, the viscous part of
    friction [N·s/m], `grip_part` of √(k m). One row for all jellos where these are the same, else one for each."""

    def __init__(self, scene: Scene, body: Body, memory: Memory, title: str, grip_part: float = 1.0):
        self.numbers, self.friction, self.grip_part = contact_numbers(scene, body), scene.contact.friction, grip_part
        self.rubs, self._number = self.friction > 0.0, memory.number
        own = scene.contact.stiffness == AUTO
        jellos = range(len(scene.jello))
        self.mass = np.array([body.mass[body.jello == j].min() if own else body.mass.min() for j in jellos])
        rows = self._all_rows()
        self.alike = bool(np.all(rows == rows[0]))
        self.rows = memory.table(title, "coefficients", self._rows())
        if not self.alike:
            owner = np.pad(body.jello, (0, memory.padded - len(body)))
            self.owner = memory.table(title, "jello of each particle", owner.astype(np.int32))

    @property
    def stiffness(self) -> np.ndarray:
        """(J,) [N/m]."""
        return self.numbers[:, 0]

    @property
    def damping(self) -> np.ndarray:
        """(J,) [N·s/m]."""
        return self.numbers[:, 1]

    @property
    def grip(self) -> np.ndarray:
        """(J,) [N·s/m] The viscous part of friction, which may be as stiff as the contact spring is."""
        return self.grip_part * np.sqrt(self.stiffness * self.mass)

    @property
    def damping_time(self) -> float:
        """[s] The least ratio of damping and stiffness."""
        k, c = self.numbers.T
        return float(np.divide(c, k, out=np.full(len(k), np.inf), where=k > 0.0).min())

    def _all_rows(self) -> np.ndarray:
        return np.column_stack([self.numbers, np.full(len(self.numbers), self.friction), self.grip])

    def _rows(self) -> np.ndarray:
        return self._all_rows()[:1] if self.alike else self._all_rows()

    def tuning(self) -> dict[str, float]:
        """The numbers that may change: where jellos differ, their mean."""
        stiffness, damping = self.numbers.mean(0).tolist() if not self.alike else self.numbers[0].tolist()
        found = {"contact_stiffness": stiffness, "contact_damping": damping}
        return found | ({"friction": self.friction} if self.rubs else {})

    def tune(self, name: str, value: float) -> None:
        """Change one of `tuning`. Where jellos differ they stay as different as they are."""
        if name == "friction":
            self.friction = float(value)
        else:
            now, column = self.tuning()[name], int(name == "contact_damping")
            if self.alike or now == 0.0:
                self.numbers[:, column] = value
            elif value != now:
                self.numbers[:, column] *= value / now
        self.rows.from_numpy(self._rows().astype(self._number))

    @ti.func
    def of(self, i):
        """The coefficients of particle i."""
        jello = 0
        if ti.static(not self.alike):
            jello = self.owner[i]
        return self.rows[jello]

    @ti.func
    def between(self, a, b):
        """The coefficients between two jellos: those of the softer one."""
        jello = 0
        if ti.static(not self.alike):
            jello = ti.select(self.rows[a][0] <= self.rows[b][0], a, b)
        return self.rows[jello]
