"""Jellos that touch each other."""
