"""The solve of an implicit step."""
