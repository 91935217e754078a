"""Rules of the house that a reader relies on: what imports what, and that nothing starts by itself."""

import ast
import subprocess
import sys
from pathlib import Path

import taichi_jello

PACKAGE = Path(taichi_jello.__file__).parent

CHECK = """
import sys, taichi as ti
import taichi_jello
from taichi_jello import Box, Plane, Scene, Simulation
assert ti.lang.impl.get_runtime().prog is None, "importing started Taichi"
Simulation(Scene(jello=[Box(points=(2, 2, 2))], collider=[Plane()])).frame()
loaded = [m for m in sys.modules if m.startswith("taichi_jello.view") or m in ("matplotlib", "trimesh", "scipy", "PIL")]
assert not loaded, loaded
"""


def test_physics_loads_no_viewer_and_importing_starts_nothing(tmp_path):
    done = subprocess.run([sys.executable, "-c", CHECK], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_only_the_runtime_starts_taichi():
    for path in PACKAGE.rglob("*.py"):
        calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Attribute)]
        starts = [c for c in calls if c.attr in ("init", "reset") and getattr(c.value, "id", "") == "ti"]
        assert not starts or path.name == "runtime.py", path


def test_scene_and_body_know_no_taichi():
    for name in ("scene.py", "body.py", "shapes/lattice.py", "physics/bounds.py"):
        tree = ast.parse((PACKAGE / name).read_text())
        names = [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
        names += [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        assert not any(n == "taichi" or n.startswith("taichi.") for n in names), name
