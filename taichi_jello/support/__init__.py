"""Shared by all folders: the Taichi runtime, Ctrl-C, plugins, progress, wording."""
