"""The kernels of the rasteriser: from triangles and strokes to shaded pixels."""
