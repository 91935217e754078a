"""Springs per second by lattice size, threads and precision, compared with NumPy and beside a busy process; pictures
per second; start-up; memory."""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from taichi_jello.run.simulation import Simulation
from taichi_jello.scene.body import Body
from taichi_jello.scene.description import Camera, Scene, Solver
from taichi_jello.scenefiles import load
from taichi_jello.shapes.lattice import Box
from taichi_jello.studies import _report as report
from taichi_jello.studies._speed import busy
from taichi_jello.studies._speed.scenes import STIFF, VISIBLE, crowd_row, skin_row, thrown_row, voxel_row
from taichi_jello.studies._speed.scenes import lines as scene_lines
from taichi_jello.support import runtime

DT = 1e-6  # s; so short that nothing moves far
MAX_STEPS, MAX_SPRINGS = 200, 2e7  # steps of a launch, about those of a frame, and springs that it evaluates
WINDOWS = 9  # opened in turns with GGUI's own


def numpy_step(body: Body) -> Callable[[], None]:
    """A symplectic Euler step of the same lattice in NumPy float32, which gathers both ends of every spring."""
    i, j = (np.ascontiguousarray(end) for end in body.springs.T)
    k, c, rest = (a.astype(np.float32)[:, None] for a in (body.stiffness, body.damping, body.rest_length))
    x, v = body.x.astype(np.float32), body.v.astype(np.float32)
    per_mass = np.float32(DT) / body.mass.astype(np.float32)[:, None]

    def step() -> None:
        d, w = x[j] - x[i], v[j] - v[i]
        inverse = 1.0 / np.sqrt(np.einsum("sa,sa->s", d, d))[:, None]
        f = (k * (1.0 - rest * inverse) + c * np.einsum("sa,sa->s", w, d)[:, None] * inverse * inverse) * d
        for axis in range(3):
            total = np.bincount(i, f[:, axis], len(x)) - np.bincount(j, f[:, axis], len(x))
            v[:, axis] += per_mass[:, 0] * total
        x[:] += np.float32(DT) * v

    return step


def kernel_row(
    n: int, arch: str, precision: str, threads: int, method: str, shortest: float, team: int | None = None
) -> dict[str, Any]:
    """Springs per second of the whole step: springs, sums and integration. team: as of Simulation; 0: parallel tasks, a
    launch for each stage."""
    runtime.start(arch, precision, threads)
    scene = Scene(gravity=(0.0, 0.0, 0.0), jello=[Box(points=(n, n, n))], solver=Solver(frame_dt=1000 * DT))
    simulation = Simulation(scene, method=method, substeps=1000, team=team)
    system, springs = simulation.system, len(simulation.body.springs)
    if system.size:
        system.size.hold(system.team)
    passes = system.integrator.passes
    batch = max(5, min(MAX_STEPS, round(MAX_SPRINGS / (springs * passes))))
    whole = report.timed(report.stepping(simulation, batch, DT), shortest)
    seconds = {name: value / (batch * passes) for name, value in whole.items()}
    return {
        "n": n,
        "arch": system.owner.arch,
        "precision": precision,
        "threads": threads,
        "method": method,
        "form": f"team of {system.team}" if system.team else "parallel",
        **rates(springs, seconds),
        "ns_per_spring": 1e9 * seconds["min"] / springs,
        "bytes_per_particle": sum(size for *_, size in system.memory.fields) / len(simulation.body),
    }


def numpy_row(n: int, shortest: float) -> dict[str, Any]:
    body = Box(points=(n, n, n)).body()
    return {"n": n} | rates(len(body.springs), report.timed(numpy_step(body), shortest))


def rates(springs: int, seconds: dict[str, float]) -> dict[str, Any]:
    """What a pass over the springs takes and achieves."""
    microseconds = {name: 1e6 * value for name, value in seconds.items()}
    return {"us_per_pass": microseconds, "million_springs_per_second": springs / seconds["min"] / 1e6}


