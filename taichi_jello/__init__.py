"""taichi_jello: real-time mass-spring jello. Importing it opens no window and starts no Taichi runtime."""

import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
__version__ = "0.1.0"

from taichi_jello.support import interrupt

with interrupt.importing():
    from taichi_jello import scenefiles as scenefiles
    from taichi_jello.physics.colliders.block import Block as Block
    from taichi_jello.physics.colliders.plane import Plane as Plane
    from taichi_jello.physics.colliders.room import Room as Room
    from taichi_jello.physics.colliders.sphere import Sphere as Sphere
    from taichi_jello.physics.forces.field import CallableField as CallableField
    from taichi_jello.physics.forces.field import GridField as GridField
    from taichi_jello.physics.forces.field import UniformField as UniformField
    from taichi_jello.physics.forces.grab import Grab as Grab
    from taichi_jello.physics.forces.wind import Wind as Wind
    from taichi_jello.run.checks.start_warnings import SceneWarning as SceneWarning
    from taichi_jello.run.clock import StepWarning as StepWarning
    from taichi_jello.run.diverged import Diverged as Diverged
    from taichi_jello.run.simulation import Simulation as Simulation
    from taichi_jello.run.snapshot import Snapshot as Snapshot
    from taichi_jello.scene.description import Contact as Contact
    from taichi_jello.scene.description import Pin as Pin
    from taichi_jello.scene.description import Scene as Scene
    from taichi_jello.scene.description import SceneError as SceneError
    from taichi_jello.scene.description import Solver as Solver
    from taichi_jello.scene.keyframes import CameraKeyframe as CameraKeyframe
    from taichi_jello.scene.keyframes import GravityKeyframe as GravityKeyframe
    from taichi_jello.scene.keyframes import Keyframe as Keyframe
    from taichi_jello.scene.keyframes import Move as Move
    from taichi_jello.scene.look import Background as Background
    from taichi_jello.scene.look import Camera as Camera
    from taichi_jello.scene.look import Ground as Ground
    from taichi_jello.scene.region import Region as Region
    from taichi_jello.shapes.ball import Ball as Ball
    from taichi_jello.shapes.lattice import Box as Box
    from taichi_jello.shapes.mesh import Mesh as Mesh
    from taichi_jello.shapes.ring import Ring as Ring
    from taichi_jello.shapes.rope import Rope as Rope
    from taichi_jello.shapes.sheet import Sheet as Sheet
    from taichi_jello.support import runtime as runtime
    from taichi_jello.support.runtime import RuntimeProblem as RuntimeProblem

sceneio = scenefiles
