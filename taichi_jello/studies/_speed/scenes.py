"""The speed of whole scenes: cubes that hit the ground, many jellos in contact, a fine skin, and a mesh voxelised."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taichi_jello.physics.colliders.plane import Plane
from taichi_jello.run.simulation import Simulation
from taichi_jello.scene.body import join
from taichi_jello.scene.description import Scene
from taichi_jello.scenefiles import load
from taichi_jello.shapes._skin import split_edges
from taichi_jello.shapes._voxels import voxelised
from taichi_jello.shapes.ball import Ball, sphere
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies._report import seconds_of, timed
from taichi_jello.support import runtime
from taichi_jello.view.drawing.embedded import Embedded

SECTION = 0.5  # s of simulated time; the slowest section is reported
STIFF = tuple((n, k, 0.25) for n in (8, 16) for k in (1e5, 1e7))  # points a side; N/m of 8³ points; N·s/m
VISIBLE = tuple((n, 5.67, 0.0) for n in (8, 16, 32, 48))  # the same of cubes that swing at 4 Hz
SKIN_EDGE = 0.04  # of the triangles on a ball of radius 1, which gives some 18 000 points
CELLS = 16  # across the ball
MESH_EDGE, VOXELS = 0.034, 48  # edges of the mesh to be voxelised, some 80 000 triangles, and voxels across it


@dataclass(frozen=True, kw_only=True)
class FineBall(Ball):
    """A ball with a skin much finer than its cells."""

    def skin(self) -> tuple[np.ndarray, np.ndarray]:
        return sphere(SKIN_EDGE)


def frame_times(simulation: Simulation, frames: int) -> list[float]:
    return [seconds_of(simulation.frame) for _ in range(frames)]


def thrown_row(arch: str, n: int, stiffness: float, damping: float, frames: int) -> dict[str, Any]:
    """The time of a frame with `auto` of a cube of n³ points and 1 kg that is thrown at the ground at 5 m/s.
    stiffness [N/m]: of 8³ points; other lattices have the same Young's modulus."""
    runtime.start(arch)
    cube = Box(points=(n,) * 3, stiffness=stiffness * 7 / (n - 1), damping=damping, position=(0.0, 0.6, 0.0))
    simulation = Simulation(Scene(jello=[replace(cube, velocity=(0.0, -5.0, 0.0))], collider=[Plane()]))
    frame_times(simulation, frames)  # compiles all that an impact needs
    simulation.reset()
    seconds = frame_times(simulation, frames)
    return {
        "n": n,
        "stiffness": cube.stiffness,
        "frames": frames,
        "method": simulation.method,
        "ms": 1e3 * sum(seconds) / frames,
        "median_ms": 1e3 * float(np.median(seconds)),
        "worst_ms": 1e3 * max(seconds),
        "threads": runtime.current().threads,
    }


def crowd_row(arch: str, seconds: float) -> dict[str, Any]:
    """Milliseconds a frame of the demo `crowd` in its first `seconds`: the mean, the slowest section, the last one; and
    the share of the time, 0 to 1, that the search for contacts takes."""
    from taichi_jello.physics.forces.soft_contact.soft_penalty import Touch

    runtime.start(arch)
    simulation = Simulation(load("crowd"))
    touch = next(force for force in simulation.system.all_forces if isinstance(force, Touch))
    search, searched = touch.refresh, []
    simulation.frame()  # compiles
    simulation.reset()
    touch.refresh = lambda *arguments: searched.append(seconds_of(lambda: search(*arguments)))
    times = 1e3 * np.array(frame_times(simulation, round(seconds / simulation.frame_dt)))
    sections = [part.mean() for part in np.array_split(times, max(1, round(seconds / SECTION)))]
    return {
        "seconds": seconds,
        "ms": float(np.mean(times)),
        "worst_ms": float(max(sections)),
        "last_ms": float(sections[-1]),
        "real_time_ms": 1e3 * simulation.frame_dt,
        "search_share": 1e3 * sum(searched) / float(np.sum(times)),
        "threads": runtime.current().threads,
    }


def in_ms(seconds: dict[str, float]) -> dict[str, float]:
    return {f"{name}_ms": 1e3 * value for name, value in seconds.items()}


def skin_row(arch: str, shortest: float, repeats: int) -> dict[str, Any]:
    """Milliseconds in which points and normals of two fine skins follow their cells."""
    runtime.start(arch)
    ball = FineBall(resolution=CELLS).body()
    body = join([ball, ball])
    skin, x = Embedded(body), body.x.astype(np.float32)
    points = np.zeros((len(skin), 3), np.float32)
    seconds = timed(lambda: skin.update(x, points), shortest, repeats)
    return {"points": len(skin), "triangles": len(skin.index)} | in_ms(seconds)


def voxel_row(arch: str, shortest: float, repeats: int) -> dict[str, Any]:
    """Milliseconds in which a closed mesh is voxelised."""
    runtime.start(arch)
    points, triangles = split_edges(*sphere(SKIN_EDGE), MESH_EDGE)
    places = 0.5 * VOXELS * (points / np.ptp(points, axis=0).max() * 2.0 + 1.0)
    seconds = timed(lambda: voxelised(places, triangles, (VOXELS,) * 3, True), shortest, repeats)
    return {"triangles": len(triangles), "cells": VOXELS} | in_ms(seconds)


def lines(results: dict[str, Any]) -> list[str]:
    crowd, skin, mesh = results.get("crowd"), results.get("skin"), results.get("voxels")
    found = [
        f"auto, {row['n']}³ points, k = {row['stiffness']:.3g} N/m, thrown at the ground: {row['method']}, "
        f"{row['ms']:.1f} ms a frame in the mean, {row['median_ms']:.1f} in the median, {row['worst_ms']:.1f} at most"
        for row in results.get("thrown", [])
    ]
    if crowd:
        found.append(
            f"crowd, the first {crowd['seconds']:g} s, {crowd['threads']} threads: {crowd['ms']:.1f} ms a frame "
            f"(real time: {crowd['real_time_ms']:.1f}), {crowd['worst_ms']:.1f} in the worst {SECTION:g} s, "
            f"{crowd['last_ms']:.1f} in the last; contact search {100.0 * crowd['search_share']:.0f} % of it"
        )
    if skin:
        found.append(
            f"skin of {skin['points']} points carried along: {skin['min_ms']:.2f} ms ({skin['median_ms']:.2f})"
        )
    if mesh:
        found.append(
            f"closed mesh of {mesh['triangles']} triangles voxelised at {mesh['cells']} cells: "
            f"{mesh['min_ms']:.0f} ms ({mesh['median_ms']:.0f})"
        )
    return found
