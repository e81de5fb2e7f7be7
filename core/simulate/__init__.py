"""Simulated performers, markers and cameras, with their ground truth."""