def renderer_rows(arch: str, quick: bool, shortest: float, repeats: int) -> list[dict[str, Any]]:
    """Pictures of the cube per second at 1280×720, with drawing and read-back."""
    from taichi_jello.view.render.ggui import available
    from taichi_jello.view.render.renderers import drawing_of, finished, open_renderer

    runtime.start(arch)
    simulation = Simulation(Scene(jello=[Box(position=(0.0, 0.8, 0.0))], camera=Camera()))
    rows = []
    for name in ["raster", *(["ggui"] if available() else [])]:
        for samples, every in ((1, True),) if quick else ((1, True), (1, False), (2, True)):
            drawing, renderer = drawing_of(simulation), open_renderer(name, (1280, 720), samples)
            if drawing.springs is not None:
                drawing.springs.everything = every
            seconds = report.timed(partial(finished, renderer, drawing, simulation), shortest, repeats)
            renderer.close()
            row = {"renderer": name, "samples": samples, "springs": "all" if every else "structural"}
            rows.append(row | {"pictures_per_second": 1.0 / seconds["median"], "seconds": seconds})
    return rows


def window_row(arch: str, frames: int) -> dict[str, Any]:
    """Median milliseconds of a frame of the demo `cube` in a window, of its physics, and of GGUI alone with the same
    triangles, lines and dots; and the ratio of window to GGUI, the median over turns. Without a screen, the reason."""
    from taichi_jello.run.replay import playable
    from taichi_jello.view.render.ggui import Ggui, window_problem
    from taichi_jello.view.window.screen import Screen
    from taichi_jello.view.window.viewer import Viewer

    problem = window_problem()
    if problem is not None:
        return {"not_measured": problem}
    runtime.start(arch)
    viewer = Viewer(Simulation(playable(load("cube"))))
    turns: dict[str, list[float]] = {"frame": [], "physics": [], "ggui_alone": []}
    for _ in range(WINDOWS):
        found: dict[str, list[float]] = {name: [] for name in turns}
        screen = Screen(viewer.size, "jello")
        for _ in range(frames):
            start = time.perf_counter()
            screen.listen(viewer)
            viewer.advance(viewer.simulation.frame_dt)
            physics = time.perf_counter()
            viewer.update()
            screen.show(viewer)
            found["frame"].append(time.perf_counter() - start)
            found["physics"].append(physics - start)
            viewer.do_pending()  # the first frame is compiled here
        screen.close()
        alone = Ggui(viewer.size, samples=1, window=True)
        for _ in range(frames):
            start = time.perf_counter()
            alone.draw(viewer.drawing, viewer.viewpoint)
            alone.show()
            found["ggui_alone"].append(time.perf_counter() - start)
        alone.close()
        for name, times in found.items():
            turns[name].append(1e3 * statistics.median(times))
    ratios = [frame / alone for frame, alone in zip(turns["frame"], turns["ggui_alone"], strict=True)]
    median = {f"{name}_ms": statistics.median(times) for name, times in turns.items()}
    return median | {"ratio": statistics.median(ratios), "ratios": [min(ratios), max(ratios)]}


def start_up() -> dict[str, dict[str, float]]:
    """Seconds that `jello shot cube` takes with an empty kernel cache and with a warm one."""
    found: dict[str, list[float]] = {"cold": [], "warm": []}
    with tempfile.TemporaryDirectory() as folder:
        for attempt in range(3):
            for state in ("cold", "warm"):
                command = [sys.executable, "-m", "taichi_jello", "shot", "cube", "--quiet", "-o", f"{folder}/cube.png"]
                environment = {"TI_OFFLINE_CACHE_FILE_PATH": f"{folder}/cache{attempt}"}
                run = partial(subprocess.run, command, check=True, env={**os.environ, **environment})
                found[state].append(report.seconds_of(run))
    return {state: report.min_and_median(times) for state, times in found.items()}


def kernel_cases(arch: str, threads: int | None, quick: bool) -> Iterator[dict[str, Any]]:
    """The arguments of `kernel_row`: sizes and threads, then parallel tasks, f64 and RK4; `quick`: small lattices."""
    euler: dict[str, Any] = {"precision": "f32", "method": "symplectic-euler"}
    cores = len(runtime.usable_cores()) if arch == "cpu" else 1
    for n in (4, 8) if quick else (8, 16, 32, 64):
        for number in sorted({1, min(threads or cores, cores)}):
            if n > 4 or number == 1:
                yield euler | {"n": n, "threads": number}
    if arch == "cpu":
        for n in (8,) if quick else (32, 64):
            yield euler | {"n": n, "threads": cores, "team": 0}
    precisions = ["f32"] if arch in ("vulkan", "metal") else ["f32", "f64"]
    for n in (8,) if quick else (8, 16):
        for precision in precisions[1:]:
            yield euler | {"n": n, "threads": 1, "precision": precision}
    for precision in precisions[: 1 if quick else 2]:
        yield euler | {"n": 8, "threads": 1, "precision": precision, "method": "rk4"}


