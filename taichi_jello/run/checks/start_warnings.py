"""Warnings at the start of scenes that run, but probably not as intended (NumPy only)."""

import warnings

import numpy as np

from taichi_jello.physics.forces.collider_contact.surface_points import Faces, any_finite
from taichi_jello.physics.forces.contact_law import (
    LARGEST_SAG,
    as_a_bar,
    contact_numbers,
    least_extents,
    standing_points,
)
from taichi_jello.physics.forces.grab import Grab
from taichi_jello.physics.forces.soft_contact.surface.crossings import Surfaces, crossings
from taichi_jello.run.checks.loads import Piles, presses
from taichi_jello.run.placing import lift_out, outline
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Scene
from taichi_jello.scene.validation import SceneError
from taichi_jello.support.wording import counted

MAX_SINK = 0.1  # of its least extent: how deep a jello may sink into its support
ADVISED_SINK = 0.01  # the same with the suggested stiffness
HALF = 0.5  # of its least extent: what gets deeper into a jello may come out on the far side
MAX_LIFT = 3.0  # times the depth in a collider: up to this lift, the warning suggests raising the jello
MARGIN = 1.01  # factor on a suggested distance
MAX_STRAIN = 1e-3  # below this a spring counts as being at its rest length
MAX_GAIN = 2.0  # m/s that a jello may gain in the first frame, besides what gravity gives it


class SceneWarning(UserWarning):
    """A scene that can be simulated, but probably not as intended."""


def has_support(scene: Scene) -> bool:
    """Whether there is anything that a jello can lie on."""
    return scene.contact.stiffness != 0.0 and bool(scene.collider or (scene.contact.touch and len(scene.jello) > 1))


def on_contact(scene: Scene, body: Body) -> None:
    """Warn of jellos that overload their contact springs by weight, by a fall or by pressure between colliders."""
    if has_support(scene):
        for _, words in sorted(too_heavy(scene, body) + too_hard_pressed(scene, body)):
            warnings.warn(words, SceneWarning, stacklevel=3)


def too_heavy(scene: Scene, body: Body) -> list[tuple[int, str]]:
    """(jello, warning) for each free jello that sinks too deep into its contact springs, under its own weight plus the
    load on top, or at the end of its fall."""
    weight = float(np.linalg.norm(scene.gravity))
    if weight == 0.0:
        return []
    piles, points, least = Piles.of(scene, body), standing_points(body), least_extents(body)
    numbers, stiff = contact_numbers(scene, body)[:, 0], as_a_bar(body, body.stiffness)
    solid = np.isin(np.arange(len(least)), body.jello[body.cells[:, 0]])
    found = []
    for j, below in enumerate(piles.lies_on):
        both = [j, int(below)] if below >= 0 else [j]
        own, allowed = body.jello == j, least[both].min()
        mass = float(body.mass[own].sum() + piles.carried[j])
        k, carrying = float(numbers[both].min()), float(points[both].min())
        depth = mass * weight / (k * carrying)
        if body.pinned[own].any():
            continue
        pair = f" on jello.{below}" if below >= 0 else ""
        more = f", {piles.carried[j]:.3g} kg of them on top of it," if piles.carried[j] > 0.0 else ""
        if depth > MAX_SINK * allowed:
            words = f"{mass:.3g} kg{more} on contact springs of {k:g} N/m{' of both' * bool(pair)} sinks in by about"
            found.append((j, f"jello.{j}{pair}: {words} {depth:.2g} m; {advice(k * depth / (ADVISED_SINK * allowed))}"))
        elif solid[both].all() and np.isfinite(piles.fall[j]):
            # The energy of the fall goes into the contact springs and the jellos' springs, in series.
            speed = -float(body.v[own].mean(0) @ np.array(scene.gravity)) / -weight
            energy = mass * (weight * piles.fall[j] + 0.5 * max(speed, 0.0) ** 2)
            together = 1.0 / (1.0 / (k * carrying) + (1.0 / stiff[both]).sum())
            deep = float(np.sqrt(2.0 * energy * together)) / (k * carrying)
            if deep > HALF * allowed:
                words = f"falls {piles.fall[j]:.3g} m and sinks by about {deep:.2g} m into contact springs of {k:g} N/m"
                found.append((j, f"jello.{j}{pair} {words}; {advice(k * (2.0 * deep / (HALF * allowed)) ** 2)}"))
    return found


def too_hard_pressed(scene: Scene, body: Body) -> list[tuple[int, str]]:
    """(jello, warning) for each jello that is squeezed between colliders until they sink into it, because the squashed
    jello is stiffer than its contact springs."""
    least, points, stiff = least_extents(body), standing_points(body), as_a_bar(body, body.stiffness)
    found = []
    for press in presses(scene, body):
        j, k = press.jello, float(contact_numbers(scene, body)[press.jello, 0])
        squashed = stiff[j] * (least[j] / press.size) ** 2 * (press.size - press.gap)  # [N], E A/H across this side
        force = squashed / (1.0 + 2.0 * stiff[j] / (k * points[j]))
        if (depth := force / (k * points[j])) > MAX_SINK * least[j]:
            pair = " and ".join(f"collider.{c}" for c in press.colliders)
            words = f"jello.{j}: {pair} close to {press.gap:.3g} m around its {press.size:.3g} m and go into it by"
            words += f" about {depth:.2g} m each, on contact springs of {k:g} N/m"
            found.append((j, f"{words}; {advice(squashed / (MAX_SINK * least[j] * points[j]))}"))
    return found


