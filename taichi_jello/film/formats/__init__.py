"""Film formats, one per file."""
