"""Rigid obstacles, one kind per file: its description, its signed distance and its drawn surface."""
