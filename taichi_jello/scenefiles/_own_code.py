"""Which line of a user's own code an error comes from."""

import re
import sysconfig
import traceback
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
LIBRARIES = [Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib")]
COMPILED = re.compile(r'^File "(.+)", line (\d+), in ', re.MULTILINE)  # how Taichi names the lines that it compiles


def own_place(error: BaseException) -> tuple[Path, int] | None:
    """The file and line of the innermost code, of those that the error passed through or that Taichi could not compile,
    that belongs neither to this package nor to a library; None without any."""
    places = [(frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    if type(error).__module__.startswith("taichi."):
        places += [(found[1], int(found[2])) for found in COMPILED.finditer(str(error))]
    own = [(Path(name), line) for name, line in places if _is_own(Path(name))]
    return own[-1] if own else None


def _is_own(path: Path) -> bool:
    return path.is_file() and not any(path.resolve().is_relative_to(folder) for folder in (PACKAGE, *LIBRARIES))
