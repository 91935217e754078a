"""Pictures and films that the user saves from the window."""

from pathlib import Path

import numpy as np

from taichi_jello.film import Film, FilmProblem
from taichi_jello.support.png_file import unused, write_png
from taichi_jello.support.wording import counted
from taichi_jello.view.render.renderers import Run, Size

FILM_RATE = 30  # frames a second


class Pictures:
    """Saves pictures, and one film at a time, in `folder`, named after the scene and its time. Methods return a message
    for the user."""

    def __init__(self, folder: str | Path):
        # Absolute, because GGUI changes the working directory while it shows a picture, and a film may be written then.
        self.folder = Path(folder).resolve()
        self._film: Film | None = None

    @property
    def filming(self) -> bool:
        return self._film is not None

    def _unused(self, simulation: Run, suffix: str) -> Path:
        title = "".join(c if c.isalnum() or c in "-_" else "-" for c in simulation.scene.title) or "jello"
        return unused(self.folder / f"{title}-{simulation.time:.3f}s{suffix}")

    def start_film(self, simulation: Run, size: Size) -> str:
        """Begin a film with FILM_RATE frames a second."""
        even = size[0] // 2 * 2, size[1] // 2 * 2
        try:
            film = Film(self._unused(simulation, ".mp4"), even, FILM_RATE, keep=(OSError,))
            self._film = film.__enter__()
        except FilmProblem as error:
            return f"no film: {error}"
        except OSError as error:
            return f"no film: {error.strerror or error}"
        return f"filming {film.path.name}; press V to stop"

    def stop_film(self) -> str:
        """Finish the film, if there is one."""
        film, self._film = self._film, None
        if film is None:
            return ""
        try:
            film.__exit__(None, None, None)
        except OSError as error:
            kept = f"what {film.path.name} has so far is kept" if film.kept else "no film is kept"
            return f"{error.strerror or error}: {kept}"
        return f"saved {film.path.name}: {counted(film.frames, 'frame')}" if film.kept else "nothing was filmed"

    def add(self, image: np.ndarray) -> str:
        """Add a picture (height, width, 3) uint8 to the film; the film ends if that fails."""
        if self._film is None:
            return ""
        width, height = self._film.size
        try:
            self._film.add(np.ascontiguousarray(image[:height, :width]))
        except ValueError:  # the size differs
            return f"the window changed its size: {self.stop_film()}"
        except OSError:  # for example, the disk is full
            return self.stop_film()
        return ""

    def save(self, simulation: Run, image: np.ndarray) -> str:
        """Write the picture (height, width, 3) uint8."""
        path = self._unused(simulation, ".png")
        try:
            write_png(path, image)
        except OSError as error:
            return f"not saved: {error.strerror or error}"
        return f"saved {path.name}"