def advice(stiffness: float) -> str:
    return f"contact.stiffness = {stiffness:.1g} would carry it"


def on_thin_colliders(scene: Scene, body: Body) -> None:
    """Warn of colliders so small that they may slip between the points of a jello."""
    if not any_finite(scene.collider) or scene.contact.stiffness == 0.0:
        return
    thickness = np.array([each.thickness for each in scene.collider])
    thinnest = int(thickness.argmin())
    least = np.maximum(Faces.bare(body).least_thickness(), Faces.skins(body).least_thickness())
    for j in np.flatnonzero(least > thickness[thinnest] * MARGIN):
        what = f"collider.{thinnest}, a {scene.collider[thinnest].type} {thickness[thinnest]:.3g} m thick"
        words = f"{what}, may pass between the points of jello.{j}: make it {least[j]:.2g} m thick, or give more points"
        warnings.warn(words, SceneWarning, stacklevel=3)


def on_colliders(scene: Scene, body: Body) -> None:
    """Warn of jellos that start inside a collider, and of colliders that may slip between a jello's points."""
    on_thin_colliders(scene, body)
    points, owner = outline(body)
    for j, c, depth in begun_inside(scene, body):
        collider = scene.collider[c]
        lift = lift_out([collider], points[owner == j])
        upwards = lift < MAX_LIFT * depth
        mend = f"raise position.y by {lift * MARGIN:.3g}" if upwards else f"move it {depth * MARGIN:.3g} m away"
        message = f"jello.{j} begins {depth:.3g} m deep in collider.{c}, a {collider.type}, and is thrown out: {mend}"
        warnings.warn(message, SceneWarning, stacklevel=3)


def begun_inside(scene: Scene, body: Body) -> list[tuple[int, int, float]]:
    """(jello, collider, depth [m]) for each free jello that starts deeper in a collider than it would rest on it."""
    if not scene.collider or scene.contact.stiffness == 0.0:
        return []
    points, owner = outline(body)
    allowed = LARGEST_SAG * least_extents(body)
    allowed[body.jello[body.pinned]] = np.inf  # it may be held there
    found = []
    for c, collider in enumerate(scene.collider):
        depth = np.zeros(len(allowed))
        np.maximum.at(depth, owner, -collider.distance(points - collider.place(0.0)))
        found += [(int(j), c, float(depth[j])) for j in np.flatnonzero(depth > allowed)]
    return sorted(found)


def on_crossings(scene: Scene, body: Body) -> None:
    """Raise SceneError if a sheet or rope initially intersects another jello; warn if only solids do."""
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
        where = f"at {np.round(place, 3).tolist()}{more}"
        message = f"jello.{b} begins partly in jello.{a}, {where}: contact pushes them apart"
        warnings.warn(message, SceneWarning, stacklevel=3)


def on_start(scene: Scene, body: Body, v: np.ndarray) -> None:
    """Warn of jellos that contact flings away at the start, judged by the velocities (N, 3) [m/s] after the first
    frame, unless another motion or force could have accelerated them."""
    frame = scene.solver.frame_dt
    moving = any(np.any(collider.moved_rows(0.0, frame)[:, 3:6]) for collider in scene.collider)
    if moving or scene.keyframe or any(not isinstance(f, Grab) for f in scene.force) or not has_support(scene):
        return
    # A jello at rest, with springs at their rest lengths and no keyframes, can gain speed only from contact and
    # gravity.
    length = np.linalg.norm(body.x[body.springs[:, 1]] - body.x[body.springs[:, 0]], axis=1)
    strained = body.jello[body.springs[:, 0]][np.abs(length - body.rest_length) > MAX_STRAIN * body.rest_length]
    changed = [bool(jello.keyframe) or any(pin.keyframe for pin in jello.pin) for jello in scene.jello]
    at_rest = ~np.isin(np.arange(len(scene.jello)), strained) & ~np.array(changed)
    before, after = speeds(body, body.v, at_rest), speeds(body, v, at_rest)
    # 2 max(before): the most speed that the fastest jello can pass on to a light one.
    gained = MAX_GAIN + 2.0 * frame * float(np.linalg.norm(scene.gravity)) + 2.0 * float(before.max())
    held = np.isin(np.arange(len(at_rest)), body.jello[body.pinned])
    known = [j for j, _, _ in begun_inside(scene, body)]
    for j in np.setdiff1d(np.flatnonzero((after - before > gained) & (at_rest | ~held)), known):
        warnings.warn(
            f"jello.{j} reaches {after[j]:.2g} m/s within the first frame: what begins inside the "
            "ground or another jello, or closer to a sheet or rope than its thickness, is thrown out",
            SceneWarning,
            stacklevel=4,
        )


def speeds(body: Body, v: np.ndarray, rms: np.ndarray) -> np.ndarray:
    """A speed (J,) [m/s] for each jello from the particle velocities v (N, 3): where `rms` (J,) is true the
    mass-weighted rms speed of its particles, else the speed of its centre of mass."""
    mass = np.bincount(body.jello, body.mass)
    centre = np.linalg.norm([np.bincount(body.jello, body.mass * v[:, axis]) / mass for axis in range(3)], axis=0)
    return np.where(rms, np.sqrt(np.bincount(body.jello, body.mass * (v * v).sum(1)) / mass), centre)
