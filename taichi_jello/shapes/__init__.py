"""Shapes, one per file: a subclass of `Jello` with a `shape` name and `body()`; NumPy only."""
