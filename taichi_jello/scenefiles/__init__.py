"""Scene files, one format per module, and the demos that come with the package."""

import ast
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from taichi_jello.scene.description import Scene, SceneError
from taichi_jello.scenefiles import python
from taichi_jello.scenefiles._own_code import own_place
from taichi_jello.support.plugins import modules


def formats() -> dict[str, ModuleType]:
    """The modules that read scenes, by file suffix."""
    return {module.SUFFIX: module for module in modules(sys.modules[__name__])}


def demos() -> dict[str, Path]:
    """The demos by name: in the installed package, or beside it in a checkout."""
    package = Path(__file__).parent.parent
    folder = next((f for f in (package / "demos", package.parent / "demos") if f.is_dir()), None)
    found = sorted(folder.iterdir()) if folder else []
    return {path.stem: path for path in found if path.suffix in formats() and not path.name.startswith("_")}


def describe(path: Path) -> str:
    """The one-line description of a demo: its docstring or its first comment."""
    text = path.read_text(encoding="utf-8-sig")
    if path.suffix == ".py":
        return (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
    return text.partition("\n")[0].lstrip("# ") if text.startswith("#") else ""


def load(name: str) -> Scene:
    """Load a demo or a scene file by name. Paths in the file are relative to it.

    Raises SceneError naming the file, the key and what was expected.
    """
    path, known = _path(name), formats()
    suffix = path.suffix.lower()
    if suffix not in known:
        raise SceneError(name, f"expected a demo ({', '.join(demos())}) or a file ending in {', '.join(known)}")
    if not path.is_file():
        kind = "a folder" if path.is_dir() else "a device or pipe"
        raise SceneError(name, f"it is {kind}, expected a file" if path.exists() else "there is no such file")
    try:
        scene = known[suffix].load(path)
    except SceneError as error:
        raise located(str(path), error) from error
    except OSError as error:
        raise SceneError(str(path), f"cannot be read: {error.strerror}") from None
    return replace(scene, jello=[jello.with_files_in(path.parent.resolve()) for jello in scene.jello])


def save(scene: Scene, name: str) -> None:
    """Write the scene to a file, in the format of its suffix, with paths relative to it.

    Raises SceneError naming the file, and the key of a value that the format cannot hold."""
    path = Path(name)
    writable = {suffix: module for suffix, module in formats().items() if hasattr(module, "save")}
    if path.suffix.lower() not in writable:
        raise SceneError(name, f"expected a file ending in {', '.join(writable)}")
    moved = replace(scene, jello=[jello.with_files_relative_to(path.parent) for jello in scene.jello])
    try:
        writable[path.suffix.lower()].save(moved, path)
    except SceneError as error:
        raise SceneError(name, str(error)) from None
    except OSError as error:
        raise SceneError(name, f"cannot be written: {error.strerror}") from None


def located(name: str, error: SceneError) -> SceneError:
    """The error with the scene's name and, if the format knows it, the line of its key."""
    path = _path(name)
    line_of = getattr(formats().get(path.suffix.lower()), "line_of", None)
    line = line_of(path.read_text(encoding="utf-8-sig"), error.key) if line_of and error.key else None
    return SceneError(name, str(error) if line is None else f"line {line}: {error}")


def failure(error: Exception) -> SceneError | None:
    """The error in one line, if a user's own code raised it after the scene was loaded."""
    place = own_place(error)
    return SceneError(str(place[0]), str(python.failure(error, f"line {place[1]}: "))) if place else None


def _path(name: str) -> Path:
    path = Path(name)
    return demos()[name] if path.suffix.lower() not in formats() and name in demos() else path
