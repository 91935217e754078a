"""Scene files, one format per module, and the demos that come with the package."""

import ast
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from taichi_jello.scene.description import Scene, SceneError
from taichi_jello.support.plugins import modules


def demos() -> dict[str, Path]:
    """The demos by name: in the installed package, or beside it in a checkout."""
    package = Path(__file__).parent.parent
    folder = next((f for f in (package / "demos", package.parent / "demos") if f.is_dir()), None)
    found = sorted(folder.iterdir()) if folder else []
    return {path.stem: path for path in found if path.suffix in formats() and not path.name.startswith("_")}


def describe(path: Path) -> str:
    """A demo's own one-line description: its docstring or its first comment."""
    text = path.read_text(encoding="utf-8-sig")
    if path.suffix == ".py":
        return (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
    return text.partition("\n")[0].lstrip("# ") if text.startswith("#") else ""


def load(name: str) -> Scene:
    """The scene called `name`: a demo, or a file of a known format. Files that it names are looked for beside it.

    Raises SceneError naming the file, the key and what was expected.
    """
    path, known = _path(name), formats()
    if path.suffix not in known:
        raise SceneError(name, f"expected a demo ({', '.join(demos())}) or a file ending in {', '.join(known)}")
    if not path.is_file():
        raise SceneError(name, "it is a folder, expected a file" if path.is_dir() else "there is no such file")
    try:
        scene = known[path.suffix].load(path)
    except SceneError as error:
        raise located(str(path), error) from error
    except OSError as error:
        raise SceneError(str(path), f"cannot be read: {error.strerror}") from None
    return replace(scene, jello=[jello.beside(path.parent.resolve()) for jello in scene.jello])


def save(scene: Scene, name: str) -> None:
    """Write the scene to a file, in the format that its ending names. Files that the scene names are written as seen
    from beside it.

    Raises SceneError naming the file, and the key of what the format cannot hold."""
    path = Path(name)
    able = {suffix: module for suffix, module in formats().items() if hasattr(module, "save")}
    if path.suffix not in able:
        raise SceneError(name, f"expected a file ending in {', '.join(able)}")
    try:
        able[path.suffix].save(replace(scene, jello=[jello.seen_from(path.parent) for jello in scene.jello]), path)
    except SceneError as error:
        raise SceneError(name, str(error)) from None
    except OSError as error:
        raise SceneError(name, f"cannot be written: {error.strerror}") from None


def located(name: str, error: SceneError) -> SceneError:
    """A mistake in the scene called `name`, with the line of its key where the format can tell it."""
    path = _path(name)
    line_of = getattr(formats().get(path.suffix), "line_of", None)
    line = line_of(path.read_text(encoding="utf-8-sig"), error.key) if line_of and error.key else None
    return SceneError(name, str(error) if line is None else f"line {line}: {error}")


def formats() -> dict[str, ModuleType]:
    """The modules that read scenes, by the ending of their files."""
    return {module.SUFFIX: module for module in modules(sys.modules[__name__])}


def _path(name: str) -> Path:
    """The file of a scene: a demo's, or the one of that name."""
    path = Path(name)
    return demos()[name] if path.suffix not in formats() and name in demos() else path
