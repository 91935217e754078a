"""What everything else uses: the Taichi runtime, Ctrl-C, plugins, progress, wording."""
