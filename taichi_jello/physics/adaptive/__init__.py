"""The step control of the method `adaptive`."""
