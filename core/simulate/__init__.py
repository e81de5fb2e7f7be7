"""Simulated performers, markers and cameras, with their truth."""
