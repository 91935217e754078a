"""Which points are near which jello."""
