"""The scene description, checked, and the Body it becomes. NumPy only."""
