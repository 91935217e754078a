"""Scene files, one format per module, and the demos that come with the package."""

import ast
import sys
from pathlib import Path

from taichi_jello.plugins import modules
from taichi_jello.scene import Scene, SceneError


def demos() -> dict[str, Path]:
    """The demos by name: in the installed package, or beside it in a checkout."""
    package = Path(__file__).parent.parent
    folder = next((f for f in (package / "demos", package.parent / "demos") if f.is_dir()), None)
    suffixes = {module.SUFFIX for module in modules(sys.modules[__name__])}
    found = sorted(folder.iterdir()) if folder else []
    return {path.stem: path for path in found if path.suffix in suffixes and not path.name.startswith("_")}


def describe(path: Path) -> str:
    """A demo's own one-line description: its docstring or its first comment."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
    return text.partition("\n")[0].lstrip("# ") if text.startswith("#") else ""


def load(name: str) -> Scene:
    """The scene called `name`: a demo, or a file of a known format.

    Raises SceneError naming the file, the key and what was expected.
    """
    formats = {module.SUFFIX: module for module in modules(sys.modules[__name__])}
    path = Path(name)
    if path.suffix not in formats and name in demos():
        path = demos()[name]
    if path.suffix not in formats:
        raise SceneError(name, f"expected a demo ({', '.join(demos())}) or a file ending in {', '.join(formats)}")
    if not path.is_file():
        raise SceneError(name, "there is no such file")
    try:
        return formats[path.suffix].load(path)
    except SceneError as error:
        raise SceneError(str(path), str(error)) from error
    except OSError as error:
        raise SceneError(str(path), f"cannot be read: {error.strerror}") from None
