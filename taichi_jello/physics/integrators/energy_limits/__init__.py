"""Limits that keep steps from feeding energy."""
