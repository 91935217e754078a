"""Readers of mesh files, one a format: bytes -> vertices and triangles (NumPy only)."""
