"""A scene in motion: simulation, clock, the method, warnings, replay, trajectories."""
