"""taichi_jello: real-time mass-spring jello. Importing it opens no window and starts no Taichi runtime."""

import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
__version__ = "0.1.0"

from taichi_jello.support import interrupt

with interrupt.importing():
    from taichi_jello import scenefiles as sceneio
    from taichi_jello.physics.colliders.block import Block
    from taichi_jello.physics.colliders.plane import Plane
    from taichi_jello.physics.colliders.room import Room
    from taichi_jello.physics.colliders.sphere import Sphere
    from taichi_jello.physics.forces.field import CallableField, GridField, UniformField
    from taichi_jello.physics.forces.grab import Grab
    from taichi_jello.physics.forces.wind import Wind
    from taichi_jello.run.clock import StepWarning
    from taichi_jello.run.diverged import Diverged
    from taichi_jello.run.simulation import Simulation
    from taichi_jello.run.snapshot import Snapshot
    from taichi_jello.run.start_warnings import SceneWarning
    from taichi_jello.scene.description import Camera, Contact, Pin, Scene, SceneError, Solver
    from taichi_jello.scene.keyframes import GravityKeyframe, Keyframe, Move
    from taichi_jello.scene.region import Region
    from taichi_jello.shapes.ball import Ball
    from taichi_jello.shapes.lattice import Box
    from taichi_jello.shapes.mesh import Mesh
    from taichi_jello.shapes.ring import Ring
    from taichi_jello.shapes.rope import Rope
    from taichi_jello.shapes.sheet import Sheet
    from taichi_jello.support import runtime
    from taichi_jello.support.runtime import RuntimeProblem

__all__ = [
    "Ball",
    "Block",
    "Box",
    "CallableField",
    "Camera",
    "Contact",
    "Diverged",
    "Grab",
    "GravityKeyframe",
    "GridField",
    "Keyframe",
    "Mesh",
    "Move",
    "Pin",
    "Plane",
    "Region",
    "Ring",
    "Room",
    "Rope",
    "RuntimeProblem",
    "Scene",
    "SceneError",
    "SceneWarning",
    "Sheet",
    "Simulation",
    "Snapshot",
    "Solver",
    "Sphere",
    "StepWarning",
    "UniformField",
    "Wind",
    "runtime",
    "sceneio",
]
