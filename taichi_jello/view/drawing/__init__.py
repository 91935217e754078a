"""From a simulation's state to triangles, lines and dots."""
