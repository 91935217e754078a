"""Films: a recorder that takes frames and leaves a whole file, whatever happens on the way."""

from taichi_jello.film.recorder import Film, suffixes
from taichi_jello.film.writer import FilmProblem, Mesh

__all__ = ["Film", "FilmProblem", "Mesh", "suffixes"]
