"""How a scene looks: its camera, its ground and its background."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from taichi_jello.scene.colors import Color, color, color_or_none
from taichi_jello.scene.keyframes import CameraKeyframe
from taichi_jello.scene.validation import (
    Checked,
    SceneError,
    Vector,
    field_of_view,
    number,
    number_or_auto,
    truth,
    vector,
    whole,
    word,
)

SHOWS = ("skin and springs", "all springs", "skin", "particles")
COLORS = ("force", "strain", "stiffness", "family", "plain")
PATTERNS = ("checker", "plain")


@dataclass(frozen=True, kw_only=True)
class Camera(Checked):
    """The camera's position `eye` and the point it looks at [m]; fov: the vertical field of view [degrees] of a 16:9
    picture (narrower pictures keep its width). show: what is drawn of the jellos; color: what the springs' color shows.
    scale: the value at the top of the colour scale, in the legend's unit, N, % or N/m; "auto": estimated from the
    scene's weights and speeds, and raised if loads exceed it. keyframe: eye, target and fov over time. follow: the
    number of a jello whose middle the camera looks at instead of the target. orbit: turns per second of the eye around
    the target, to the right if positive."""

    eye: Vector = (2.6, 1.9, 3.6)
    target: Vector = (0.0, 0.6, 0.0)
    fov: float = 40.0
    color: str = "force"
    show: str = SHOWS[0]
    scale: float | str = "auto"
    follow: int | None = None
    orbit: float = 0.0
    keyframe: Sequence[CameraKeyframe] = ()
    parts: ClassVar[dict[str, type[Checked]]] = {"keyframe": CameraKeyframe}

    def check(self) -> dict[str, Any]:
        eye, target = vector("eye", self.eye), vector("target", self.target)
        if eye == target:
            raise SceneError("eye", "expected a point away from the target")
        return {
            "eye": eye,
            "target": target,
            "fov": field_of_view(self.fov),
            "color": word("color", self.color, COLORS),
            "show": word("show", self.show, SHOWS),
            "scale": number_or_auto("scale", self.scale, above=0.0),
            "follow": None if self.follow is None else whole("follow", self.follow, low=0),
            "orbit": number("orbit", self.orbit),
        }

    @property
    def moves(self) -> bool:
        return bool(self.keyframe) or self.follow is not None or self.orbit != 0.0


@dataclass(frozen=True, kw_only=True)
class Ground(Checked):
    """How the level floor is drawn. color: by default its collider's color, else grey; pattern: "checker" or "plain";
    show: whether the floor and the shadows on it are drawn."""

    color: Color | None = None
    pattern: str = PATTERNS[0]
    show: bool = True

    def check(self) -> dict[str, Any]:
        return {
            "color": color_or_none("color", self.color),
            "pattern": word("pattern", self.pattern, PATTERNS),
            "show": truth("show", self.show),
        }


@dataclass(frozen=True, kw_only=True)
class Background(Checked):
    """The sky: its color at the `top`, and at the `bottom`, the horizon, where the floor fades into it."""

    top: Color = (0.515, 0.575, 0.65)
    bottom: Color = (0.71, 0.737, 0.775)

    def check(self) -> dict[str, Any]:
        return {"top": color("top", self.top), "bottom": color("bottom", self.bottom)}
