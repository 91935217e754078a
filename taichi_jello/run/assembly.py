"""From the jellos of a scene to its one Body: each jello's shape, then its material, regions and place."""

from dataclasses import replace

import numpy as np

from taichi_jello.physics.colliders.room import Room
from taichi_jello.run.placing import placed
from taichi_jello.scene.body import Body, join
from taichi_jello.scene.description import Jello, Scene
from taichi_jello.scene.keyframes import offset
from taichi_jello.scene.material import material
from taichi_jello.scene.region import places, with_regions
from taichi_jello.scene.validation import SceneError, shown


def built(jello: Jello) -> Body:
    """The Body of one jello, with its material and regions."""
    body = jello.body()
    if not isinstance(body, Body):
        raise SceneError("", f"expected {type(jello).__name__}.body() to return a Body, got {shown(body)}")
    for name in ("x", "v"):
        if (given := getattr(jello, name)) is not None:
            if len(given) != len(body):
                raise SceneError(name, f"expected {len(body)} points, got {len(given)}")
            body = replace(body, **{name: np.array(given)})
    for index, pin in enumerate(jello.pin):
        held = pin.holds(places(body.rest, body.rest))
        if not held.any():
            raise SceneError(
                f"pin.{index}", "expected a box in the body, 0 to 1 along each axis, that holds points; none lies in it"
            )
        if pin.keyframe:  # start at the beginning of the path
            body = replace(body, x=body.x + held[:, None] * offset(pin.keyframe, 0.0))
    if jello.volume > 0.0 and not len(body.cells):
        raise SceneError("volume", f"expected 0 for a {jello.shape}: it has no cells, got {jello.volume:g}")
    body = replace(body, **material(jello, body))
    return replace(body, **with_regions(body, tuple(jello.region))) if jello.region else body


def assembled(scene: Scene) -> Body:
    """All jellos of the scene as one body. Raises SceneError naming the jello that cannot be built, or a room that does
    not contain every jello at the start: its walls would throw it."""
    bodies = []
    for index, jello in enumerate(scene.jello):
        try:
            bodies.append(built(jello))
        except SceneError as error:
            raise error.within(f"jello.{index}") from None
    body = join(placed(scene, bodies))
    for c, room in [(c, room) for c, room in enumerate(scene.collider) if isinstance(room, Room)]:
        for j in range(len(scene.jello)):
            low, high = (corner - offset(room.keyframe, 0.0) for corner in body.extent(j))
            if np.any(low < np.array(room.min) - 1e-9) or np.any(high > np.array(room.max) + 1e-9):
                raise SceneError(
                    f"collider.{c}",
                    f"expected a box around jello.{j}, which spans {np.round(low, 3).tolist()} to "
                    f"{np.round(high, 3).tolist()}, got {list(room.min)} to {list(room.max)}",
                )
    return body
