"""Warnings about likely mistakes in a scene: before it runs, and while it runs."""