def measure(chosen: argparse.Namespace) -> dict[str, Any]:
    """All figures; with --quick small lattices and short timings."""
    arch = runtime.choose_arch(chosen.arch)
    results: dict[str, Any] = report.machine() | {"kernels": [], "numpy_gather": [], "renderers": [], "window": {}}
    results["start_up_seconds"] = {}
    cases = list(kernel_cases(arch, chosen.threads, chosen.quick))
    report.take(chosen, results, pieces(arch, cases, chosen.quick, results), "speed", len(cases) + 7)
    if sys.platform != "win32":
        import resource  # Windows has none

        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        results["peak_bytes_of_this_study"] = memory * (1 if sys.platform == "darwin" else 1024)
    return results


def pieces(arch: str, cases: list[dict[str, Any]], quick: bool, results: dict[str, Any]) -> Iterator[None]:
    shortest, repeats = (0.02, 3) if quick else (0.2, report.REPEATS)
    for case in cases:
        results["kernels"].append(kernel_row(**case, arch=arch, shortest=shortest))
        yield
    for n in sorted({case["n"] for case in cases})[:3]:
        results["numpy_gather"].append(numpy_row(n, shortest))
    yield
    results["busy"] = busy.busy_row(arch, 16 if quick else 32, 5.0 * shortest, repeats)
    yield
    results["renderers"] = renderer_rows(arch, quick, shortest, repeats)
    yield
    results["window"] = window_row(arch, 7 if quick else 20)
    yield
    thrown = STIFF[:1] + VISIBLE[:1] if quick else STIFF + VISIBLE
    results["thrown"] = [thrown_row(arch, *case, 20 if quick else 60) for case in thrown]
    yield
    results["crowd"] = crowd_row(arch, 0.5 if quick else 4.0)
    results["skin"], results["voxels"] = skin_row(arch, shortest, repeats), voxel_row(arch, shortest, repeats)
    yield
    if not quick:
        results["start_up_seconds"] = start_up()
    yield


def text(results: dict[str, Any]) -> str:
    lines = [
        report.headline(results),
        "    n  arch  number  threads  method            form      us a pass (median)  M springs/s  ns each  B each",
    ]
    for row in results["kernels"]:
        us = row["us_per_pass"]
        lines.append(
            f"{row['n']:5d}  {row['arch']:4s}  {row['precision']:6s}  {row['threads']:7d}  {row['method']:16s}"
            f"  {row['form']:8s}  {us['min']:8.1f} ({us['median']:.1f})  {row['million_springs_per_second']:9.0f}"
            f"  {row['ns_per_spring']:9.2f}  {row['bytes_per_particle']:9.0f}"
        )
    for row in results["numpy_gather"]:
        us = row["us_per_pass"]
        kernel = next(k for k in results["kernels"] if k["n"] == row["n"] and k["threads"] == 1)
        ratio = kernel["million_springs_per_second"] / row["million_springs_per_second"]
        lines.append(
            f"{row['n']:5d}  NumPy float32 gather: {us['min']:.0f} ({us['median']:.0f}) µs a pass, "
            f"{row['million_springs_per_second']:.1f} M springs/s; one thread here is {ratio:.0f} times as fast"
        )
    lines += [busy.line(row) for row in [results.get("busy")] if row]
    for row in results["renderers"]:
        kind = f"{row['renderer']}, {row['samples']}x{row['samples']} samples, {row['springs']} springs"
        lines.append(f"{kind}: {row['pictures_per_second']:.1f} pictures/s")
    row = results["window"]
    if "not_measured" in row:
        lines.append(f"window: not measured: {row['not_measured']}")
    elif row:
        lines.append(
            f"window: {row['frame_ms']:.1f} ms a frame, {row['physics_ms']:.1f} of them physics; "
            f"{row['ratio']:.2f} times ({row['ratios'][0]:.2f} to {row['ratios'][1]:.2f}) "
            f"GGUI alone with the same primitives, {row['ggui_alone_ms']:.1f} ms"
        )
    lines += scene_lines(results)
    for state, seconds in results["start_up_seconds"].items():
        lines.append(
            f"`jello shot cube`, {state} kernel cache: {seconds['median']:.2f} s (at best {seconds['min']:.2f})"
        )
    return "\n".join(lines + [report.INTERRUPTED] * results["interrupted"])
