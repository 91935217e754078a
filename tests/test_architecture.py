"""Rules of the house that a reader relies on: what imports what, and that nothing starts by itself."""

import ast
import subprocess
import sys
from pathlib import Path

import taichi_jello

PACKAGE = Path(taichi_jello.__file__).parent

# No folder imports one that stands after it, but where another way would be longer.
FLOORS = ("support", "scene", "shapes", "physics", "scenefiles", "run", "film", "view", "studies", "app")
UPWARDS = {
    ("run/simulation.py", "view"),  # Simulation.render
    ("studies/__main__.py", "app"),  # it runs the command line
}

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
    for name in ("scene/description.py", "scene/body.py", "shapes/lattice.py", "physics/stable_step.py"):
        tree = ast.parse((PACKAGE / name).read_text())
        names = [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
        names += [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        assert not any(n == "taichi" or n.startswith("taichi.") for n in names), name


def test_folders_import_only_what_stands_below_them():
    found = set()
    for path in PACKAGE.rglob("*.py"):
        place = path.relative_to(PACKAGE)
        if len(place.parts) == 1 or place.parts[0] not in FLOORS:
            continue
        imports = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ImportFrom) and n.module]
        names = [f"{n.module}.{a.name}".split(".") for n in imports for a in n.names]
        above = FLOORS[FLOORS.index(place.parts[0]) + 1 :]
        found |= {(place.as_posix(), n[1]) for n in names if n[0] == "taichi_jello" and n[1] in above}
    assert found == UPWARDS
