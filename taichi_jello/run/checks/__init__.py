"""Warnings of what a scene is likely not meant to do: before it runs, and while it does."""
