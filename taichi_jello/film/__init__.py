"""Films: a recorder that takes frames and always leaves a complete file."""

from taichi_jello.film.recorder import Film as Film
from taichi_jello.film.writer import FilmProblem as FilmProblem
from taichi_jello.film.writer import Mesh as Mesh
