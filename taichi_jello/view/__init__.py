"""Pictures, films and the interactive window. Physics does not import this folder."""

from taichi_jello.view.render.ggui import window_problem
from taichi_jello.view.render.renderers import film_strip, open_renderer, picture

__all__ = ["film_strip", "open_renderer", "picture", "window_problem"]
