"""What a person should be told of a scene that runs, but hardly as it is meant (NumPy only)."""

import warnings

import numpy as np

from taichi_jello.physics.forces.contact_law import contact_numbers, least_extents, standing_points
from taichi_jello.physics.forces.grab import Grab
from taichi_jello.physics.forces.soft_contact.surface.crossings import Surfaces, crossings
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.scene.validation import SceneError
from taichi_jello.support.wording import counted

SUNK = 0.1  # of its least extent, by which a jello may sink into what it lies on
FIRM = 0.01  # of the same, with the stiffness that is advised
STRAINED = 1e-3  # of its rest length, by which a spring may be off in what begins undeformed
LEAP = 2.0  # m/s that a jello may gain in its first frame beyond what gravity gives it


class SceneWarning(UserWarning):
    """A scene that can be simulated, but hardly as it is meant."""


def carries(scene: Scene) -> bool:
    """Whether there is anything that a jello can lie on."""
    return scene.contact.stiffness != 0.0 and bool(scene.collider or (scene.contact.touch and len(scene.jello) > 1))


def on_contact(scene: Scene, body: Body) -> None:
    """Warn of jellos too heavy for the contact springs that are to carry them."""
    if not carries(scene):
        return
    weight, touching, least = float(np.linalg.norm(scene.gravity)), standing_points(body), least_extents(body)
    for j, (stiffness, _) in enumerate(contact_numbers(scene, body)):
        own = body.jello == j
        mass = float(body.mass[own].sum())
        depth = mass * weight / (stiffness * float(touching[j]))
        if depth > SUNK * least[j] and not body.pinned[own].any():
            enough = stiffness * depth / (FIRM * least[j])
            warnings.warn(
                f"jello.{j}: {mass:.3g} kg on contact springs of {stiffness:g} N/m sinks in by about {depth:.2g} m; "
                f"contact.stiffness = {enough:.1g} would carry it",
                SceneWarning,
                stacklevel=3,
            )


def on_crossings(scene: Scene, body: Body) -> None:
    """Raise SceneError if a sheet or a rope begins through another jello that it touches; warn of solids that do."""
    if not scene.contact.touch or scene.contact.stiffness == 0.0 or len(scene.jello) < 2:
        return
    surfaces = Surfaces.of(body)
    found = list(crossings(surfaces))
    for a, b, place in found:
        if not (surfaces.solid[a] and surfaces.solid[b]):
            thin, other = (a, b) if surfaces.solid[b] else (b, a)
            raise SceneError(
                f"jello.{thin}",
                f"expected a start apart from jello.{other}, got one through it at {np.round(place, 3).tolist()}: "
                "a sheet or a rope cannot come apart from what it crosses",
            )
    if found:
        a, b, place = found[0]
        more = f" (and {counted(len(found) - 1, 'more pair')})" if len(found) > 1 else ""
        warnings.warn(
            f"jello.{b} begins partly in jello.{a}, at {np.round(place, 3).tolist()}{more}: contact pushes them apart",
            SceneWarning,
            stacklevel=3,
        )


def on_start(scene: Scene, body: Body, v: np.ndarray) -> None:
    """Warn of jellos that contact throws out of where they begin, by their velocities (N, 3) [m/s] after the first
    frame; not where something else moves that could have set them going."""
    frame = scene.solver.frame_dt
    moving = any(np.any(collider.moved_rows(0.0, frame)[:, 3:6]) for collider in scene.collider)
    if moving or scene.keyframe or any(not isinstance(force, Grab) for force in scene.force) or not carries(scene):
        return
    gained = LEAP + 2.0 * frame * float(np.linalg.norm(scene.gravity))
    mass, still = np.bincount(body.jello, body.mass), undeformed(scene, body)
    before, after = (np.where(still, mean_speed(body, u, mass), speed(body, u, mass)) for u in (body.v, v))
    gained += 2.0 * float(before.max())  # what the fastest one can give to a light one
    held = np.isin(np.arange(len(mass)), body.jello[body.pinned])
    for j in np.flatnonzero((after - before > gained) & (still | ~held)):
        warnings.warn(
            f"jello.{j} comes to {after[j]:.2g} m/s within the first frame: what begins inside the "
            "ground or another jello, or nearer to a sheet or rope than these are thick, is thrown out",
            SceneWarning,
            stacklevel=4,
        )


def mean_speed(body: Body, v: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """(J,) [m/s] what the particles (N, 3) of each jello of `mass` (J,) have in the mean, by their energy."""
    return np.sqrt(np.bincount(body.jello, body.mass * (v * v).sum(1)) / mass)


def speed(body: Body, v: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """(J,) [m/s] of each jello of `mass` (J,) as a whole."""
    return np.linalg.norm([np.bincount(body.jello, body.mass * v[:, axis]) / mass for axis in range(3)], axis=0)


def undeformed(scene: Scene, body: Body) -> np.ndarray:
    """(J,) bool: which jellos nothing but contact and gravity can set going in the first frame: whose springs have
    their rest lengths, and which no keyframes change or move."""
    length = np.linalg.norm(body.x[body.springs[:, 1]] - body.x[body.springs[:, 0]], axis=1)
    strained = body.jello[body.springs[:, 0]][np.abs(length - body.rest_length) > STRAINED * body.rest_length]
    changed = [bool(jello.keyframe) or any(pin.keyframe for pin in jello.pin) for jello in scene.jello]
    return ~np.isin(np.arange(len(scene.jello)), strained) & ~np.array(changed)
