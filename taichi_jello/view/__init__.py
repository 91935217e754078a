"""Drawing: one description of the picture, two renderers, the legend and the window.

The physics knows nothing of it.
"""

from taichi_jello.view.render.renderers import film_strip, open_renderer, picture, window_problem

__all__ = ["film_strip", "open_renderer", "picture", "window_problem"]
